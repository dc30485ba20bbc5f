//! The trace of a trial.

use crate::episode::Episode;
use graspbox_sim::{HandContact, World};
use nalgebra::{Isometry3, Point3};

/// Time between the samples of a trace, seconds.
pub const PERIOD: f64 = 0.01;

/// One row of a trial's trace.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Seconds since closing began.
    pub time: f64,
    /// Distance between the origin of the hand frame and the base point of the scene's object, metres.
    pub distance: f64,
    /// Grasp frame in the world.
    pub world_from_hand: Isometry3<f64>,
    /// Frame of the scene's object in the world, even if the trial is about another object.
    pub world_from_object: Isometry3<f64>,
    /// Frames of the scene's other objects in the world, in their order.
    pub world_from_others: Vec<Isometry3<f64>>,
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
    /// Force on each tactile sensor, N.
    pub tactile: Vec<f64>,
    /// Contact points at which the object presses on the hand; hand frame.
    pub contacts: Vec<HandContact>,
}

impl Sample {
    /// The present state of an episode.
    pub(crate) fn of(episode: &Episode) -> Self {
        let (world, scene) = (episode.world(), episode.scene());
        let mut world_from_others: Vec<_> = world.world_from_objects().collect();
        let world_from_object = world_from_others.remove(scene.target());
        Self {
            time: world.time(),
            distance: (world.hand_from(scene.target()) * scene.base_point()).coords.norm(),
            world_from_hand: world.world_from_hand(),
            world_from_object,
            world_from_others,
            joints: world.configuration(),
            actuators: world.actuators().iter().map(|actuator| actuator.position).collect(),
            loads: (0..world.actuators().len()).map(|actuator| world.load(actuator)).collect(),
            tensions: (0..world.hand().tendons.len()).map(|tendon| world.tension(tendon)).collect(),
            hand_force: world.contacts().hand_force,
            tactile: world.tactile().force,
            contacts: world.hand_contacts().into_iter().filter(|contact| contact.object.is_some()).collect(),
        }
    }
}

/// Distance between the origin of the hand frame and the point `base_point` of the object, metres.
pub(crate) fn distance(world: &World, base_point: &Point3<f64>) -> f64 {
    (world.hand_from_object() * base_point).coords.norm()
}
