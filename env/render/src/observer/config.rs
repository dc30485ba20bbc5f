//! Cameras in the world and on the hand, and the images they take.

use crate::{Camera, Intrinsics, RenderError};
use graspbox_mesh::in_range;
use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Most cameras of a pool.
const MOST_CAMERAS: f64 = 16.0;

/// The body to which a camera is attached.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Mount {
    /// Fixed in the world.
    #[default]
    World,
    /// Fixed to the palm; poses are in the grasp frame (z out of the palm).
    Hand,
}

/// One camera; lengths in metres, in the frame of its mount.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CameraConfig {
    /// Small letters and digits, as in `depth_palm`.
    pub name: String,
    /// The body to which it is attached.
    pub mount: Mount,
    /// Position.
    pub eye: [f64; 3],
    /// The point in the middle of its image.
    pub target: [f64; 3],
    /// The direction that points up in its image.
    pub up: [f64; 3],
    /// Vertical field of view, radians, in [1e-4, 3.1].
    pub fov: f64,
    /// Near clipping depth, metres.
    pub near: f64,
    /// Far clipping depth, metres.
    pub far: f64,
}

impl Default for CameraConfig {
    /// The camera `front`.
    fn default() -> Self {
        Self::front()
    }
}

impl CameraConfig {
    /// In front of the workspace, 0.55 m from its middle, looking down at 40 degrees.
    #[must_use]
    pub fn front() -> Self {
        Self {
            name: "front".into(),
            mount: Mount::World,
            eye: [-0.421, 0.0, 0.413],
            target: [0.0, 0.0, 0.06],
            up: [0.0, 0.0, 1.0],
            fov: 0.5,
            near: 0.02,
            far: 2.0,
        }
    }

    /// On a bracket next to the palm, looking between the fingers at the grasped object.
    #[must_use]
    pub fn palm() -> Self {
        Self {
            name: "palm".into(),
            mount: Mount::Hand,
            eye: [0.0, 0.075, 0.0],
            target: [0.0, 0.0, 0.09],
            up: [-1.0, 0.0, 0.0],
            fov: 1.3,
            near: 0.02,
            far: 2.0,
        }
    }

    /// For pictures: from the side; hand and object fill them from the start of an episode until the object is lifted.
    #[must_use]
    pub fn viewer() -> Self {
        Self {
            name: "viewer".into(),
            mount: Mount::World,
            eye: [-0.6, -0.8, 0.72],
            target: [0.0, 0.0, 0.24],
            up: [0.0, 0.0, 1.0],
            fov: 0.56,
            near: 0.02,
            far: 30.0,
        }
    }

    /// The camera with its pose in the frame of its mount; images of `height` x `width` pixels.
    ///
    /// # Errors
    /// [`RenderError::Named`], naming the camera.
    pub fn camera(&self, height: u32, width: u32) -> Result<Camera, RenderError> {
        let make = || {
            let intrinsics = Intrinsics::from_fov(width, height, self.fov)?;
            let (eye, target) = (Point3::from(self.eye), Point3::from(self.target));
            Camera::look_at(intrinsics, eye, target, Vector3::from(self.up))?.with_range(self.near, self.far)
        };
        make().map_err(|error: RenderError| error.of(self.name.as_str()))
    }
}

/// Cameras and images of every environment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CamerasConfig {
    /// Names of the images, `kind` or `kind_camera`: see [`ImageSpec`](crate::ImageSpec).
    pub images: Vec<String>,
    /// Rows and columns of every image.
    pub image_size: [u32; 2],
    /// The cameras; the first one takes the images that name none.
    pub cameras: Vec<CameraConfig>,
    /// Whether hand and object cast shadows in colour images.
    pub shadows: bool,
    /// Voxels along each side of the `voxels` grid, 1 to 256.
    pub voxels: usize,
    /// Side of that grid, metres, in [0.01, 10]; it is centred over the table, whose top bisects the lowest layer.
    pub voxel_side: f64,
}

impl Default for CamerasConfig {
    fn default() -> Self {
        Self {
            images: Vec::new(),
            image_size: [64, 64],
            cameras: vec![CameraConfig::front(), CameraConfig::palm()],
            shadows: true,
            voxels: 32,
            voxel_side: 0.4,
        }
    }
}

impl CamerasConfig {
    /// The cameras, posed in the frame of their mount.
    ///
    /// # Errors
    /// [`RenderError`] for an invalid camera, a name that is empty, not plain or used twice, no camera, or more than 16.
    pub fn mounted_cameras(&self) -> Result<Vec<Camera>, RenderError> {
        in_range("number of cameras", self.cameras.len() as f64, 1.0..=MOST_CAMERAS, "")?;
        for (i, camera) in self.cameras.iter().enumerate() {
            let name = &camera.name;
            let plain = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit();
            if name.is_empty() || !name.chars().all(plain) || self.cameras[..i].iter().any(|c| c.name == *name) {
                return Err(RenderError::CameraName { name: name.clone() });
            }
        }
        let [height, width] = self.image_size;
        self.cameras.iter().map(|c| c.camera(height, width)).collect()
    }
}

/// Pose in the world of a camera with pose `parent_from_camera` in the frame of its mount; `hand` is the pose of the grasp frame.
#[must_use]
pub fn world_from_camera(mount: Mount, parent_from_camera: &Isometry3<f64>, hand: &Isometry3<f64>) -> Isometry3<f64> {
    match mount {
        Mount::World => *parent_from_camera,
        Mount::Hand => hand * parent_from_camera,
    }
}
