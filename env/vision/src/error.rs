//! Errors of cameras and images; each variant is a sentence about the input.

use graspbox_mesh::OutOfRange;

/// An error of cameras or images.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VisionError {
    /// An observation is requested twice.
    #[error("the observation `{name}` is named twice; name it once")]
    Twice {
        /// Its name.
        name: String,
    },
    /// An image is unknown.
    #[error(
        "there is no image {name:?}; give rgb, depth, rgbd, segmentation, amodal, points or voxels, alone or with one of the cameras \
         ({cameras}) as in depth_palm"
    )]
    UnknownImage {
        /// The value that was passed.
        name: String,
        /// Names of the cameras.
        cameras: String,
    },
    /// The name of a camera is used twice or not plain.
    #[error("invalid camera name {name:?}; give each camera a unique name of lowercase letters and digits")]
    CameraName {
        /// The value that was passed.
        name: String,
    },
    /// A camera, or a model to render, is invalid.
    #[error("{name}: {source}")]
    Camera {
        /// Name of the camera or the model.
        name: String,
        /// The error of the renderer.
        source: graspbox_camera::CameraError,
    },
    /// A setting is out of range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// The mesh cannot be used.
    #[error("object `{object}`: {source}")]
    Mesh {
        /// Name of the object.
        object: String,
        /// The error of the mesh code.
        source: graspbox_mesh::MeshError,
    },
}
