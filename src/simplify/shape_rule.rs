//! How strictly collapses keep the shapes of faces.

/// What the faces that a collapse changes must not do, from the strictest rule to the weakest.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum ShapeRule {
    /// Turn over, become a sliver, span empty space, or fold onto another face.
    #[default]
    Strict,
    /// Turn over, become a sliver, or span empty space.
    MayFold,
    /// Span empty space, or lose all their area. Faces may also run along a common edge in the same direction.
    MayTurn,
}

impl ShapeRule {
    /// The next weaker rule; `None` if there is none.
    pub fn weaker(self) -> Option<Self> {
        match self {
            ShapeRule::Strict => Some(ShapeRule::MayFold),
            ShapeRule::MayFold => Some(ShapeRule::MayTurn),
            ShapeRule::MayTurn => None,
        }
    }
}
