//! Where the cameras stand and how it is lit in one episode, drawn or given.

use crate::Observer;
use graspbox_camera::Light;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// The lamp turns by up to this much, radians, at full variation of the light.
const LAMP_TURN: f64 = 0.7;
/// Lamp and surroundings change by up to this share, at full variation of the light.
const LAMP_SHARE: f64 = 0.5;

/// By how much what is seen varies from episode to episode.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Variation {
    /// Greatest shift of a camera along each of its axes, metres.
    pub camera_position: f64,
    /// Greatest turn of a camera about each of its axes, radians.
    pub camera_rotation: f64,
    /// Variation of the light, in [0, 1].
    pub light: f64,
}

/// Where the cameras stand and how it is lit in one episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Viewpoint {
    /// Pose of each camera in the frame of what carries it.
    pub parent_from_camera: Vec<Isometry3<f64>>,
    /// The light.
    pub light: Light,
}

impl Viewpoint {
    /// Samples a viewpoint; cameras of `given` (index, and pose in the frame of what carries it) are taken as they are.
    ///
    /// * `sample`: numbers uniform in [-1, 1); three for each of the lamp's direction and strength, then six for each camera.
    pub fn sample(
        observer: &Observer,
        vary: &Variation,
        given: &[(usize, Isometry3<f64>)],
        mut sample: impl FnMut() -> f64,
    ) -> Self {
        let mut three = |size: f64| Vector3::from_fn(|_, _| sample() * size);
        // The light first, so that it does not depend on the number of cameras.
        let (turn, strength) = (three(vary.light * LAMP_TURN), three(vary.light * LAMP_SHARE));
        let mut light = observer.light();
        light.direction = UnitQuaternion::from_scaled_axis(turn) * light.direction;
        light.intensity *= (1.0 + strength.x) as f32;
        light.ambient *= (1.0 + strength.y) as f32;
        let moved = |lens: &graspbox_camera::Camera| {
            let error = Isometry3::from_parts(
                Translation3::from(three(vary.camera_position)),
                UnitQuaternion::from_scaled_axis(three(vary.camera_rotation)),
            );
            lens.world_from_camera() * error
        };
        let mut parent_from_camera: Vec<_> = observer.lenses().iter().map(moved).collect();
        for (camera, pose) in given {
            parent_from_camera[*camera] = *pose;
        }
        Self { parent_from_camera, light }
    }
}
