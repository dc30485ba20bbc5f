//! Pinhole cameras.
//!
//! `u = fx x / z + cx` and `v = fy y / z + cy` with (x, y, z) in the camera's frame: +z forward, +x right, +y down.

use crate::error::RenderError;
use graspbox_mesh::in_range;
use nalgebra::{Isometry3, Matrix3, Point2, Point3, Rotation3, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::ops::Bound;

/// Largest coordinate of a pose, metres.
const FARTHEST: f64 = 1e4;

/// Image size, focal lengths and principal point, all in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Intrinsics {
    /// Columns, 1 to 4096.
    pub width: u32,
    /// Rows, 1 to 4096.
    pub height: u32,
    /// Focal length along u, pixels, in (0, 1e6].
    pub fx: f64,
    /// Focal length along v, pixels, in (0, 1e6].
    pub fy: f64,
    /// Column of the principal point, pixels from the left border, in [-1e6, 1e6].
    pub cx: f64,
    /// Row of the principal point, pixels from the upper border, in [-1e6, 1e6].
    pub cy: f64,
}

impl Intrinsics {
    /// Square pixels, the principal point in the middle, and a vertical field of view in [1e-4, 3.1] radians.
    ///
    /// # Errors
    /// [`RenderError::OutOfRange`].
    pub fn from_fov(width: u32, height: u32, vertical_fov: f64) -> Result<Self, RenderError> {
        in_range("vertical_fov", vertical_fov, 1e-4..=3.1, "rad")?;
        let f = 0.5 * f64::from(height) / (0.5 * vertical_fov).tan();
        let intrinsics = Self { width, height, fx: f, fy: f, cx: 0.5 * f64::from(width), cy: 0.5 * f64::from(height) };
        intrinsics.check()?;
        Ok(intrinsics)
    }

    /// Rows of the matrix (3, 3) that takes a camera-frame point to homogeneous image positions.
    pub fn matrix(&self) -> [f64; 9] {
        [self.fx, 0.0, self.cx, 0.0, self.fy, self.cy, 0.0, 0.0, 1.0]
    }

    /// # Errors
    /// [`RenderError::OutOfRange`] names the first field outside its range.
    pub fn check(&self) -> Result<(), RenderError> {
        for (name, size) in [("width", self.width), ("height", self.height)] {
            in_range(name, f64::from(size), 1.0..=4096.0, "pixels")?;
        }
        for (name, focal) in [("fx", self.fx), ("fy", self.fy)] {
            in_range(name, focal, 1e-6..=1e6, "pixels")?;
        }
        for (name, center) in [("cx", self.cx), ("cy", self.cy)] {
            in_range(name, center, -1e6..=1e6, "pixels")?;
        }
        Ok(())
    }

    #[must_use]
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Camera-frame point at image position (`u`, `v`) and depth `z` along the optical axis.
    #[must_use]
    pub fn unproject(&self, u: f64, v: f64, z: f64) -> Point3<f64> {
        Point3::new((u - self.cx) / self.fx * z, (v - self.cy) / self.fy * z, z)
    }
}

/// Projection of a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pixel {
    /// Image position in pixels; the upper left pixel covers [0, 1) x [0, 1).
    pub at: Point2<f64>,
    /// Depth along the optical axis, metres.
    pub depth: f64,
}

impl Pixel {
    /// Column and row of the pixel that contains it; `None` outside the image.
    #[must_use]
    pub fn index(&self, intrinsics: &Intrinsics) -> Option<[usize; 2]> {
        let inside = |x: f64, size: u32| (x >= 0.0 && x < f64::from(size)).then_some(x as usize);
        Some([inside(self.at.x, intrinsics.width)?, inside(self.at.y, intrinsics.height)?])
    }
}

/// A pinhole camera with a pose; always valid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    intrinsics: Intrinsics,
    world_from_camera: Isometry3<f64>,
    near: f64,
    far: f64,
}

impl Camera {
    /// Default near clipping depth, metres: the least distance of a palm camera. [`Camera::with_range`] changes it.
    pub const NEAR: f64 = 0.01;
    /// Default far clipping depth, metres.
    pub const FAR: f64 = 10.0;

    /// A camera that sees depths from [`Camera::NEAR`] to [`Camera::FAR`].
    ///
    /// # Errors
    /// [`RenderError::OutOfRange`] for the intrinsics, [`RenderError::BadPose`] for a pose that is not a finite rigid motion.
    pub fn new(intrinsics: Intrinsics, world_from_camera: Isometry3<f64>) -> Result<Self, RenderError> {
        intrinsics.check()?;
        check_pose(&world_from_camera, || "the camera".into())?;
        Ok(Self { intrinsics, world_from_camera, near: Self::NEAR, far: Self::FAR })
    }

