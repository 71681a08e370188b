//! Writes the interface vertices, those shared by several clusters, once for all of their pieces.

use std::path::Path;

use super::Partition;
use super::id::PartitionVertex;
use super::reading::gather;
use crate::base::Result;
use crate::file::{ColumnWriter, PackedWriter};
use crate::model::StoredMesh;

/// Vertices gathered at once.
const INTERFACE_RECORDS: usize = 64 << 10;

/// Writes the positions (and colours, if any) of the vertices shared by several clusters, in their order, to files in
/// `folder` whose names begin with `name`.
///
/// # Errors
/// On a full disk, failed reads and writes.
pub fn write_shared(partition: &Partition, folder: &Path, name: &str, mesh: &mut StoredMesh) -> Result<()> {
    let (shared, numbering) = (&partition.faces.shared, &partition.numbering);
    if shared.is_empty() {
        return Ok(());
    }
    let path = |what: &str| folder.join(format!("{name}-shared-{what}.col"));
    let mut positions = PackedWriter::create(&path("positions"), *b"position")?;
    let mut colours = match &numbering.colours {
        Some(column) => Some((column, ColumnWriter::create(&path("colours"), *b"colour  ")?)),
        None => None,
    };
    let mut members = shared.iter().peekable();
    while members.peek().is_some() {
        let ids: Vec<PartitionVertex> = members.by_ref().take(INTERFACE_RECORDS).collect();
        positions.append(&numbering.positions.gather(&ids)?)?;
        if let Some((column, writer)) = &mut colours {
            writer.append(&gather(column, &ids)?)?;
        }
    }
    mesh.shared_positions = Some(positions.finish()?);
    mesh.shared_colours = colours.map(|(_, writer)| writer.finish()).transpose()?;
    Ok(())
}
