//! Camera poses and light of one episode, sampled or set.

use crate::{Camera, Light};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Largest rotation of the lamp about each axis at full variation of the light, radians.
const LAMP_TURN: f64 = 0.7;
/// Largest relative change of lamp and ambient light at full variation of the light.
const LAMP_SHARE: f64 = 0.5;

/// Variation of cameras and light between episodes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Variation {
    /// Greatest shift of a camera along each of its axes, metres.
    pub camera_position: f64,
    /// Greatest rotation of a camera about each of its axes, radians.
    pub camera_rotation: f64,
    /// Variation of the light, in [0, 1].
    pub light: f64,
}

/// Camera poses and light of one episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Viewpoint {
    /// Pose of each camera in the frame of its mount.
    pub parent_from_camera: Vec<Isometry3<f64>>,
    pub light: Light,
}

impl Viewpoint {
    /// Samples a viewpoint.
    ///
    /// * `cameras`, `light`: the values to vary; cameras are posed in the frame of their mount.
    /// * `given`: cameras (index, pose in the frame of the mount) that are not varied.
    /// * `sample`: numbers uniform in [-1, 1): three for the direction of the lamp, three for the strengths, then six per camera.
    pub fn sample(
        cameras: &[Camera],
        light: Light,
        vary: &Variation,
        given: &[(usize, Isometry3<f64>)],
        mut sample: impl FnMut() -> f64,
    ) -> Self {
        let mut three = |size: f64| Vector3::from_fn(|_, _| sample() * size);
        // The light comes first, so it does not depend on the number of cameras.
        let (turn, strength) = (three(vary.light * LAMP_TURN), three(vary.light * LAMP_SHARE));
        let mut light = light;
        light.direction = UnitQuaternion::from_scaled_axis(turn) * light.direction;
        light.intensity *= (1.0 + strength.x) as f32;
        light.ambient *= (1.0 + strength.y) as f32;
        let moved = |camera: &Camera| {
            let error = Isometry3::from_parts(
                Translation3::from(three(vary.camera_position)),
                UnitQuaternion::from_scaled_axis(three(vary.camera_rotation)),
            );
            camera.world_from_camera() * error
        };
        let mut parent_from_camera: Vec<_> = cameras.iter().map(moved).collect();
        for (camera, pose) in given {
            parent_from_camera[*camera] = *pose;
        }
        Self { parent_from_camera, light }
    }
}
