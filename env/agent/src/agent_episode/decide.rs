//! One decision an episode: the hand is sent to a pose, and a trial follows there.

use super::AgentEpisode;
use crate::AgentError;
use crate::action::pose_and_preshape;
use crate::env_spec::EnvSpec;
use crate::reward::{Potentials, TERMS};
use graspbox_episode::trial::Trial;
use graspbox_episode::{Episode, FailureKind};
use graspbox_hand::GraspPose;
use nalgebra::{Isometry3, Point3, Vector3};

impl AgentEpisode {
    /// Sends the hand where `action` says and tries the grasp; returns the reward terms. The episode is over then.
    ///
    /// # Errors
    /// A preshape or a motor command that the hand does not take, which a finite action never gives.
    pub(super) fn decide(&mut self, action: &[f32], spec: &EnvSpec) -> Result<[f32; TERMS], AgentError> {
        self.record.steps = self.record.steps.saturating_add(1);
        self.record.last_action = action.iter().map(|a| a.clamp(-1.0, 1.0)).collect();
        self.record.failure = Some(FailureKind::Infeasible);
        let Some((believed, preshape)) = pose_and_preshape(action, spec.hand()) else {
            return Ok(self.terms_of_attempt(&Potentials::default(), true));
        };
        let hand = self.arm.teleport(&believed);
        let object = self.episode.world().world_from_object();
        let feasible = self.feasible(&object, &hand, preshape, spec)?;
        let factors = [self.record.friction, self.record.mass];
        let criterion = spec.config.success;
        self.episode = Episode::reset_at(self.episode.scene(), &hand, &object, preshape, factors, criterion);
        let mut after = self.potentials_now(spec);
        if feasible && self.out_of_reach(spec) {
            self.record.failure = Some(FailureKind::NoContact);
        } else if feasible {
            self.attempt(&hand, preshape, spec, &mut after)?;
        }
        self.arm.sync(&self.episode.world().world_from_hand());
        self.record.potentials = after;
        Ok(self.terms_of_attempt(&after, !feasible))
    }

    /// The trial; `after` keeps how near the hand was before it closed, and what it held before it lifted.
    fn attempt(
        &mut self,
        hand: &Isometry3<f64>,
        preshape: f64,
        spec: &EnvSpec,
        after: &mut Potentials,
    ) -> Result<(), AgentError> {
        let mut trial = Trial::of(self.episode.clone(), hand, preshape, spec.config.trial(), false);
        trial.close(&|| false)?;
        let closed = Potentials::at(trial.episode(), &self.prepared, &self.record.first_center, spec.hand());
        trial.lift(&|| false)?;
        let outcome = trial.outcome();
        self.episode = trial.into_episode();
        let lifted = self.potentials_now(spec);
        let highest = self.episode.judge().highest() / spec.config.success.lift_height;
        *after = Potentials {
            reach: after.reach,
            lift: if highest.is_finite() { highest.clamp(0.0, 1.0) } else { 0.0 },
            hold: lifted.hold,
            ..closed
        };
        self.record.success = outcome.success;
        self.record.failure = outcome.failure;
        self.record.touched = outcome.failure != Some(FailureKind::NoContact);
        Ok(())
    }

    /// True where no finger can touch the object, neither while the hand closes nor while it rises: there is nothing to simulate.
    fn out_of_reach(&self, spec: &EnvSpec) -> bool {
        let world = self.episode.world();
        let center = world.world_from_object() * self.prepared.bounds_center();
        let hand = Point3::from(world.world_from_hand().translation.vector);
        let rise = (center.z - hand.z).clamp(0.0, spec.config.trial.lift_height);
        let nearest = hand + Vector3::z() * rise;
        (center - nearest).norm() > spec.reach + self.prepared.half_extents().norm()
    }

    fn potentials_now(&self, spec: &EnvSpec) -> Potentials {
        Potentials::at(&self.episode, &self.prepared, &self.record.first_center, spec.hand())
    }

    /// True where the open hand reaches its place without touching object or table.
    fn feasible(
        &self,
        world_from_object: &Isometry3<f64>,
        world_from_hand: &Isometry3<f64>,
        preshape: f64,
        spec: &EnvSpec,
    ) -> Result<bool, AgentError> {
        let pose = GraspPose { object_from_hand: world_from_object.inverse() * world_from_hand, preshape };
        Ok(self.episode.scene().reachable_at(&pose, spec.config.trial.standoff, world_from_object)?)
    }

    /// Terms of an attempt, in order: the hand came from afar, where every potential is 0, and took its resting by itself.
    fn terms_of_attempt(&self, after: &Potentials, infeasible: bool) -> [f32; TERMS] {
        let flag = |f: bool| if f { 1.0 } else { 0.0 };
        [
            after.reach,
            after.contact,
            after.closure,
            after.lift,
            after.hold,
            flag(self.record.success),
            -flag(infeasible),
            0.0,
            -after.push,
            0.0,
            0.0,
        ]
        .map(|x| x as f32)
    }
}
