//! Errors in scenes and cameras; each variant is a sentence about the input.

use graspbox_mesh::{MeshError, OutOfRange};

/// Invalid input to the renderer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
    /// A parameter is out of range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// A pose is not a finite rigid motion within 10 km.
    #[error("the pose of {what} is not a finite rigid motion within 10 km; check its translation and quaternion")]
    BadPose {
        /// The owner of the pose.
        what: String,
    },
    /// Eye, target and up do not define a view.
    #[error("the camera cannot look from eye to target with this up: {reason}")]
    BadLookAt {
        /// The reason.
        reason: &'static str,
    },
    /// The scene has more instances than the renderer supports.
    #[error("the scene has {count} instances; give at most {limit}")]
    TooManyInstances {
        /// Number of instances.
        count: usize,
        /// Largest number supported.
        limit: usize,
    },
    /// The mesh cannot be prepared.
    #[error("the mesh cannot be prepared for rendering: {0}")]
    Mesh(#[from] MeshError),
}
