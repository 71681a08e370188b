//! Disjoint sets of ids: which faces, corners or vertices are connected.

use crate::base::id::Id;

/// A forest of disjoint sets. The root of a set is its smallest member, so the order of unions does not change it.
#[derive(Debug, Clone)]
pub struct DisjointSets<I> {
    /// Of each member another one of its set, or itself.
    parents: Vec<I>,
}

impl<I: Id> DisjointSets<I> {
    /// `count` sets of one member each.
    pub fn new(count: usize) -> Self {
        Self { parents: (0..count).map(I::from).collect() }
    }

    /// The smallest member of the set of `member`; shortens the path on its way.
    pub fn root(&mut self, mut member: I) -> I {
        while self.parent(member) != member {
            let grandparent = self.parent(self.parent(member));
            self.parents[member.index()] = grandparent;
            member = grandparent;
        }
        member
    }

    /// Joins the sets of `a` and `b`.
    pub fn join(&mut self, a: I, b: I) {
        let (a, b) = (self.root(a), self.root(b));
        self.parents[a.max(b).index()] = a.min(b);
    }

    /// Whether `member` is the smallest of its set.
    pub fn is_root(&self, member: I) -> bool {
        self.parent(member) == member
    }

    /// Adds a set of one member, and returns that.
    pub fn add(&mut self) -> I {
        let member = I::from(self.parents.len());
        self.parents.push(member);
        member
    }

    /// The smallest member of each set.
    pub fn roots(&self) -> impl Iterator<Item = I> {
        self.parents
            .iter()
            .enumerate()
            .map(|(at, &parent)| (I::from(at), parent))
            .filter(|(a, b)| a == b)
            .map(|(a, _)| a)
    }

    fn parent(&self, member: I) -> I {
        self.parents[member.index()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::id::FaceId;

    #[test]
    fn the_root_is_the_smallest_member() {
        let mut sets = DisjointSets::<FaceId>::new(6);
        for (a, b) in [(5, 3), (4, 1), (3, 4)] {
            sets.join(FaceId::new(a), FaceId::new(b));
        }
        let roots: Vec<u32> = FaceId::first(6).map(|member| sets.root(member).number()).collect();
        assert_eq!(roots, [0, 1, 2, 1, 1, 1]);
        assert!(sets.is_root(FaceId::new(1)) && !sets.is_root(FaceId::new(3)));
        assert_eq!(sets.roots().map(FaceId::number).collect::<Vec<_>>(), [0, 1, 2]);
    }
}
