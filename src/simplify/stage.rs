//! Stop rules and results of stages.

/// When a stage ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stop {
    /// When at most this many faces are left.
    Faces(usize),
    /// When no legal collapse costs this or less, or when at most this many faces are left.
    Cost(f32, usize),
}

/// Result of a stage.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StageResult {
    /// Highest cost of a collapse.
    pub cost: f32,
    /// Whether the stop was reached before the legal collapses ran out.
    pub reached: bool,
}

impl StageResult {
    /// The result of a stage that was continued, with `next` as the result of the rest.
    pub fn then(self, next: Self) -> Self {
        Self { cost: self.cost.max(next.cost), ..next }
    }
}

/// A collapse in the log of a stage.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LoggedCollapse {
    /// Its cost.
    pub cost: f32,
    /// Faces left after it.
    pub faces: u32,
}

/// State of a cluster at the end of a stage.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Milestone {
    /// Faces left.
    pub faces: usize,
    /// Highest cost of a collapse in the stage.
    pub cost: f32,
    /// Estimate of the mean squared deviation that all stages so far have added, in units of length².
    pub squared_error: f64,
}
