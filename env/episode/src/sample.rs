//! What a trial records of itself.

use crate::episode::Episode;
use crate::study::distance;
use nalgebra::Isometry3;

/// One row of a trial's trace, every 10 ms.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Seconds since closing began.
    pub time: f64,
    /// Distance between hand frame and object frame, metres.
    pub distance: f64,
    /// Grasp frame in the world.
    pub world_from_hand: Isometry3<f64>,
    /// Object in the world.
    pub world_from_object: Isometry3<f64>,
    /// Positions of the hand's independent joints, rad or m.
    pub joints: Vec<f64>,
    /// Positions of its actuators, rad or m.
    pub actuators: Vec<f64>,
    /// Loads on its actuators, N or N m.
    pub loads: Vec<f64>,
    /// Tension of every tendon, N.
    pub tensions: Vec<f64>,
    /// Sum of the normal forces between hand and object, N.
    pub hand_force: f64,
}

impl Sample {
    /// What can be read off an episode now.
    pub(crate) fn of(episode: &Episode) -> Self {
        let world = episode.world();
        Self {
            time: world.time(),
            distance: distance(world, &episode.scene().base_point()),
            world_from_hand: world.world_from_hand(),
            world_from_object: world.world_from_object(),
            joints: world.configuration(),
            actuators: world.actuators().iter().map(|actuator| actuator.position).collect(),
            loads: (0..world.actuators().len()).map(|actuator| world.load(actuator)).collect(),
            tensions: (0..world.hand().tendons.len()).map(|tendon| world.tension(tendon)).collect(),
            hand_force: world.contacts().hand_force,
        }
    }
}
