//! Errors in scenes and cameras; each variant is a sentence about the input.

use graspbox_mesh::MeshError;

/// Invalid input to the renderer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
    /// A parameter lies outside its range.
    #[error("{name} = {value} is out of range; give a value in {range}")]
    OutOfRange {
        /// Name of the parameter.
        name: &'static str,
        /// The value given.
        value: f64,
        /// The accepted values.
        range: &'static str,
    },
    /// A pose is not a finite rigid motion within 10 km.
    #[error("the pose of {what} is not a finite rigid motion within 10 km; check its translation and quaternion")]
    BadPose {
        /// The owner of the pose.
        what: String,
    },
    /// Eye, target and up do not define a view.
    #[error("the camera cannot look from eye to target with this up: {reason}")]
    BadLookAt {
        /// What is wrong.
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

/// `value` if it lies in `[low, high]`, or the error that says so.
pub(crate) fn in_range(
    name: &'static str,
    value: f64,
    low: f64,
    high: f64,
    range: &'static str,
) -> Result<(), CameraError> {
    if (low..=high).contains(&value) { Ok(()) } else { Err(CameraError::OutOfRange { name, value, range }) }
}
