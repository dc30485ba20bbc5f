//! What an episode remembers beside its world, its judge and its arm; part of every saved state.

use crate::potentials::Potentials;
use graspbox_episode::FailureKind;
use graspbox_vision::Viewpoint;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// What an episode remembers beside its world, its judge and its arm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Index of the object.
    pub object: usize,
    /// Index of its resting pose.
    pub resting: usize,
    /// The object was dropped at a given pose instead.
    pub dropped: bool,
    /// Factor on the object's friction.
    pub friction: f64,
    /// Factor on the object's mass.
    pub mass: f64,
    /// Centre of mass of the object when the episode began, world, metres.
    pub first_center: Point3<f64>,
    /// The last action, clipped; zeros before the first.
    pub last_action: Vec<f32>,
    /// Target of the preshape, as one number.
    pub preshape: f64,
    /// Control periods since the episode began; decisions count as one.
    pub steps: u32,
    /// The hand has touched the object.
    pub touched: bool,
    /// Lifting began: the object left the table in the hand.
    pub lifting: bool,
    /// The grasp succeeded.
    pub success: bool,
    /// The kind of failure, if it is known before the judge is asked.
    pub failure: Option<FailureKind>,
    /// The object was in the hand after the shake of a trial.
    pub survives_shake: bool,
    /// The protective stop has held the hand since the last action began.
    pub stopped: bool,
    /// Potentials of the reward's shaping terms.
    pub potentials: Potentials,
    /// Cameras and light.
    pub viewpoint: Viewpoint,
}
