//! The parts of an episode that every mode has, and a decision, which two modes share.

use crate::EnvError;
use crate::actions::action::pose_and_preshape;
use crate::actions::arm_controller::{ArmController, Motion};
use crate::actions::decision::{Decision, Outcome};
use crate::objects::Prepared;
use crate::pool::env_spec::EnvSpec;
use crate::robot_arm::{ArmSpec, PlacedObstacle, Way};
use crate::state::{DecisionResult, GoalConfig, Record};
use graspbox_arm::chain::Positions;
use graspbox_episode::{Episode, FailureKind};
use graspbox_hand::ActuatorCommand;
use graspbox_sim::HandLoad;
use nalgebra::{Isometry3, Point3};
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
        let hand = self.arm.follow(arm, (motion, time), (&spec.guard, load, world, spec.timing.substeps), 1);
        self.drive_arm(spec);
        hand
    }

    /// Moves the arm's links, if there are any, to where its controller is.
    fn drive_arm(&mut self, spec: &EnvSpec) {
        if let Some(arm) = &spec.arm {
            let joints = &self.arm.joints().0[..arm.follower.chain().len()];
            self.episode.drive_arm(joints, self.arm.links_are_far());
        }
    }

    /// Moves the arm and advances by `steps` time steps at once where nothing is in reach: [`Episode::advance_freely`]. Returns whether it did; if
    /// not, nothing has changed.
    ///
    /// * `motion`: with the time since the control period began, seconds.
    ///
    /// # Errors
    /// As [`Episode::advance`].
    pub fn advance_freely(
        &mut self,
        (motion, time): (&Motion, f64),
        commands: &[ActuatorCommand],
        steps: u32,
        spec: &EnvSpec,
    ) -> Result<bool, EnvError> {
        let world = self.episode.world();
        if steps < 2 || !world.is_free() || !self.arm.coasts(steps) {
            return Ok(false);
        }
        let (dt, load, before) = (world.dt(), HandLoad::default(), self.arm.clone());
        let mut hand = world.world_from_hand();
        if let Some(arm) = &spec.arm {
            hand = self.arm.follow(arm, (motion, time), (&spec.guard, &load, world, spec.timing.substeps), steps);
        } else {
            for step in 0..steps {
                hand = self.arm.advance(motion, time + f64::from(step) * dt, dt, &spec.guard, &load);
            }
        }
        self.drive_arm(spec);
        let advanced = self.episode.advance_freely(&hand, commands, steps)?;
        if !advanced {
            self.arm.undo(before);
            self.drive_arm(spec);
        }
        Ok(advanced)
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
        let (mut estimated, mut way) = (estimated, None);
        if let (Some(arm), Some(start)) = (&spec.arm, self.arm.positions()) {
            let Some(found) = self.way(arm, start, (&estimated, preshape), spec)? else {
                self.arm.block();
                return Ok(None);
            };
            // An arm with fewer than six axes meets the rotation only nearly.
            estimated = arm.robot.world_from_hand(&found.grasp);
            way = Some((&arm.robot, found));
        }
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
        if let Some((robot, way)) = way {
            let end = outcome.episode.world().world_from_hand() * hand.inverse() * estimated;
            self.arm.rest_at(&way.at(end.translation.z, robot), robot);
        }
        Ok(Some(outcome))
    }

    /// Plans the path of the arm from a posture to a grasp, and up with the object; `None` without one.
    fn way(
        &self,
        arm: &ArmSpec,
        start: &Positions,
        (world_from_hand, preshape): (&Isometry3<f64>, f64),
        spec: &EnvSpec,
    ) -> Result<Option<Way>, EnvError> {
        let world = self.episode.world();
        let shapes = self.prepared.iter().map(|one| Arc::clone(one.body().obstacle()));
        let objects: Vec<PlacedObstacle> = shapes.zip(world.world_from_objects()).collect();
        let object = match self.episode.scene().is_any_target() {
            true => nearest(&objects, &(world_from_hand * spec.hand().grasp.center)),
            false => world.target(),
        };
        arm.way(spec.hand(), start, (world_from_hand, preshape), (objects, object), &spec.config.trial)
    }

    /// Continues with `episode`; a hand without an arm stays where it is in it.
    pub fn go_on(&mut self, episode: Episode) {
        self.episode = episode;
        if self.arm.positions().is_none() {
            self.arm.sync(&self.episode.world().world_from_hand());
        }
    }

    /// Puts the hand where it waits for a decision, `waiting` (world), or its arm home.
    pub fn wait(&mut self, waiting: &Isometry3<f64>, spec: &EnvSpec) {
        match &spec.arm {
            Some(arm) => self.arm.rest_at(&arm.robot.home(), &arm.robot),
            None => self.arm.sync(waiting),
        }
    }
}

/// Index of the object nearest to a point in the world.
fn nearest(objects: &[PlacedObstacle], point: &Point3<f64>) -> usize {
    let distance =
        |(obstacle, pose): &PlacedObstacle| obstacle.distance(&pose.inverse_transform_point(point), f64::INFINITY);
    let distances = objects.iter().map(distance).enumerate();
    distances.min_by(|(_, a), (_, b)| a.total_cmp(b)).map_or(0, |(index, _)| index)
}
