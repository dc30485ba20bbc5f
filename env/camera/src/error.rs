//! Every way a scene or a camera can be wrong; each variant is a sentence about the input.

use graspbox_mesh::MeshError;

/// What is wrong with the input of the renderer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
    /// A parameter lies outside its range.
    #[error("{name} = {value} is out of range; give a value in {range}")]
    OutOfRange {
        /// Name of the parameter.
        name: &'static str,
        /// What was given.
        value: f64,
        /// What is allowed.
        range: &'static str,
    },
    /// A pose is not a rigid motion with finite numbers, or leads farther than 10 km.
    #[error("the pose of {what} is not a finite rigid motion within 10 km; check its translation and quaternion")]
    BadPose {
        /// Whose pose.
        what: String,
    },
    /// The camera's axes cannot be made of these points.
    #[error("the camera cannot look from eye to target with this up: {reason}")]
    BadLookAt {
        /// What is wrong.
        reason: &'static str,
    },
    /// The scene holds more than the renderer can number.
    #[error("the scene has {count} instances; give at most {limit}")]
    TooManyInstances {
        /// How many there are.
        count: usize,
        /// How many there may be.
        limit: usize,
    },
    /// The mesh cannot be prepared.
    #[error("the mesh cannot be made ready for rendering: {0}")]
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
