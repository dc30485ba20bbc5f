//! The state of an episode beside its world, judge and arm; part of every saved state.

use crate::actions::control::Control;
use crate::pool::clearing::Clearing;
use crate::pool::env_spec::EnvSpec;
use crate::rewards::potentials::Potentials;
use crate::starts::clutter::{Placed, TargetScene};
use graspbox_episode::FailureKind;
use graspbox_mesh::range::{OutOfRange, all_within, in_range, is_pose};
use graspbox_vision::Viewpoint;
use nalgebra::{Isometry3, Point3};
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
    /// What remains of a scene that is cleared; `None` in other episodes.
    pub clearing: Option<Clearing>,
    /// The scene of a target among others; `None` in other episodes.
    pub target_scene: Option<TargetScene>,
    /// Pose of the hand while it waits for a decision.
    pub waiting: Isometry3<f64>,
}

impl Record {
    /// The objects of a scene of several, in its order; `None` for a single object.
    pub fn placed(&self) -> Option<&[Placed]> {
        let cleared = self.clearing.as_ref().map(|clearing| clearing.objects.as_slice());
        cleared.or(self.target_scene.as_ref().map(|scene| scene.objects.as_slice()))
    }

    /// Refuses states that no episode of `spec` can have.
    ///
    /// # Errors
    /// [`OutOfRange`], naming the first number.
    pub(crate) fn check(&self, spec: &EnvSpec) -> Result<(), OutOfRange> {
        /// Farther than anything falls, metres.
        const FARTHEST: f64 = 1e5;
        in_range("record.friction", self.friction, 1e-3..=1e3, "")?;
        in_range("record.mass", self.mass, 1e-3..=1e3, "")?;
        all_within("record.first_center", self.first_center.iter().copied(), FARTHEST, "m")?;
        all_within("record.last_action", self.last_action.iter().map(|a| f64::from(*a)), 1.0, "")?;
        let [low, high] = spec.hand().preshape_limits();
        in_range("record.preshape", self.preshape, low..=high, spec.hand().preshape_unit())?;
        is_pose("record.waiting", &self.waiting, FARTHEST)?;
        let same = |field, here: bool, there: bool| {
            let there = f64::from(there);
            in_range(field, f64::from(here), there..=there, "")
        };
        same("record.clearing", self.clearing.is_some(), spec.config.control == Control::Clear)?;
        same("record.target_scene", self.target_scene.is_some(), spec.config.has_target())?;
        self.clearing.iter().try_for_each(|clearing| clearing.check(spec))?;
        self.target_scene.iter().try_for_each(|scene| scene.check(self.object, spec))?;
        self.potentials.all().into_iter().try_for_each(|x| in_range("record.potentials", x, 0.0..=1.0, ""))?;
        self.viewpoint.parent_from_camera.iter().try_for_each(|pose| is_pose("record.viewpoint", pose, FARTHEST))
    }
}
