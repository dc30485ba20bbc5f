//! A decision: the hand moves to a pose, and a trial follows.

use crate::EnvError;
use crate::objects::Prepared;
use crate::pool::env_spec::EnvSpec;
use crate::rewards::potentials::Potentials;
use crate::rewards::reward::Attempt;
use graspbox_episode::trial::Trial;
use graspbox_episode::{Approach, Episode, FailureKind, approach};
use graspbox_hand::GraspPose;
use nalgebra::{Isometry3, Point3, Vector3};
use std::sync::Arc;

/// The state before a decision: objects at rest.
pub struct Decision<'a> {
    /// Data shared by all environments.
    pub spec: &'a EnvSpec,
    /// The objects of the scene, in its order.
    pub prepared: &'a [Arc<Prepared>],
    /// Factors on their friction and mass.
    pub factors: [f64; 2],
    /// Pose of the scene's target.
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
    /// Objects may have moved.
    pub moved: bool,
    /// The object was in the hand after the shake; false without a shake.
    pub survives_shake: bool,
}

impl Decision<'_> {
    /// Tries a grasp: from open at `world_from_hand` with `preshape` the hand closes, lifts, holds and, if the trial has a shake, shakes.
    ///
    /// * `episode`: the episode before the decision.
    ///
    /// # Errors
    /// [`EnvError`] for an invalid preshape or actuator command, which no finite action causes.
    pub fn attempt(
        &self,
        episode: &Episode,
        world_from_hand: &Isometry3<f64>,
        preshape: f64,
    ) -> Result<Outcome, EnvError> {
        let (scene, object, criterion) = (episode.scene(), &self.world_from_object, self.spec.config.success);
        let at_pose = || Episode::reset_at(scene, world_from_hand, object, preshape, self.factors, criterion);
        let pose = GraspPose { object_from_hand: object.inverse() * world_from_hand, preshape };
        let standoff = self.spec.config.trial.standoff;
        let (episode, reached, moved) = if scene.reachable_at(&pose, standoff, object)? {
            (at_pose(), true, false)
        } else if self.spec.config.pushes() && self.spec.arm.is_none() {
            match approach(scene, &pose, object, self.factors, criterion, standoff)? {
                Approach::Arrived(episode) => (episode, true, true),
                Approach::Stopped(episode) => (episode, false, true),
                Approach::NoRoom => (at_pose(), false, false),
            }
        } else {
            (at_pose(), false, false)
        };
        let before = self.potentials(&episode);
        if reached && (episode.scene().is_any_target() || !self.out_of_reach(&episode)) {
            return self.trial(episode, world_from_hand, preshape, &before);
        }
        let failure = Some(if reached { FailureKind::NoContact } else { FailureKind::Infeasible });
        let attempt = Attempt { potentials: before, infeasible: !reached, ..Attempt::default() };
        Ok(Outcome { episode, attempt, failure, touched: moved && !reached, moved, survives_shake: false })
    }

    /// * `before`: potentials before the hand closes; only the nearness is used.
    fn trial(
        &self,
        episode: Episode,
        world_from_hand: &Isometry3<f64>,
        preshape: f64,
        before: &Potentials,
    ) -> Result<Outcome, EnvError> {
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
            moved: true,
            survives_shake: outcome.survives_shake == Some(true),
        })
    }

    /// True if no part of the hand can reach the object while it closes and rises: nothing is simulated then.
    fn out_of_reach(&self, episode: &Episode) -> bool {
        let world = episode.world();
        let prepared = &self.prepared[world.target()];
        let center = world.world_from_object() * prepared.bounds_center();
        let hand = Point3::from(world.world_from_hand().translation.vector);
        let rise = (center.z - hand.z).clamp(0.0, self.spec.config.trial.lift_height);
        let nearest = hand + Vector3::z() * rise;
        (center - nearest).norm() > self.spec.reach + prepared.half_extents().norm()
    }

    fn potentials(&self, episode: &Episode) -> Potentials {
        let target = episode.world().target();
        let place = match target == episode.scene().target() {
            true => self.world_from_object,
            false => episode.scene().world_from(target),
        };
        Potentials::of(episode, &self.prepared[target], &(place * episode.scene().center_of(target)))
    }
}
