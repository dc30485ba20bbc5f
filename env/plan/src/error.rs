//! Every way a plan can be asked for wrongly; each variant is a sentence about the input.

use graspbox_mesh::OutOfRange;

/// What is wrong with the input of the planner.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PlanError {
    /// Too few points, or all of them on one plane.
    #[error("{count} points span no volume; give at least 4 points that are not on one plane")]
    Degenerate {
        /// How many points there were.
        count: usize,
    },
    /// A coordinate is NaN or infinite.
    #[error("point {index} is not finite; drop or repair it")]
    NotFinite {
        /// Index of the first such point.
        index: usize,
    },
    /// A parameter lies outside its range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// More candidates than a plan may have.
    #[error(
        "{boxes} boxes with {each} poses for every face, turn and preshape are more than {limit} candidates; give fewer \
         `variations`, `standoffs` or `max_boxes`"
    )]
    TooMany {
        /// Boxes to grasp.
        boxes: usize,
        /// Poses for each face, turn and preshape.
        each: usize,
        /// Most candidates of a plan.
        limit: usize,
    },
    /// The hand cannot be planned for.
    #[error("the hand {name:?} {reason}; see `[grasp]` in its hand.toml")]
    UnsupportedHand {
        /// Name of the hand.
        name: String,
        /// What it lacks.
        reason: &'static str,
    },
    /// The hand gives a weight to a term that the ranking does not have.
    #[error(
        "the hand {hand:?} weighs {name:?}, which is no term of the ranking; in `[grasp.ranking]` of its hand.toml name one of {known}"
    )]
    UnknownTerm {
        /// Name of the hand.
        hand: String,
        /// The unknown term.
        name: String,
        /// The terms that there are.
        known: String,
    },
    /// The object's geometry could not be prepared for collision queries.
    #[error("the object cannot be prepared for collision queries: {reason}; clean the mesh first")]
    Collision {
        /// What the collision library said.
        reason: String,
    },
}
