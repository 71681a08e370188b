//! The next proposals of vertices whose cheapest collapse was refused.
//!
//! A vertex at which many surfaces meet has dozens of edges, and often most of them may not collapse. Pricing all of
//! them again after each refusal would take the square of their number.

use std::collections::HashMap;

use crate::mesh::id::LocalVertex;
use crate::simplify::proposal::{Bid, Proposal};

/// Largest number of proposals kept for a vertex.
const KEPT_MAX: usize = 8;

/// The next proposals of some vertices.
#[derive(Debug, Default)]
pub struct Alternatives(HashMap<LocalVertex, Cheapest>);

impl Alternatives {
    /// Forgets all proposals.
    pub fn clear(&mut self) {
        self.0.clear();
    }

    /// Takes the next proposal of a vertex; if none is left, those that `gather` returns follow.
    pub fn next(&mut self, vertex: LocalVertex, gather: impl FnOnce() -> Cheapest) -> Option<Proposal> {
        let known = self.0.entry(vertex).or_default();
        if known.proposals.is_empty() {
            *known = gather();
        }
        known.proposals.pop()
    }
}

/// The cheapest proposals of a vertex above a key.
#[derive(Debug)]
pub struct Cheapest {
    /// The costliest first.
    proposals: Vec<Proposal>,
    after: Bid,
}

impl Default for Cheapest {
    fn default() -> Self {
        Self::above(Bid::LOWEST)
    }
}

impl Cheapest {
    /// No proposals yet; takes those above the key `after`.
    pub fn above(after: Bid) -> Self {
        Self { proposals: Vec::new(), after }
    }

    /// Whether a proposal with this key would be kept.
    pub fn has_room(&self, key: Bid) -> bool {
        self.proposals.len() < KEPT_MAX || key < self.proposals[0].key()
    }

    /// Adds a proposal, unless its cost is infinite, or it is not among the cheapest above the key.
    pub fn add(&mut self, proposal: Proposal) {
        let key = proposal.key();
        if !proposal.cost.is_finite() || key <= self.after || !self.has_room(key) {
            return;
        }
        let at = self.proposals.partition_point(|kept| kept.key() > key);
        self.proposals.insert(at, proposal);
        if self.proposals.len() > KEPT_MAX {
            self.proposals.remove(0);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::mesh::id::short::v;

    proptest! {
        #[test]
        fn each_proposal_comes_once_in_the_order_of_cost(costs in prop::collection::vec(0u8..40, 0..60)) {
            let offers = || (1u32..).zip(&costs).map(|(to, &cost)| Proposal::onto(v(to), f32::from(cost)));
            let mut expected: Vec<Bid> = offers().map(|proposal| proposal.key()).collect();
            expected.sort_unstable();
            let mut alternatives = Alternatives::default();
            let mut after = Bid::LOWEST;
            let next = || {
                let gather = || {
                    let mut cheapest = Cheapest::above(after);
                    offers().for_each(|proposal| cheapest.add(proposal));
                    cheapest
                };
                let proposal = alternatives.next(v(7), gather)?;
                after = proposal.key();
                Some(after)
            };
            prop_assert_eq!(std::iter::from_fn(next).collect::<Vec<_>>(), expected);
        }
    }

    #[test]
    fn what_costs_infinity_is_no_proposal() {
        let mut cheapest = Cheapest::default();
        cheapest.add(Proposal::onto(v(1), f32::INFINITY));
        assert!(Alternatives::default().next(v(0), || cheapest).is_none());
    }
}
