//! Why edges do not collapse.

/// Why an edge did not collapse.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Refusal {
    /// The surface would change its topology: pinch, close a hole, or double a face.
    Topology,
    /// The last face of a connected component or of a large part would vanish, or too many faces would die at once.
    Piece,
    /// A seam would be torn off its chart.
    Seam,
    /// The check needs faces that another cluster has.
    Rim,
    /// A face would fold over, become a needle, or span empty space.
    Fold,
    /// A texture triangle would change its sign or degenerate.
    UvFold,
    /// The surface would deviate from the input by more than allowed.
    Deviation,
}

impl Refusal {
    /// Number of kinds of refusals.
    pub const COUNT: usize = 7;
}
