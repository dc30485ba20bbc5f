//! Where the cameras stand and how it is lit in one episode, drawn or given.

use crate::EpisodeError;
use crate::agent::draw::Draw;
use crate::agent::start::rigid;
use crate::eyes::Eyes;
use graspbox_camera::Light;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

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
pub struct Look {
    /// Pose of each camera in the frame of what carries it.
    pub parent_from_camera: Vec<Isometry3<f64>>,
    /// The light.
    pub light: Light,
}

impl Look {
    /// Draws a look from the stream of `seed`; `given` poses (homogeneous matrices by the camera's name) are taken as they are.
    ///
    /// # Errors
    /// A given pose that is no rigid motion, or of an unknown camera.
    pub fn draw(
        eyes: &Eyes,
        vary: &Variation,
        given: &BTreeMap<String, [[f64; 4]; 4]>,
        seed: u64,
    ) -> Result<Self, EpisodeError> {
        let mut draw = Draw::new(seed);
        let mut three = |size: f64| Vector3::from_fn(|_, _| draw.within(1.0) * size);
        // The light first, so that it does not depend on the number of cameras.
        let (turn, strength) = (three(vary.light * LAMP_TURN), three(vary.light * LAMP_SHARE));
        let mut light = eyes.light();
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
        let mut parent_from_camera: Vec<_> = eyes.lenses().iter().map(moved).collect();
        for (name, rows) in given {
            let known = eyes.config().cameras.iter().position(|c| c.name == *name);
            let index = known.ok_or_else(|| EpisodeError::BadOption {
                option: "cameras",
                why: format!("there is no camera {name:?}"),
            })?;
            parent_from_camera[index] = rigid(rows, "cameras")?;
        }
        Ok(Self { parent_from_camera, light })
    }
}
