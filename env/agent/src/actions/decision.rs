//! One decision per episode: the hand moves to a pose, and a trial follows.

use crate::AgentError;
use crate::objects::Prepared;
use crate::pool::env_spec::EnvSpec;
use crate::rewards::potentials::Potentials;
use crate::rewards::reward::Attempt;
use graspbox_episode::trial::Trial;
use graspbox_episode::{Episode, FailureKind};
use graspbox_hand::GraspPose;
use nalgebra::{Isometry3, Point3, Vector3};

/// The state before a decision: an object at rest.
pub struct Decision<'a> {
    /// Data shared by all environments.
    pub spec: &'a EnvSpec,
    /// The object.
    pub prepared: &'a Prepared,
    /// Its centre of mass when the episode began, world, metres.
    pub first_center: &'a Point3<f64>,
    /// Factors on its friction and mass.
    pub factors: [f64; 2],
    /// Its pose.
    pub world_from_object: Isometry3<f64>,
}

/// Outcome of a decision.
pub struct Outcome {
    /// The episode at its end.
    pub episode: Episode,
    /// Inputs of the reward terms.
    pub attempt: Attempt,
    /// Kind of failure; `None` for a success.
    pub failure: Option<FailureKind>,
    /// The hand touched the object.
    pub touched: bool,
    /// The object was in the hand after the shake; false without a shake.
    pub survives_shake: bool,
}

impl Decision<'_> {
    /// Tries a grasp: from open at `world_from_hand` with `preshape` the hand closes, lifts, holds and, if the trial has a shake, shakes.
    ///
    /// * `episode`: the episode before the decision.
    ///
    /// # Errors
    /// [`AgentError`] for an invalid preshape or actuator command, which no finite action causes.
    pub fn attempt(
        &self,
        episode: &Episode,
        world_from_hand: &Isometry3<f64>,
        preshape: f64,
    ) -> Result<Outcome, AgentError> {
        let feasible = self.feasible(episode, world_from_hand, preshape)?;
        let (object, criterion) = (&self.world_from_object, self.spec.config.success);
        let episode = Episode::reset_at(episode.scene(), world_from_hand, object, preshape, self.factors, criterion);
        let before = self.potentials(&episode);
        if feasible && !self.out_of_reach(&episode) {
            return self.trial(episode, world_from_hand, preshape, &before);
        }
        let failure = Some(if feasible { FailureKind::NoContact } else { FailureKind::Infeasible });
        let attempt = Attempt { potentials: before, infeasible: !feasible, ..Attempt::default() };
        Ok(Outcome { episode, attempt, failure, touched: false, survives_shake: false })
    }

    /// * `before`: potentials before the hand closes; only the nearness is used.
    fn trial(
        &self,
        episode: Episode,
        world_from_hand: &Isometry3<f64>,
        preshape: f64,
        before: &Potentials,
    ) -> Result<Outcome, AgentError> {
        let mut trial = Trial::of(episode, world_from_hand, preshape, self.spec.config.trial(), (), false);
        trial.close(&|| false)?;
        let closed = self.potentials(trial.episode());
        trial.lift(&|| false)?;
        trial.shake(&|| false)?;
        let outcome = trial.outcome();
        let episode = trial.into_episode();
        let lifted = self.potentials(&episode);
        let highest = episode.judge().highest() / self.spec.config.success.lift_height;
        let potentials = Potentials {
            reach: before.reach,
            lift: if highest.is_finite() { highest.clamp(0.0, 1.0) } else { 0.0 },
            hold: lifted.hold,
            slip: lifted.slip,
            ..closed
        };
        Ok(Outcome {
            episode,
            attempt: Attempt { potentials, success: outcome.success, secure: outcome.secure, infeasible: false },
            failure: outcome.failure,
            touched: outcome.failure != Some(FailureKind::NoContact),
            survives_shake: outcome.survives_shake == Some(true),
        })
    }

    /// True if no part of the hand can reach the object while it closes and rises: nothing is simulated then.
    fn out_of_reach(&self, episode: &Episode) -> bool {
        let world = episode.world();
        let center = world.world_from_object() * self.prepared.bounds_center();
        let hand = Point3::from(world.world_from_hand().translation.vector);
        let rise = (center.z - hand.z).clamp(0.0, self.spec.config.trial.lift_height);
        let nearest = hand + Vector3::z() * rise;
        (center - nearest).norm() > self.spec.reach + self.prepared.half_extents().norm()
    }

    fn potentials(&self, episode: &Episode) -> Potentials {
        Potentials::of(episode, self.prepared, self.first_center)
    }

    /// True if the open hand reaches its pose without touching object or table.
    fn feasible(&self, episode: &Episode, world_from_hand: &Isometry3<f64>, preshape: f64) -> Result<bool, AgentError> {
        let pose = GraspPose { object_from_hand: self.world_from_object.inverse() * world_from_hand, preshape };
        let standoff = self.spec.config.trial.standoff;
        Ok(episode.scene().reachable_at(&pose, standoff, &self.world_from_object)?)
    }
}
