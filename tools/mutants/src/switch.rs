//! The switches of one file, and its text with all of them built in.
//!
//! ```text
//! a < b      becomes      (if crate::mutant::on(17) {(a) <= (b)} else {a < b})
//! f(x)?;     becomes      if crate::mutant::on(18) {} else {f(x)?;}
//! ```
//! Switches nest in the last branch only: one mutant at a time is on, so the other branches hold the text as it was.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

/// What stands in the place of an expression or a statement when one mutant is on.
#[derive(Debug)]
pub struct Variant {
    pub mutant: usize,
    pub text: String,
}

/// A place in the source, as a range of bytes; a longer range comes before those that it contains.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    pub start: usize,
    pub end: usize,
    /// A whole statement with its semicolon, not an expression.
    pub is_statement: bool,
}

impl Ord for Place {
    fn cmp(&self, other: &Self) -> std::cmp::Ordering {
        let key = |p: &Self| (p.start, usize::MAX - p.end, !p.is_statement);
        key(self).cmp(&key(other))
    }
}

impl PartialOrd for Place {
    fn partial_cmp(&self, other: &Self) -> Option<std::cmp::Ordering> {
        Some(self.cmp(other))
    }
}

/// The switches of a file.
pub type Switches = BTreeMap<Place, Vec<Variant>>;

/// A file with its switches built in.
#[derive(Debug, Default)]
pub struct Switched {
    pub text: String,
    /// Ranges of `text` that exist because of some mutants: each branch, then the switch as a whole.
    regions: Vec<(Range<usize>, Vec<usize>)>,
}

impl Switched {
    /// Builds all switches into `source`, but for the mutants that are left out.
    pub fn new(source: &str, switches: &Switches, left_out: &BTreeSet<usize>) -> Self {
        let mut switched = Self::default();
        let kept: Vec<_> = switches
            .iter()
            .map(|(place, variants)| (*place, variants.iter().filter(|v| !left_out.contains(&v.mutant)).collect()))
            .filter(|(_, variants): &(Place, Vec<&Variant>)| !variants.is_empty())
            .collect();
        switched.append(source, 0..source.len(), &kept);
        switched
    }

    /// Appends a range of the source; `switches` are those inside it.
    fn append(&mut self, source: &str, range: Range<usize>, mut switches: &[(Place, Vec<&Variant>)]) {
        let mut done = range.start;
        while let [(place, variants), rest @ ..] = switches {
            let inner_count = rest.iter().take_while(|(inner, _)| inner.start < place.end).count();
            let (inner, after) = rest.split_at(inner_count);
            self.text.push_str(&source[done..place.start]);
            let start = self.text.len();
            self.text.push_str(if place.is_statement { "" } else { "(" });
            for variant in variants {
                self.text.push_str(&format!("if crate::mutant::on({}) {{", variant.mutant));
                let start = self.text.len();
                self.text.push_str(&variant.text);
                self.regions.push((start..self.text.len() + 1, vec![variant.mutant]));
                self.text.push_str("} else ");
            }
            self.text.push('{');
            self.append(source, place.start..place.end, inner);
            self.text.push_str(if place.is_statement { "}" } else { "})" });
            self.regions.push((start..self.text.len(), variants.iter().map(|v| v.mutant).collect()));
            (done, switches) = (place.end, after);
        }
        self.text.push_str(&source[done..range.end]);
    }

    /// The mutants of the smallest region around a byte of the text; none where the text is as it was.
    pub fn mutants_at(&self, offset: usize) -> Vec<usize> {
        let around = self.regions.iter().filter(|(range, _)| range.contains(&offset));
        around.min_by_key(|(range, _)| range.len()).map_or(Vec::new(), |(_, mutants)| mutants.clone())
    }

    /// The mutants of all regions inside a range of the text.
    pub fn mutants_in(&self, around: Range<usize>) -> Vec<usize> {
        let inside = self.regions.iter().filter(|(range, _)| around.start <= range.start && range.end <= around.end);
        inside.flat_map(|(_, mutants)| mutants.clone()).collect()
    }
}
