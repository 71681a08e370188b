//! Disjoint sets over 0 .. n: which faces, corners or vertices are connected.

/// A forest of disjoint sets. The root of a set is its smallest member, so the order of unions does not change it.
#[derive(Debug, Clone)]
pub struct DisjointSets {
    parents: Vec<u32>,
}

impl DisjointSets {
    /// `count` sets of one member each.
    pub fn new(count: usize) -> Self {
        Self { parents: (0..count as u32).collect() }
    }

    /// The smallest member of the set of `member`; shortens the path on its way.
    pub fn root(&mut self, mut member: u32) -> u32 {
        while self.parents[member as usize] != member {
            let grandparent = self.parents[self.parents[member as usize] as usize];
            self.parents[member as usize] = grandparent;
            member = grandparent;
        }
        member
    }

    /// Joins the sets of `a` and `b`.
    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parents[a.max(b) as usize] = a.min(b);
    }

    /// Whether `member` is the smallest of its set.
    pub fn is_root(&self, member: u32) -> bool {
        self.parents[member as usize] == member
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_root_is_the_smallest_member() {
        let mut sets = DisjointSets::new(6);
        sets.join(5, 3);
        sets.join(4, 1);
        sets.join(3, 4);
        assert_eq!((0..6).map(|i| sets.root(i)).collect::<Vec<_>>(), [0, 1, 2, 1, 1, 1]);
        assert!(sets.is_root(1) && !sets.is_root(3));
    }
}
