//! Ids in the mesh of one cluster, and pairs of them.

use crate::base::id::ids;

ids! {
    /// A vertex: one position.
    LocalVertex;
    /// A wedge: all corners of a vertex with the same texture coordinate and material.
    Wedge;
    /// A corner of a face: 4 × the face + its index in the face, so that no division takes them apart.
    Corner;
    /// A face.
    FaceId;
}

impl Corner {
    /// The corner of a face with an index of 0 to 2.
    #[inline(always)]
    pub const fn at(face: FaceId, index: usize) -> Self {
        Self::new(4 * face.number() + index as u32)
    }

    /// Its face.
    #[inline(always)]
    pub const fn face(self) -> FaceId {
        FaceId::new(self.number() / 4)
    }

    /// Its index in its face, 0 to 2.
    #[inline(always)]
    pub const fn index_in_face(self) -> usize {
        self.index() % 4
    }

    /// Its place among the corners of all faces, three a face.
    #[inline(always)]
    pub const fn place(self) -> usize {
        self.index() - self.index() / 4
    }

    /// The next and the previous corner in the face, counter-clockwise.
    #[inline(always)]
    pub fn others(self) -> [Self; 2] {
        // A table lookup, because a branch on the corner's index would be unpredictable.
        const STEPS: [[u32; 2]; 4] =
            [[1, 2], [1, 1u32.wrapping_neg()], [2u32.wrapping_neg(), 1u32.wrapping_neg()], [0, 0]];
        let [next, previous] = STEPS[self.index_in_face()];
        [Self::new(self.number().wrapping_add(next)), Self::new(self.number().wrapping_add(previous))]
    }

    /// The next corner in the face, counter-clockwise.
    #[inline(always)]
    pub fn next(self) -> Self {
        self.others()[0]
    }

    /// The previous corner in the face, counter-clockwise.
    #[inline(always)]
    pub fn previous(self) -> Self {
        self.others()[1]
    }
}

impl FaceId {
    /// Its corners, counter-clockwise.
    #[inline(always)]
    pub fn corners(self) -> [Corner; 3] {
        [0, 1, 2].map(|index| Corner::at(self, index))
    }
}

/// An edge, directed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Edge {
    /// The end at which it begins; the one that vanishes if it collapses.
    pub from: LocalVertex,
    /// The end to which it leads.
    pub to: LocalVertex,
}

/// The wedges of an edge in one of its faces.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct WedgePair {
    /// Wedge of the end at which the edge begins.
    pub from: Wedge,
    /// Wedge of the end to which it leads.
    pub to: Wedge,
}

/// The far end of an edge in one of its faces.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct End {
    /// The vertex.
    pub vertex: LocalVertex,
    /// Its wedge in the face.
    pub wedge: Wedge,
}

#[cfg(test)]
pub(crate) mod short {
    //! Short names of ids for tests.

    use super::{FaceId, LocalVertex, Wedge, WedgePair};

    /// A vertex.
    pub const fn v(number: u32) -> LocalVertex {
        LocalVertex::new(number)
    }

    /// A wedge.
    pub const fn w(number: u32) -> Wedge {
        Wedge::new(number)
    }

    /// A face.
    pub const fn f(number: u32) -> FaceId {
        FaceId::new(number)
    }

    /// A pair of wedges.
    pub const fn pair(from: u32, to: u32) -> WedgePair {
        WedgePair { from: w(from), to: w(to) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_follow_each_other_around_their_face() {
        let [a, b, c] = FaceId::new(7).corners();
        assert_eq!([a, b, c].map(Corner::next), [b, c, a]);
        assert_eq!([a, b, c].map(Corner::previous), [c, a, b]);
        assert_eq!([a, b, c].map(|corner| Corner::at(corner.face(), corner.index_in_face())), [a, b, c]);
    }
}
