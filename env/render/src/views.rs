//! Cameras around an object.
//!
//! Each camera is on a spherical cap around the object, upright and aimed at its middle, and may then be shifted.

use crate::error::RenderError;
use crate::{Camera, Intrinsics};
use graspbox_mesh::in_range;
use graspbox_mesh::sample::GOLDEN_ANGLE;
use nalgebra::{Point3, Rotation3, Translation3, Unit, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// Largest number of views of one plan.
const MOST_VIEWS: usize = 1_000_000;

/// Distribution of directions over the cap.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pattern {
    /// Evenly by area, along a spiral from the middle of the cap outward; the same for every seed.
    Grid,
    /// At random, uniform by area.
    Random,
}

/// Distribution of cameras around an object.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ViewPlan {
    /// Distribution of directions.
    pub pattern: Pattern,
    /// Direction from the object to the middle of the cap, in the world; of any length.
    pub axis: Vector3<f64>,
    /// Angle from the middle of the cap to its border, radians, in [0, pi].
    pub cap: f64,
    /// Least and greatest distance from the target, uniform, metres, in [0.01, 100].
    pub distance: [f64; 2],
    /// Largest shift of the camera along each world axis, uniform, metres, in [0, 10]; its direction stays.
    pub shift: f64,
    /// World direction that points up in the images.
    pub up: Vector3<f64>,
}

impl Default for ViewPlan {
    /// [`ViewPlan::study`].
    fn default() -> Self {
        Self::study()
    }
}

impl ViewPlan {
    /// The views of the reference study ("the study" in this package; the README names it): 0.7 m away, within 15 degrees and 5 cm of one
    /// pose. The study does not state that pose; this one looks down at 45 degrees.
    #[must_use]
    pub fn study() -> Self {
        Self {
            pattern: Pattern::Random,
            axis: Vector3::new(-1.0, 0.0, 1.0),
            cap: 15_f64.to_radians(),
            distance: [0.7, 0.7],
            shift: 0.05,
            up: Vector3::z(),
        }
    }

    /// # Errors
    /// [`RenderError::OutOfRange`] names the first field outside its range.
    pub fn check(&self) -> Result<(), RenderError> {
        for (name, v) in [("length of axis", &self.axis), ("length of up", &self.up)] {
            in_range(name, v.norm(), 1e-6..=1e6, "")?;
        }
        in_range("cap", self.cap, 0.0..=PI, "rad")?;
        in_range("distance[0]", self.distance[0], 0.01..=100.0, "m")?;
        in_range("distance[1]", self.distance[1], self.distance[0]..=100.0, "m")?;
        Ok(in_range("shift", self.shift, 0.0..=10.0, "m")?)
    }
}

/// `count` cameras around `target` (world) by `plan`. The result is a function of the arguments; with [`Pattern::Random`] the first
/// cameras do not depend on `count`.
///
/// [`Camera::camera_from_object`] is the object's pose in each camera's frame.
///
/// # Errors
/// [`RenderError::OutOfRange`] for the plan, the intrinsics, or more than 1,000,000 views; [`RenderError::BadPose`] for the target.
pub fn views(
    plan: &ViewPlan,
    intrinsics: Intrinsics,
    target: Point3<f64>,
    count: usize,
    seed: u64,
) -> Result<Vec<Camera>, RenderError> {
    plan.check()?;
    in_range("count", count as f64, 0.0..=MOST_VIEWS as f64, "views")?;
    let cap_from_z = Rotation3::rotation_between(&Vector3::z(), &plan.axis)
        .unwrap_or_else(|| Rotation3::from_axis_angle(&Vector3::x_axis(), PI));
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut uniform = |low: f64, high: f64| low + (high - low) * (rng.next_u64() >> 11) as f64 * (-53f64).exp2();
    (0..count)
        .map(|i| {
            let (share, turn) = match plan.pattern {
                Pattern::Grid => ((i as f64 + 0.5) / count as f64, i as f64 * GOLDEN_ANGLE),
                Pattern::Random => (uniform(0.0, 1.0), uniform(0.0, TAU)),
            };
            let eye = target + cap_from_z * on_cap(plan.cap, share, turn) * uniform(plan.distance[0], plan.distance[1]);
            let shift = Vector3::from_fn(|_, _| uniform(-plan.shift, plan.shift));
            let camera = Camera::look_at(intrinsics, eye, target, upright(&plan.up, &(target - eye)))?;
            camera.with_pose(Translation3::from(shift) * camera.world_from_camera())
        })
        .collect()
}

/// Direction on the cap about z with `share` of the cap's area inside.
fn on_cap(cap: f64, share: f64, turn: f64) -> Vector3<f64> {
    let z = 1.0 - share * (1.0 - cap.cos());
    let r = (1.0 - z * z).max(0.0).sqrt();
    Vector3::new(r * turn.cos(), r * turn.sin(), z)
}

/// `up`, or a perpendicular coordinate axis if the view is parallel to `up`.
fn upright(up: &Vector3<f64>, view: &Vector3<f64>) -> Vector3<f64> {
    let across = Unit::new_normalize(*up).cross(view).norm();
    if across > 1e-3 * view.norm() {
        return *up;
    }
    let least = up.iamin();
    Vector3::ith(least, 1.0)
}
