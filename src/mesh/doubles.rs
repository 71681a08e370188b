//! Faces with the same three vertices: copies, and back sides of double-sided faces.

/// Faces, ascending, whose three vertices an earlier face has in any order. `vertices` returns the vertices of each of
/// the faces 0 .. `count`. O(n log n).
pub fn doubles(count: usize, vertices: impl Fn(u32) -> [u32; 3]) -> Vec<u32> {
    let mut keys: Vec<([u32; 3], u32)> = (0..count as u32)
        .map(|face| {
            let mut key = vertices(face);
            key.sort_unstable();
            (key, face)
        })
        .collect();
    keys.sort_unstable();
    let mut found: Vec<u32> = keys.windows(2).filter(|pair| pair[0].0 == pair[1].0).map(|pair| pair[1].1).collect();
    found.sort_unstable();
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn copies_and_back_sides_are_found_and_the_first_of_each_is_not() {
        let faces = [[0, 1, 2], [2, 1, 3], [1, 0, 2], [2, 0, 1], [3, 1, 2], [0, 1, 4]];
        assert_eq!(doubles(faces.len(), |face| faces[face as usize]), [2, 3, 4]);
        assert!(doubles(0, |_| [0; 3]).is_empty());
    }
}
