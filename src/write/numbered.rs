//! Numbers the faces of a result as its file does, on all threads, and groups them by part.

use super::grouping::Grouping;
use super::order::PartPlace;
use super::sink::ResultMesh;
use crate::base::Result;
use crate::base::ordered::map_within;
use crate::model::Face;
use crate::model::corners::FaceReader;
use crate::model::face::BLOCK_FACES;
use crate::model::id::MeshVertex;

/// Faces of a block: the place of each, and its record.
struct NumberedBlock {
    places: Vec<PartPlace>,
    words: Vec<u32>,
}

/// Groups the faces by part; `number` appends the `words` words of the record of a face.
///
/// # Errors
/// If a file cannot be read; on a full disk.
pub(super) fn group_faces(
    result: &ResultMesh<'_>,
    words: usize,
    number: impl Fn(&Face<MeshVertex>, &mut Vec<u32>) + Sync,
) -> Result<Grouping<PartPlace>> {
    let ResultMesh { mesh, numbering, usage, ref order, share, work_folder, .. } = *result;
    let mut grouped = Grouping::new(order.counts(usage), words, share, &work_folder.join("write-faces.tmp"))?;
    let blocks = mesh.pieces.iter().zip(numbering);
    let blocks = blocks.flat_map(|(piece, ids)| piece.faces.blocks().iter().map(move |block| (piece, ids, block)));
    let block_bytes = FaceReader::MEMORY_BYTES + (BLOCK_FACES * 4 * (words + 1)) as u64;
    map_within(
        share,
        |_| block_bytes,
        blocks,
        |(piece, ids, block)| {
            let (mut bytes, mut faces) = (Vec::new(), Vec::new());
            piece.faces.read_block(&piece.faces.open()?, block, &mut bytes, &mut faces)?;
            let places = faces.iter().map(|face| order.place(face.part)).collect();
            let mut numbered = NumberedBlock { places, words: Vec::with_capacity(words * faces.len()) };
            faces.iter().for_each(|face| number(&ids.globalise(face), &mut numbered.words));
            Ok(numbered)
        },
        |NumberedBlock { places, words: records }| {
            let mut records = places.into_iter().zip(records.chunks_exact(words));
            records.try_for_each(|(place, record)| grouped.push(place, record))
        },
    )?;
    Ok(grouped)
}
