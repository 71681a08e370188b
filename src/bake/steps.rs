//! The steps of a bake, by which a work folder knows them.

use crate::job::StepKey;
use crate::model::id::ImageId;
use crate::partition::ClusterId;

/// Step that keeps the surface of the input.
pub const SURFACE: StepKey = StepKey::fixed("bake-surface");
/// Step that cuts the result into patches.
pub(super) const PATCHES: StepKey = StepKey::fixed("bake-patches");

/// A step of a bake.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum BakeStep {
    /// The surface of the input is kept.
    Surface,
    /// An image of the input is decoded.
    Image(ImageId),
    /// The result is cut into patches.
    Patches,
    /// A patch is baked.
    Patch(ClusterId),
    /// Patches among some are baked by another process.
    Several {
        /// The first.
        first: ClusterId,
        /// How many there are to the last one.
        count: u32,
    },
}

impl BakeStep {
    /// What the keys of steps begin with that record patches which another process baked.
    pub const PREFIX_OF_PATCHES: &str = "bake-textures";

    /// Its key.
    pub fn key(self) -> StepKey {
        match self {
            Self::Surface => SURFACE,
            Self::Image(image) => StepKey::numbered(format!("bake-image-{:06}", image.number())),
            Self::Patches => PATCHES,
            Self::Patch(cluster) => StepKey::numbered(format!("bake-texture-{:06}", cluster.number())),
            Self::Several { first, count } => {
                StepKey::numbered(format!("{}-{:06}-{count}", Self::PREFIX_OF_PATCHES, first.number()))
            }
        }
    }

    /// The step of a key; `None` for a key of anything else.
    pub fn of(key: &StepKey) -> Option<Self> {
        let numbers = |rest: &str| {
            let (first, count) = rest.split_once('-')?;
            first.parse().ok().zip(count.parse().ok())
        };
        let number = |prefix| key.name().strip_prefix(prefix)?.parse::<u32>().ok();
        let step = if let Some(image) = number("bake-image-") {
            Self::Image(ImageId::new(image))
        } else if let Some(patch) = number("bake-texture-") {
            Self::Patch(ClusterId::new(patch))
        } else if let Some((first, count)) = key.name().strip_prefix("bake-textures-").and_then(numbers) {
            Self::Several { first: ClusterId::new(first), count }
        } else if *key == SURFACE {
            Self::Surface
        } else {
            Self::Patches
        };
        (step.key() == *key).then_some(step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_names_its_step() {
        for step in [
            BakeStep::Surface,
            BakeStep::Image(ImageId::new(3)),
            BakeStep::Patches,
            BakeStep::Patch(ClusterId::new(12_345_678)),
            BakeStep::Several { first: ClusterId::new(7), count: 20 },
        ] {
            assert_eq!(BakeStep::of(&step.key()), Some(step));
        }
        for other in ["bake-image-3", "bake-texture-", "bake-textures-1", "bake", "scan-mesh", "pass-0-mesh"] {
            assert_eq!(BakeStep::of(&StepKey::fixed(other)), None);
        }
    }
}
