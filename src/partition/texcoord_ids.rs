//! Which texture coordinates faces use.

use super::id::ClusterTexcoord;
use crate::base::id::TiVec;
use crate::model::Face;
use crate::model::id::{FaceVertex, Texcoord};

/// Largest span of texcoords per face for which they are collected in a bit set; a list takes 32 times that and is
/// sorted.
const SPAN_PER_FACE: u64 = 64;

/// All texcoords that the faces of a cluster use, ascending.
pub(super) fn texcoord_ids<V: FaceVertex<Texcoord = Texcoord>>(faces: &[Face<V>]) -> TiVec<ClusterTexcoord, Texcoord> {
    let (mut first, mut end) = (u32::MAX, 0);
    for face in faces {
        for id in face.texcoords {
            // "None" changes nothing: the number after it is 0.
            first = first.min(id.number());
            end = end.max(id.number().wrapping_add(1));
        }
    }
    let span = end.saturating_sub(first);
    if u64::from(span) <= SPAN_PER_FACE * faces.len() as u64 {
        return ids_of_span(faces, Texcoord::new(first), span as usize);
    }
    let mut ids: Vec<Texcoord> = Vec::with_capacity(faces.len());
    let mut recent = [Texcoord::NONE; 64];
    for id in faces.iter().flat_map(|face| face.named_texcoords()) {
        let slot = &mut recent[id.index() % 64];
        if *slot != id {
            *slot = id;
            ids.push(id);
        }
    }
    ids.sort_unstable();
    ids.dedup();
    ids.into()
}

/// The same; all must lie in the `span` ids from `first` on.
fn ids_of_span<V: FaceVertex<Texcoord = Texcoord>>(
    faces: &[Face<V>],
    first: Texcoord,
    span: usize,
) -> TiVec<ClusterTexcoord, Texcoord> {
    let mut bits = vec![0u64; span.div_ceil(64)];
    for face in faces {
        for id in face.texcoords {
            let place = id.number().wrapping_sub(first.number()) as usize;
            // "None" lies outside.
            if place < span {
                bits[place / 64] |= 1 << (place % 64);
            }
        }
    }
    let mut ids = TiVec::with_capacity(bits.iter().map(|word| word.count_ones() as usize).sum());
    for (at, mut word) in bits.into_iter().enumerate() {
        while word != 0 {
            ids.push(first.plus(64 * at as u32 + word.trailing_zeros()));
            word &= word - 1;
        }
    }
    ids
}
