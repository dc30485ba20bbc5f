//! The mode of an episode, with the state that only this mode needs.

use crate::actions::control::{ClosedLoop, Control};
use crate::state::bounds::{FARTHEST, StateBounds};
use crate::state::placed::{Placed, TargetScene};
use graspbox_episode::FailureKind;
use graspbox_mesh::range::{OutOfRange, in_range, is_pose};
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

/// An object that moved by more than this was disturbed, metres.
pub const DISTURBED: f64 = 0.01;

/// The mode of an episode.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Mode {
    /// An action every control period.
    Grasp(GraspState),
    /// One decision.
    GraspPose(GraspPoseState),
    /// Decisions until a scene of several objects is cleared.
    Clear(ClearState),
}

/// The scene of an episode about one object.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum SceneKind {
    /// Nothing else lies on the table.
    Single {
        /// Index of the object's resting pose.
        resting: usize,
        /// The object was dropped from a requested pose instead.
        dropped: bool,
    },
    /// The object is the target among others.
    Target(TargetScene),
}

/// The state of closed-loop control.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GraspState {
    /// Meaning of an action.
    pub control: ClosedLoop,
    /// The scene as the episode began.
    pub scene: SceneKind,
    /// Lifting began: the object left the table in the hand.
    pub lifting: bool,
    /// The protective stop has held the hand since the last action began.
    pub stopped: bool,
}

/// The state of an episode of one decision.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GraspPoseState {
    /// [`Control::GraspPose`] or [`Control::GraspPoint`].
    pub control: Control,
    /// The scene as the episode began.
    pub scene: SceneKind,
    pub result: DecisionResult,
}

/// Result of the last decision; the default before the first.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DecisionResult {
    /// Kind of failure; `None` for a success.
    pub failure: Option<FailureKind>,
    /// The object was in the hand after the shake of a trial.
    pub survives_shake: bool,
}

/// The last attempt on a scene that is cleared.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LastAttempt {
    /// Rise of the object's centre of mass, metres.
    pub lift: f64,
    /// The grasp was secure.
    pub secure: bool,
    /// The hand touched an object.
    pub touches: bool,
    /// Number of objects that were disturbed and are still there.
    pub disturbed: u32,
}

/// The state of an episode that clears a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ClearState {
    /// Pose of the hand while it waits for a decision, world.
    pub waiting: Isometry3<f64>,
    /// The objects of the scene, in its order. Once the last one is gone they are those of the last attempt.
    pub objects: Vec<Placed>,
    /// Number of objects when the episode began.
    pub begun: u32,
    pub attempts: u32,
    /// Number of objects taken away.
    pub cleared: u32,
    /// Number of objects that left the workspace.
    pub lost: u32,
    /// Failures in a row.
    pub failures: u32,
    pub last: LastAttempt,
    /// The last decision.
    pub result: DecisionResult,
}

impl Mode {
    /// The mode of an episode about one object before its first step; the decisions of [`Control::Clear`] count as one.
    pub(crate) fn of_one(control: Control, scene: SceneKind) -> Self {
        match control.closed_loop() {
            Some(control) => Self::Grasp(GraspState { control, scene, lifting: false, stopped: false }),
            None => Self::GraspPose(GraspPoseState { control, scene, result: DecisionResult::default() }),
        }
    }

    /// The control mode.
    pub fn control(&self) -> Control {
        match self {
            Self::Grasp(state) => state.control.into(),
            Self::GraspPose(state) => state.control,
            Self::Clear(_) => Control::Clear,
        }
    }

    /// The scene of an episode about one object.
    pub fn scene(&self) -> Option<&SceneKind> {
        match self {
            Self::Grasp(GraspState { scene, .. }) | Self::GraspPose(GraspPoseState { scene, .. }) => Some(scene),
            Self::Clear(_) => None,
        }
    }

    /// The scene of a target among others.
    pub fn target_scene(&self) -> Option<&TargetScene> {
        match self.scene() {
            Some(SceneKind::Target(scene)) => Some(scene),
            _ => None,
        }
    }

    /// The state of a scene that is cleared.
    pub fn clearing(&self) -> Option<&ClearState> {
        match self {
            Self::Clear(state) => Some(state),
            _ => None,
        }
    }

    /// Index of the resting pose in which a single object began.
    pub fn resting(&self) -> Option<usize> {
        match self.scene() {
            Some(SceneKind::Single { resting, dropped: false }) => Some(*resting),
            _ => None,
        }
    }

    /// The objects of a scene of several, in its order; `None` for a single object.
    pub fn placed(&self) -> Option<&[Placed]> {
        match self.scene() {
            None => self.clearing().map(|state| state.objects.as_slice()),
            Some(SceneKind::Target(scene)) => Some(&scene.objects),
            Some(SceneKind::Single { .. }) => None,
        }
    }

    /// The last decision; the default without one.
    pub fn result(&self) -> DecisionResult {
        match self {
            Self::Grasp(_) => DecisionResult::default(),
            Self::GraspPose(GraspPoseState { result, .. }) | Self::Clear(ClearState { result, .. }) => *result,
        }
    }

    /// The protective stop has held the hand since the last action began.
    pub fn stopped(&self) -> bool {
        matches!(self, Self::Grasp(GraspState { stopped: true, .. }))
    }

    /// Refuses states that no episode within `bounds` can have.
    ///
    /// * `object`: index of the episode's object in the set.
    ///
    /// # Errors
    /// [`OutOfRange`], naming the first number.
    pub(crate) fn check(&self, object: usize, bounds: &StateBounds) -> Result<(), OutOfRange> {
        self.target_scene().map_or(Ok(()), |scene| scene.check(object, bounds))?;
        self.clearing().map_or(Ok(()), |state| state.check(bounds))
    }
}

impl ClearState {
    /// Before the first attempt.
    ///
    /// * `waiting`: pose of the hand while it waits, world.
    pub fn new(objects: Vec<Placed>, waiting: Isometry3<f64>) -> Self {
        Self {
            waiting,
            begun: objects.len() as u32,
            objects,
            attempts: 0,
            cleared: 0,
            lost: 0,
            failures: 0,
            last: LastAttempt::default(),
            result: DecisionResult::default(),
        }
    }

    /// Number of objects that are still there.
    pub fn remaining(&self) -> u32 {
        self.begun.saturating_sub(self.cleared + self.lost)
    }

    /// True once nothing is left, or after `most` failures in a row.
    pub fn over(&self, most: u32) -> bool {
        self.remaining() == 0 || self.failures >= most
    }

    fn check(&self, bounds: &StateBounds) -> Result<(), OutOfRange> {
        is_pose("clearing.waiting", &self.waiting, FARTHEST)?;
        Placed::check(&self.objects, bounds)?;
        in_range("clearing.begun", f64::from(self.begun), 1.0..=bounds.objects as f64, "")?;
        let gone = f64::from(self.cleared) + f64::from(self.lost);
        in_range("clearing.cleared + clearing.lost", gone, 0.0..=f64::from(self.begun), "")?;
        in_range("clearing.failures", f64::from(self.failures), 0.0..=f64::from(self.attempts), "")
    }
}
