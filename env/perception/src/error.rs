//! Every way an input can be wrong; each variant is a sentence about it.

use graspbox_camera::CameraError;
use graspbox_hand::HandError;
use graspbox_mesh::{MeshError, OutOfRange};
use graspbox_plan::PlanError;

/// What is wrong with an input of perception.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PerceptionError {
    /// A number lies outside its range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// The lens or the pose of a camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// A mesh that cannot be voxelized.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A hand whose kinematics refuse a preshape.
    #[error(transparent)]
    Hand(#[from] HandError),
    /// Points that the planner's box decomposition refuses.
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// A hand without a part that closes.
    #[error("no chain of the hand {name:?} closes; name its closing actuators in `[grasp]` of its hand.toml")]
    NothingCloses {
        /// Name of the hand.
        name: String,
    },
}
