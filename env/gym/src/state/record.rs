//! The state that every episode has.

use crate::rewards::potentials::Potentials;
use crate::state::Goal;
use crate::state::bounds::{FARTHEST, StateBounds};
use crate::state::goal::GOAL_BOUND;
use graspbox_mesh::range::{OutOfRange, all_within, in_range, is_pose};
use graspbox_render::Viewpoint;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// The state that every episode has, besides its world, judge and arm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Index of the object in the set; among several, of the target or the last one grasped.
    pub object: usize,
    /// The object is narrow enough for the hand in its first pose.
    pub fits: bool,
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
    /// The grasp succeeded; with a goal, it is reached.
    pub success: bool,
    /// The goal of the episode, in environments that have one.
    pub goal: Option<Goal>,
    /// Potentials of the reward's shaping terms.
    pub potentials: Potentials,
    /// Cameras and light.
    pub viewpoint: Viewpoint,
}

impl Record {
    /// Refuses states that no episode within `bounds` can have.
    ///
    /// # Errors
    /// [`OutOfRange`], naming the first number.
    pub(crate) fn check(&self, bounds: &StateBounds) -> Result<(), OutOfRange> {
        in_range("record.friction", self.friction, 1e-3..=1e3, "")?;
        in_range("record.mass", self.mass, 1e-3..=1e3, "")?;
        all_within("record.first_center", self.first_center.iter().copied(), FARTHEST, "m")?;
        all_within("record.last_action", self.last_action.iter().map(|a| f64::from(*a)), 1.0, "")?;
        let goal = self.goal.iter().flat_map(|goal| goal.desired).map(f64::from);
        all_within("record.goal", goal, GOAL_BOUND, "m")?;
        let [low, high] = bounds.preshape;
        in_range("record.preshape", self.preshape, low..=high, bounds.preshape_unit)?;
        self.potentials.all().into_iter().try_for_each(|x| in_range("record.potentials", x, 0.0..=1.0, ""))?;
        self.viewpoint.parent_from_camera.iter().try_for_each(|pose| is_pose("record.viewpoint", pose, FARTHEST))
    }
}
