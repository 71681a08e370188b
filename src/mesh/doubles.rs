//! Faces with the same three vertices: copies, and back sides of double-sided faces.

use super::id::FaceId;

/// Faces, ascending, whose three vertices an earlier face has in any order. `faces` gives the vertices of each face.
/// O(n log n).
pub fn doubles<V: Copy + Ord>(faces: impl Iterator<Item = [V; 3]>) -> Vec<FaceId> {
    let mut keys: Vec<([V; 3], FaceId)> = faces
        .enumerate()
        .map(|(face, mut key)| {
            key.sort_unstable();
            (key, FaceId::from(face))
        })
        .collect();
    keys.sort_unstable();
    let mut found: Vec<FaceId> = keys.windows(2).filter(|pair| pair[0].0 == pair[1].0).map(|pair| pair[1].1).collect();
    found.sort_unstable();
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::id::short::f;

    #[test]
    fn copies_and_back_sides_are_found_and_the_first_of_each_is_not() {
        let faces = [[0, 1, 2], [2, 1, 3], [1, 0, 2], [2, 0, 1], [3, 1, 2], [0, 1, 4]];
        assert_eq!(doubles(faces.into_iter()), [2, 3, 4].map(f));
        assert!(doubles::<u32>(std::iter::empty()).is_empty());
    }
}
