//! How far a mesh is simplified.

use serde::{Deserialize, Serialize};

use crate::base::{Error, Result};

/// How far a mesh is simplified: to a number of triangles, or as far as a bound on the error allows. With both,
/// the run stops at the limit that it reaches first.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(into = "TargetFields", try_from = "TargetFields")]
pub struct Target {
    /// Triangles to keep; `None` for as few as the bound allows.
    pub faces: Option<FaceTarget>,
    /// Largest distance between result and input, both ways, in the mesh's unit of length; `None` for no bound.
    pub max_error: Option<f64>,
}

/// Triangles to keep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FaceTarget {
    /// This share of the input's triangles, above 0 and up to 1.
    Ratio(f64),
    /// This number of triangles, at least 1.
    Count(u64),
}

/// The fields as options and reports name them.
#[derive(Default, Serialize, Deserialize)]
#[serde(default)]
struct TargetFields {
    ratio: Option<f64>,
    faces: Option<u64>,
    max_error: Option<f64>,
}

impl From<Target> for TargetFields {
    fn from(target: Target) -> Self {
        let (ratio, faces) = match target.faces {
            Some(FaceTarget::Ratio(ratio)) => (Some(ratio), None),
            Some(FaceTarget::Count(count)) => (None, Some(count)),
            None => (None, None),
        };
        Self { ratio, faces, max_error: target.max_error }
    }
}

impl TryFrom<TargetFields> for Target {
    type Error = &'static str;

    fn try_from(fields: TargetFields) -> std::result::Result<Self, Self::Error> {
        let faces = match (fields.ratio, fields.faces) {
            (Some(_), Some(_)) => return Err("expected one of ratio and faces"),
            (Some(ratio), None) => Some(FaceTarget::Ratio(ratio)),
            (None, count) => count.map(FaceTarget::Count),
        };
        Ok(Self { faces, max_error: fields.max_error })
    }
}

impl Target {
    /// Keep this share of the triangles, above 0 and up to 1.
    pub fn ratio(ratio: f64) -> Self {
        Self { faces: Some(FaceTarget::Ratio(ratio)), max_error: None }
    }

    /// Keep this number of triangles, at least 1.
    pub fn faces(count: u64) -> Self {
        Self { faces: Some(FaceTarget::Count(count)), max_error: None }
    }

    /// Keep as few triangles as this bound on the error allows, in the mesh's unit of length; 0 removes only what
    /// changes nothing.
    pub fn max_error(length: f64) -> Self {
        Self { faces: None, max_error: Some(length) }
    }

    /// The same, and no farther than this bound on the error.
    #[must_use]
    pub fn within(self, length: f64) -> Self {
        Self { max_error: Some(length), ..self }
    }

    /// Whether nothing is asked for.
    pub fn is_none(self) -> bool {
        self == Self::default()
    }

    /// Triangles to keep of `triangles`, at least one; `None` if no number is asked for.
    pub fn count(self, triangles: u64) -> Option<u64> {
        self.faces.map(|faces| match faces {
            FaceTarget::Ratio(ratio) => ((ratio * triangles as f64).round() as u64).max(1),
            FaceTarget::Count(count) => count.min(triangles),
        })
    }

    /// Checks ranges.
    ///
    /// # Errors
    /// [`Error::Usage`] naming the option, what was found and what is accepted.
    pub fn check(self) -> Result<()> {
        match (self.faces, self.max_error) {
            (Some(FaceTarget::Ratio(ratio)), _) if !(ratio > 0.0 && ratio <= 1.0) => {
                Err(Error::Usage(format!("`ratio: {ratio}`: expected a share above 0 and up to 1")))
            }
            (Some(FaceTarget::Count(0)), _) => Err(Error::Usage("`faces: 0`: expected at least 1".into())),
            (_, Some(length)) if !(length >= 0.0 && length.is_finite()) => {
                Err(Error::Usage(format!("`max_error: {length}`: expected a length of 0 or more")))
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_share_is_rounded_and_never_empty() {
        assert_eq!(Target::ratio(0.1).count(248_438), Some(24_844));
        assert_eq!(Target::ratio(1e-9).count(248_438), Some(1));
        assert_eq!(Target::faces(50).count(20), Some(20));
        assert_eq!(Target::max_error(0.5).count(20), None);
    }

    #[test]
    fn ranges_are_kept() {
        for ratio in [0.0, -1.0, 1.5, f64::NAN] {
            assert!(Target::ratio(ratio).check().is_err(), "{ratio}");
        }
        for length in [-1.0, f64::NAN, f64::INFINITY] {
            assert!(Target::max_error(length).check().is_err(), "{length}");
            assert!(Target::ratio(0.5).within(length).check().is_err(), "{length}");
        }
        assert!(Target::faces(0).check().is_err());
        for target in [Target::ratio(1.0), Target::faces(1), Target::max_error(0.0), Target::default()] {
            assert!(target.check().is_ok(), "{target:?}");
        }
    }

    #[test]
    fn a_target_is_written_as_three_fields_and_read_back() {
        for target in [Target::ratio(0.5), Target::faces(7).within(0.25), Target::max_error(1.5), Target::default()] {
            let text = serde_json::to_string(&target).unwrap();
            assert_eq!(serde_json::from_str::<Target>(&text).unwrap(), target, "{text}");
        }
        assert_eq!(serde_json::to_string(&Target::faces(7)).unwrap(), r#"{"ratio":null,"faces":7,"max_error":null}"#);
        assert!(serde_json::from_str::<Target>(r#"{"ratio":0.5,"faces":7,"max_error":null}"#).is_err());
    }
}
