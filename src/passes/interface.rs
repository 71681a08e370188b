//! Writes the interface vertices, those shared by several clusters, once for all of their pieces.

use super::pass_id::Pass;
use super::run::Run;
use crate::base::Result;
use crate::file::{ColumnWriter, PackedWriter};
use crate::model::StoredMesh;
use crate::partition::id::PartitionVertex;
use crate::partition::{Partition, reading};

/// Vertices gathered at once.
const INTERFACE_RECORDS: usize = 64 << 10;

impl Run<'_> {
    /// Writes the positions (and colours, if any) of the vertices shared by several clusters, in their order.
    pub(super) fn write_shared(&self, partition: &Partition, pass: Pass, mesh: &mut StoredMesh) -> Result<()> {
        let (shared, numbering) = (&partition.faces.shared, &partition.numbering);
        if shared.is_empty() {
            return Ok(());
        }
        let path = |what: &str| self.job.path().join(format!("pass-{}-shared-{what}.col", pass.number));
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
                writer.append(&reading::gather(column, &ids)?)?;
            }
        }
        mesh.shared_positions = Some(positions.finish()?);
        mesh.shared_colours = colours.map(|(_, writer)| writer.finish()).transpose()?;
        Ok(())
    }
}
