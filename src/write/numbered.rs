//! Numbers the faces of a result as its file does, on all threads, and groups them by part.

use super::face_sweep::{FaceRun, map_faces};
use super::grouping::Grouping;
use super::order::PartPlace;
use super::sink::ResultMesh;
use crate::base::Result;
use crate::model::Face;
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
    map_faces(
        mesh,
        numbering,
        share,
        (BLOCK_FACES * 4 * (words + 1)) as u64,
        |FaceRun { ids, faces, .. }| {
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
