//! What can be wrong with cameras and images; each variant is a sentence about the input.

use graspbox_mesh::OutOfRange;

/// What can be wrong with cameras and images.
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
        "there is no image {name:?}; give rgb, depth, rgbd, segmentation, points or voxels, alone or with one of the cameras \
         ({cameras}) as in depth_palm"
    )]
    UnknownImage {
        /// The value given.
        name: String,
        /// Names of the cameras.
        cameras: String,
    },
    /// The name of a camera is used twice or not plain.
    #[error("invalid camera name {name:?}; give each camera a unique name of lowercase letters and digits")]
    CameraName {
        /// The value given.
        name: String,
    },
    /// A camera, or something to be rendered, is invalid.
    #[error("{name}: {source}")]
    Camera {
        /// The camera, or what is rendered.
        name: String,
        /// The error of the renderer.
        source: graspbox_camera::CameraError,
    },
    /// A setting is out of its range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// The mesh could not be used.
    #[error("object `{object}`: {source}")]
    Mesh {
        /// Name of the object.
        object: String,
        /// The error of the mesh code.
        source: graspbox_mesh::MeshError,
    },
}
