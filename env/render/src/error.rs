//! Errors of scenes, cameras and images; each variant is a sentence about the input.

use graspbox_mesh::{MeshError, OutOfRange};

/// Invalid input to the renderer.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
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
    BadLookAt { reason: &'static str },
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
    /// An image is requested twice.
    #[error("the observation `{name}` is named twice; name it once")]
    Twice {
        /// Name of the image.
        name: String,
    },
    /// An image is unknown.
    #[error(
        "there is no image {name:?}; give rgb, depth, rgbd, segmentation, amodal, points or voxels, alone or with one of the cameras \
         ({cameras}) as in depth_palm"
    )]
    UnknownImage {
        name: String,
        /// Names of the cameras.
        cameras: String,
    },
    /// The name of a camera is used twice or not plain.
    #[error("invalid camera name {name:?}; give each camera a unique name of lowercase letters and digits")]
    CameraName { name: String },
    /// A camera, an image or a model is invalid.
    #[error("{name}: {source}")]
    Named {
        /// Name of the camera, the image or the model.
        name: String,
        source: Box<RenderError>,
    },
}

impl RenderError {
    /// The same error with the name of the camera, the image or the model that it concerns.
    pub(crate) fn of(self, name: impl Into<String>) -> Self {
        Self::Named { name: name.into(), source: Box::new(self) }
    }
}
