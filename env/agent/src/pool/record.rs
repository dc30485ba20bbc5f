//! The state of an episode beside its world, judge and arm; part of every saved state.

use crate::rewards::potentials::Potentials;
use graspbox_episode::FailureKind;
use graspbox_hand::Hand;
use graspbox_mesh::range::{OutOfRange, all_within, in_range, is_pose};
use graspbox_vision::Viewpoint;
use nalgebra::Point3;
use serde::{Deserialize, Serialize};

/// The state of an episode beside its world, judge and arm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Index of the object.
    pub object: usize,
    /// Index of its resting pose.
    pub resting: usize,
    /// The object was dropped from a requested pose instead.
    pub dropped: bool,
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
    /// Lifting began: the object left the table in the hand.
    pub lifting: bool,
    /// The grasp succeeded.
    pub success: bool,
    /// The kind of failure, if it is known without the judge.
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

impl Record {
    /// Refuses states that no episode with this hand can have.
    ///
    /// # Errors
    /// [`OutOfRange`], naming the first number.
    pub(crate) fn check(&self, hand: &Hand) -> Result<(), OutOfRange> {
        /// Farther than anything falls, metres.
        const FARTHEST: f64 = 1e5;
        in_range("record.friction", self.friction, 1e-3..=1e3, "")?;
        in_range("record.mass", self.mass, 1e-3..=1e3, "")?;
        all_within("record.first_center", self.first_center.iter().copied(), FARTHEST, "m")?;
        all_within("record.last_action", self.last_action.iter().map(|a| f64::from(*a)), 1.0, "")?;
        let [low, high] = hand.preshape_limits();
        in_range("record.preshape", self.preshape, low..=high, hand.preshape_unit())?;
        self.potentials.all().into_iter().try_for_each(|x| in_range("record.potentials", x, 0.0..=1.0, ""))?;
        self.viewpoint.parent_from_camera.iter().try_for_each(|pose| is_pose("record.viewpoint", pose, FARTHEST))
    }
}
