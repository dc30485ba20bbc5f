//! Errors of the planner; each variant is a sentence about the input.

use graspbox_mesh::OutOfRange;

/// An invalid input of the planner.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// Too few points, or all of them on one plane.
    #[error("{count} points span no volume; give at least 4 points that are not coplanar")]
    Degenerate {
        /// Number of points.
        count: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("point {index} is not finite; remove or repair it")]
    NotFinite {
        /// Index of the first such point.
        index: usize,
    },
    /// A parameter is out of range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// More candidates than a plan may have.
    #[error(
        "{boxes} boxes with {each} poses for every face, orientation and preshape are more than {limit} candidates; give fewer \
         `variations`, `standoffs` or `max_boxes`"
    )]
    TooMany {
        boxes: usize,
        /// Poses for each face, orientation and preshape.
        each: usize,
        /// Most candidates of a plan.
        limit: usize,
    },
    /// The planner does not support the hand.
    #[error("the hand {name:?} {reason}; see `[grasp]` in its hand.toml")]
    UnsupportedHand {
        /// Name of the hand.
        name: String,
        reason: &'static str,
    },
    /// The hand has a weight for an unknown term of the ranking.
    #[error(
        "the hand {hand:?} has a weight for {name:?}, which is not a term of the ranking; in `[grasp.ranking]` of its hand.toml name one of {known}"
    )]
    UnknownTerm {
        hand: String,
        /// The unknown term.
        name: String,
        /// The known terms.
        known: String,
    },
    /// The object's geometry cannot be prepared for collision queries.
    #[error("the object cannot be prepared for collision queries: {reason}; clean the mesh first")]
    Collision {
        /// The collision library's error.
        reason: String,
    },
}