    /// A camera at `eye` (world) with `target` in the middle of its view and `up` pointing to the upper border.
    ///
    /// # Errors
    /// Those of [`Camera::new`]; [`RenderError::BadLookAt`] if eye and target coincide (within 1 um), or if `up` is nearly
    /// parallel to the viewing direction.
    pub fn look_at(
        intrinsics: Intrinsics,
        eye: Point3<f64>,
        target: Point3<f64>,
        up: Vector3<f64>,
    ) -> Result<Self, RenderError> {
        let bad = |reason| RenderError::BadLookAt { reason };
        let forward = Unit::try_new(target - eye, 1e-6).ok_or(bad("they are the same point, or not finite"))?;
        let up = Unit::try_new(up, 1e-12).ok_or(bad("up is zero or not finite"))?;
        let right = Unit::try_new(forward.cross(&up), 1e-6).ok_or(bad("up is parallel to the view"))?;
        let axes = Matrix3::from_columns(&[*right, forward.cross(&right), *forward]);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        Self::new(intrinsics, Isometry3::from_parts(eye.into(), rotation))
    }

    /// The same camera with a depth range from `near` to `far`: `1e-4 <= near < far <= 1e4` metres.
    ///
    /// # Errors
    /// [`RenderError::OutOfRange`].
    pub fn with_range(self, near: f64, far: f64) -> Result<Self, RenderError> {
        in_range("near", near, 1e-4..=1e4, "m")?;
        in_range("far", far, (Bound::Excluded(near), Bound::Included(1e4)), "m")?;
        Ok(Self { near, far, ..self })
    }

    /// The same camera at another pose.
    ///
    /// # Errors
    /// [`RenderError::BadPose`].
    pub fn with_pose(self, world_from_camera: Isometry3<f64>) -> Result<Self, RenderError> {
        check_pose(&world_from_camera, || "the camera".into())?;
        Ok(Self { world_from_camera, ..self })
    }

    /// The same camera with other intrinsics; the caller ensures that they are valid.
    pub(crate) fn with_intrinsics(self, intrinsics: Intrinsics) -> Self {
        Self { intrinsics, ..self }
    }

    #[must_use]
    pub fn intrinsics(&self) -> &Intrinsics {
        &self.intrinsics
    }

    /// The pose.
    #[must_use]
    pub fn world_from_camera(&self) -> &Isometry3<f64> {
        &self.world_from_camera
    }

    /// Near clipping depth, metres.
    #[must_use]
    pub fn near(&self) -> f64 {
        self.near
    }

    /// Far clipping depth, metres.
    #[must_use]
    pub fn far(&self) -> f64 {
        self.far
    }

    /// Pose of an object in the camera's frame, from its pose in the world.
    #[must_use]
    pub fn camera_from_object(&self, world_from_object: &Isometry3<f64>) -> Isometry3<f64> {
        self.world_from_camera.inv_mul(world_from_object)
    }

    /// Projects a world point, inside the image or not; `None` outside the depth range.
    #[must_use]
    pub fn project(&self, world: &Point3<f64>) -> Option<Pixel> {
        let p = self.world_from_camera.inverse_transform_point(world);
        let k = &self.intrinsics;
        (self.near..=self.far)
            .contains(&p.z)
            .then(|| Pixel { at: Point2::new(k.fx * p.x / p.z + k.cx, k.fy * p.y / p.z + k.cy), depth: p.z })
    }

    /// World point at image position (`u`, `v`) and `depth` along the optical axis.
    #[must_use]
    pub fn unproject(&self, u: f64, v: f64, depth: f64) -> Point3<f64> {
        self.world_from_camera * self.intrinsics.unproject(u, v, depth)
    }
}

/// Checks that a pose is a finite rigid motion within 10 km; the error names its owner.
pub(crate) fn check_pose(pose: &Isometry3<f64>, what: impl FnOnce() -> String) -> Result<(), RenderError> {
    // NaN fails these comparisons.
    let rigid = (pose.rotation.coords.norm() - 1.0).abs() <= 1e-6;
    if rigid && pose.translation.vector.iter().all(|x| x.abs() <= FARTHEST) {
        return Ok(());
    }
    Err(RenderError::BadPose { what: what() })
}
