//! What a run repaired, dropped or noticed: counted by kind, with the first few places of each.

use std::borrow::Cow;
use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// How many places of one kind are told in words; the rest are counted.
const PLACES_PER_KIND: usize = 3;

/// Counted findings by kind; a kind is a fixed snake-case word such as `degenerate_faces`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Findings {
    kinds: BTreeMap<Cow<'static, str>, Finding>,
}

/// One kind of finding.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    /// How often it was met.
    pub count: u64,
    /// The first few, in words, escaped, with `file:line:` where known; none for plain counts.
    pub places: Vec<String>,
}

impl Findings {
    /// Counts `count` findings of a kind, without words.
    pub fn count(&mut self, kind: &'static str, count: u64) {
        if count > 0 {
            self.kinds.entry(kind.into()).or_default().count += count;
        }
    }

    /// Counts one finding and keeps its words if it is among the first of its kind.
    pub fn note(&mut self, kind: &'static str, place: impl FnOnce() -> String) {
        let finding = self.kinds.entry(kind.into()).or_default();
        finding.count += 1;
        if finding.places.len() < PLACES_PER_KIND {
            finding.places.push(place());
        }
    }

    /// Adds the findings of `other`, which came later.
    pub fn merge(&mut self, other: Findings) {
        for (kind, theirs) in other.kinds {
            let ours = self.kinds.entry(kind).or_default();
            ours.count += theirs.count;
            let room = PLACES_PER_KIND.saturating_sub(ours.places.len());
            ours.places.extend(theirs.places.into_iter().take(room));
        }
    }

    /// How often a kind was met.
    pub fn get(&self, kind: &str) -> u64 {
        self.kinds.get(kind).map_or(0, |finding| finding.count)
    }

    /// Every kind met, by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Finding)> {
        self.kinds.iter().map(|(kind, finding)| (kind.as_ref(), finding))
    }

    /// Whether all words are such as are noted, without control characters, for a value that was read back.
    pub fn are_plain(&self) -> bool {
        let words = self.iter().flat_map(|(kind, finding)| finding.places.iter().map(String::as_str).chain([kind]));
        words.flat_map(str::chars).all(|c| !c.is_control())
    }

    /// One line for each kind that has words: `degenerate_faces: 12 (city.obj:7: …; …)`.
    pub fn warnings(&self) -> Vec<String> {
        self.iter()
            .filter(|(_, finding)| !finding.places.is_empty())
            .map(|(kind, finding)| {
                let rest = finding.count.saturating_sub(finding.places.len() as u64);
                let more = if rest > 0 { format!("; and {rest} more") } else { String::new() };
                format!("{}: {}{more}", kind.replace('_', " "), finding.places.join("; "))
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_findings_are_counted_and_few_are_told() {
        let mut findings = Findings::default();
        for line in 0..5000 {
            findings.note("bad_texcoord_index", || format!("a.obj:{line}"));
        }
        assert_eq!(findings.get("bad_texcoord_index"), 5000);
        assert_eq!(findings.warnings(), ["bad texcoord index: a.obj:0; a.obj:1; a.obj:2; and 4997 more"]);
    }
}
