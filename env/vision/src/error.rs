//! What can be wrong with cameras and images; each variant is a sentence about the input.

/// What can be wrong with cameras and images.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum VisionError {
    /// An observation is asked for twice.
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
        /// What was given.
        name: String,
        /// Names of the cameras.
        cameras: String,
    },
    /// The name of a camera is taken or not plain.
    #[error("a camera cannot be called {name:?}; give each one a name of its own, of small letters and digits")]
    CameraName {
        /// What was given.
        name: String,
    },
    /// Something cannot be seen, or nothing can be seen with it.
    #[error("{name}: {source}")]
    Camera {
        /// The camera, or what is looked at.
        name: String,
        /// What the renderer said.
        source: graspbox_camera::CameraError,
    },
    /// A setting is out of its range.
    #[error("`{field}` is {value}, but it must be {expected}")]
    BadConfig {
        /// Name of the setting.
        field: &'static str,
        /// What was given.
        value: f64,
        /// What would be accepted.
        expected: &'static str,
    },
    /// The mesh could not be used.
    #[error("object `{object}`: {source}")]
    Mesh {
        /// Name of the object.
        object: String,
        /// What the mesh code said.
        source: graspbox_mesh::MeshError,
    },
}
