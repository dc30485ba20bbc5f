//! A goal: a position that the hand or the object is to reach.
//!
//! Positions are those of the observations, in f32 and clipped, so that a reward is the same wherever it is computed.

use crate::EnvError;
use graspbox_mesh::in_range;
use graspbox_sim::World;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// Greatest coordinate of a position, metres: farther ones are clipped.
pub const GOAL_BOUND: f64 = 1.0;

/// What is to reach the goal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GoalTask {
    /// The grasp centre of the hand.
    Reach,
    /// The object's centre of mass.
    Place,
}

/// Settings of environments with goals.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GoalConfig {
    pub task: GoalTask,
    /// Greatest distance from the goal at success, metres.
    pub threshold: f64,
    /// An episode ends at success.
    pub ends: bool,
}

impl GoalConfig {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`EnvError::OutOfRange`] for the threshold.
    pub fn validate(&self) -> Result<(), EnvError> {
        Ok(in_range("threshold", self.threshold, 1e-3..=0.5, "m")?)
    }
}

/// The goal of an episode.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Goal {
    pub task: GoalTask,
    /// World, metres.
    pub desired: [f32; 3],
}

impl Goal {
    /// * `desired`: world, metres.
    pub fn new(task: GoalTask, desired: [f64; 3]) -> Self {
        Self { task, desired: observed(desired) }
    }

    /// The position that is to reach the goal, world, metres.
    pub fn achieved(&self, world: &World) -> [f32; 3] {
        let point: Point3<f64> = match self.task {
            GoalTask::Reach => world.world_from_hand() * world.hand().grasp.center,
            GoalTask::Place => world.object_center(),
        };
        observed(point.coords.into())
    }

    /// The present distance from the goal, metres.
    pub fn distance(&self, world: &World) -> f64 {
        distance(&self.achieved(world), &self.desired)
    }
}

/// Distance of two observed positions, metres.
pub fn distance(a: &[f32; 3], b: &[f32; 3]) -> f64 {
    let square = |i: usize| (f64::from(a[i]) - f64::from(b[i])).powi(2);
    (square(0) + square(1) + square(2)).sqrt()
}

/// A position as observations have it; NaN becomes the least value.
fn observed(position: [f64; 3]) -> [f32; 3] {
    position.map(|x| (x as f32).max(-GOAL_BOUND as f32).min(GOAL_BOUND as f32))
}
