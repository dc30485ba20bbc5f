//! Errors of perception; each variant is a sentence about the input.

use graspbox_hand::HandError;
use graspbox_mesh::{MeshError, OutOfRange};
use graspbox_plan::PlanError;
use graspbox_render::RenderError;

/// An invalid input of perception.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PerceptionError {
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// The intrinsics or the pose of a camera are invalid.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// A mesh cannot be voxelized.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A preshape beyond the hand's limits.
    #[error(transparent)]
    Hand(#[from] HandError),
    /// The planner's box decomposition refuses points.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// The number of cells along an axis of a hand's grid is not usable.
    #[error("shape[{axis}] is {cells}; give a multiple of {multiple}, at most {most}")]
    GridShape {
        axis: usize,
        cells: usize,
        /// It is a multiple of this.
        multiple: usize,
        /// Greatest number.
        most: usize,
    },
    /// The hand has no chain that closes.
    #[error("no chain of the hand {name:?} closes; name its closing actuators in `[grasp]` of its hand.toml")]
    NothingCloses {
        /// Name of the hand.
        name: String,
    },
}
