//! Which texture coordinates faces use.

use crate::model::{Face, NO_TEXCOORD};

/// Largest span of texcoord ids per face for which they are collected in a bit set; a list takes 32 times that and is
/// sorted.
const SPAN_PER_FACE: u64 = 64;

/// Ids of all texcoords that faces use, ascending.
pub(super) fn texcoord_ids(faces: &[Face]) -> Vec<u32> {
    let used = || faces.iter().flat_map(|face| face.texcoords).filter(|&id| id != NO_TEXCOORD);
    let (first, last) = used().fold((u32::MAX, 0), |(first, last), id| (first.min(id), last.max(id)));
    let span = (u64::from(last) + 1).saturating_sub(u64::from(first));
    if span <= SPAN_PER_FACE * faces.len() as u64 {
        return ids_of_span(used(), first, span as usize);
    }
    let mut ids: Vec<u32> = Vec::with_capacity(faces.len());
    let mut recent = [NO_TEXCOORD; 64];
    for id in used() {
        let slot = &mut recent[id as usize % 64];
        if *slot != id {
            *slot = id;
            ids.push(id);
        }
    }
    ids.sort_unstable();
    ids.dedup();
    ids
}

/// Distinct ids in `used`, ascending; all must lie in the `span` ids from `first` on.
fn ids_of_span(used: impl Iterator<Item = u32>, first: u32, span: usize) -> Vec<u32> {
    let mut bits = vec![0u64; span.div_ceil(64)];
    used.for_each(|id| bits[(id - first) as usize / 64] |= 1 << ((id - first) % 64));
    let mut ids = Vec::with_capacity(bits.iter().map(|word| word.count_ones() as usize).sum());
    for (at, mut word) in bits.into_iter().enumerate() {
        while word != 0 {
            ids.push(first + 64 * at as u32 + word.trailing_zeros());
            word &= word - 1;
        }
    }
    ids
}
