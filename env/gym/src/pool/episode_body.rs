//! The parts of an episode that every mode has, and a decision, which two modes share.

use crate::EnvError;
use crate::actions::action::pose_and_preshape;
use crate::actions::arm_controller::{ArmController, Motion};
use crate::actions::decision::{Decision, Outcome};
use crate::objects::Prepared;
use crate::pool::env_spec::EnvSpec;
use crate::state::{DecisionResult, GoalConfig, Record};
use graspbox_episode::{Episode, FailureKind};
use graspbox_sim::HandLoad;
use nalgebra::Isometry3;
use std::sync::Arc;

/// The parts of an episode that every mode has.
pub(crate) struct EpisodeBody {
    pub episode: Episode,
    /// The objects of the scene, in its order.
    pub prepared: Vec<Arc<Prepared>>,
    pub arm: ArmController,
    pub record: Record,
}

impl EpisodeBody {
    /// The object; among several, the target.
    pub fn target(&self) -> &Arc<Prepared> {
        &self.prepared[self.episode.world().target()]
    }

    /// True if the goal is reached.
    pub fn reached(&self, config: &GoalConfig) -> bool {
        self.record.goal.is_some_and(|goal| goal.distance(self.episode.world()) <= config.threshold)
    }

    /// True if the hand touches the object.
    pub fn touches(&self) -> bool {
        !self.episode.world().contacts().links.is_empty()
    }

    /// Moves the arm for a step that begins `time` seconds after the control period. Returns the true pose of the hand at its end.
    pub fn move_arm(&mut self, motion: &Motion, time: f64, spec: &EnvSpec, load: &HandLoad) -> Isometry3<f64> {
        let world = self.episode.world();
        let Some(arm) = &spec.arm else { return self.arm.advance(motion, time, world.dt(), &spec.guard, load) };
        let hand = self.arm.follow(arm, motion, time, (&spec.guard, load, world, spec.timing.substeps));
        let joints = &self.arm.joints().0[..arm.follower.chain().len()];
        self.episode.drive_arm(joints, self.arm.links_are_far());
        hand
    }

    /// Moves the hand to the pose of `action` and tries the grasp; `None` if the hand cannot take the pose. The episode stays as it was.
    ///
    /// # Errors
    /// As [`Decision::attempt`].
    pub fn decide(
        &mut self,
        action: &[f32],
        spec: &EnvSpec,
        result: &mut DecisionResult,
    ) -> Result<Option<Outcome>, EnvError> {
        *result = DecisionResult { failure: Some(FailureKind::Infeasible), survives_shake: false };
        self.record.success = false;
        let Some((estimated, preshape)) = pose_and_preshape(spec.config.control, action, spec.hand()) else {
            return Ok(None);
        };
        let hand = self.arm.teleport(&estimated);
        let decision = Decision {
            spec,
            prepared: &self.prepared,
            factors: [self.record.friction, self.record.mass],
            world_from_object: self.episode.world().world_from_object(),
        };
        let outcome = decision.attempt(&self.episode, &hand, preshape)?;
        self.record.success = outcome.attempt.success;
        self.record.touched = outcome.touched;
        self.record.potentials = outcome.attempt.potentials;
        *result = DecisionResult { failure: outcome.failure, survives_shake: outcome.survives_shake };
        Ok(Some(outcome))
    }

    /// Continues with `episode`; the arm takes the pose of its hand.
    pub fn go_on(&mut self, episode: Episode) {
        self.episode = episode;
        self.arm.sync(&self.episode.world().world_from_hand());
    }
}
