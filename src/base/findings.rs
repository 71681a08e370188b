//! What a run repaired, dropped or noticed: counted by kind, with the first places of each.

use std::borrow::Cow;
use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// Largest number of places described per kind; further ones are only counted.
pub const PLACES_PER_KIND: usize = 100;
/// Kinds whose places are all listed. Their number is at most that of materials and textures, which the memory budget
/// bounds.
const LISTED_KINDS: [&str; 2] = ["lost_materials", "lost_textures"];

/// Counted findings by kind. A kind is a fixed snake-case word such as `degenerate_faces`.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Findings {
    kinds: BTreeMap<Cow<'static, str>, Finding>,
}

/// One kind of finding.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Finding {
    /// Number of findings.
    pub count: u64,
    /// Descriptions of the first few, escaped, with `file:line:` if known; empty for plain counts.
    pub places: Vec<String>,
}

impl Findings {
    /// Adds `count` findings of a kind, without descriptions.
    pub fn count(&mut self, kind: &'static str, count: u64) {
        if count > 0 {
            self.kinds.entry(kind.into()).or_default().count += count;
        }
    }

    /// Adds one finding, and keeps its description if it is among the first of its kind.
    pub fn note(&mut self, kind: &'static str, place: impl FnOnce() -> String) {
        let finding = self.kinds.entry(kind.into()).or_default();
        finding.count += 1;
        if finding.places.len() < places_max(kind) {
            finding.places.push(place());
        }
    }

    /// Adds the findings of `other`, which come later.
    pub fn merge(&mut self, other: Findings) {
        for (kind, theirs) in other.kinds {
            let most = places_max(&kind);
            let ours = self.kinds.entry(kind).or_default();
            ours.count += theirs.count;
            let room = most.saturating_sub(ours.places.len());
            ours.places.extend(theirs.places.into_iter().take(room));
        }
    }

    /// Number of findings of a kind.
    pub fn get(&self, kind: &str) -> u64 {
        self.kinds.get(kind).map_or(0, |finding| finding.count)
    }

    /// All findings, sorted by kind.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Finding)> {
        self.kinds.iter().map(|(kind, finding)| (kind.as_ref(), finding))
    }

    /// Reports whether recalled descriptions are free of control characters.
    pub fn are_plain(&self) -> bool {
        let words = self.iter().flat_map(|(kind, finding)| finding.places.iter().map(String::as_str).chain([kind]));
        words.flat_map(str::chars).all(|c| !c.is_control())
    }

    /// Lists the described places of each kind, one per line, and how many more there are: `degenerate faces:
    /// city.obj:7: …`.
    pub fn warnings(&self) -> Vec<String> {
        let mut lines = Vec::new();
        for (kind, finding) in self.iter().filter(|(_, finding)| !finding.places.is_empty()) {
            let kind = kind.replace('_', " ");
            lines.extend(finding.places.iter().map(|place| format!("{kind}: {place}")));
            match finding.count.saturating_sub(finding.places.len() as u64) {
                0 => {}
                rest => lines.push(format!("{kind}: and {rest} more")),
            }
        }
        lines
    }
}

/// Largest number of places described for a kind.
fn places_max(kind: &str) -> usize {
    if LISTED_KINDS.contains(&kind) { usize::MAX } else { PLACES_PER_KIND }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lost_materials_and_textures_are_listed_in_full() {
        for kind in LISTED_KINDS {
            let (mut findings, mut all) = (Findings::default(), Findings::default());
            (0..1000).for_each(|number| findings.note(kind, || format!("'m{number}' is on no face")));
            all.merge(findings.clone());
            all.merge(findings);
            let lines = all.warnings();
            assert!(lines.len() == 2000 && lines[1999].contains("m999"), "{}", lines.len());
        }
    }

    #[test]
    fn many_findings_are_counted_and_few_are_told() {
        let mut findings = Findings::default();
        for line in 0..5000 {
            findings.note("bad_texcoord_index", || format!("a.obj:{line}"));
        }
        assert_eq!(findings.get("bad_texcoord_index"), 5000);
        let lines = findings.warnings();
        assert_eq!(lines[0], "bad texcoord index: a.obj:0");
        assert_eq!(lines[PLACES_PER_KIND], format!("bad texcoord index: and {} more", 5000 - PLACES_PER_KIND));
        assert_eq!(lines.len(), PLACES_PER_KIND + 1);
    }
}
