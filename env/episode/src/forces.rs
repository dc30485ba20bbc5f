//! A grasp under forces: six pulls on an object in the air, and a lift off the table, as DexGraspBench judges grasps.
//!
//! The hand closes around an object that nothing else holds: without gravity, far above the table. Then a force of constant direction pulls
//! the object along each axis of the world, each time from the same closed state. In the second trial the object rests on the table, a force as
//! of gravity acts on it from the beginning, the hand closes and lifts. The benchmark limits the object's motion in the hand since the start,
//! before the hand closed; a hand that moves the object into its grasp as it closes can fail there and still hold it, so the motion since the
//! hand closed is judged, too. Nothing filters the poses; a hand that is deep in the object at the start fails.
//!
//! Differences from the benchmark: the hand closes by the commands of a trial instead of three postures, lifts along a minimum-jerk path, and
//! contacts have no torsional friction.
//!
//! Source: Chen, Ke, Wang, "BODex: Scalable and Efficient Robotic Dexterous Grasp Synthesis Using Bilevel Optimization", 2025, and the
//! benchmark's `src/task/eval_func`.

use crate::batch::check_poses;
use crate::judge::{SECURE_SHIFT, SECURE_TURN};
use crate::trial::{TrialConfig, minimum_jerk};
use crate::{EpisodeError, Progress, Scene};
use graspbox_hand::{ActuatorCommand, GraspPose};
use graspbox_mesh::in_range;
use graspbox_sim::load::HandContact;
use graspbox_sim::{SimError, World};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Number of pulls: along and against each axis of the world.
pub const PULLS: usize = 6;
/// Height of an object in the air above its place on the table, metres.
const IN_THE_AIR: f64 = 1.0;
/// Time between two checks of the object, which end the pull of a lost one, seconds.
const LOOK_EVERY: f64 = 0.05;

/// Settings of the protocol; the defaults are the benchmark's, with the closing time of a trial and its lifting time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ForceConfig {
    /// Force by the object's mass, m/s2.
    pub acceleration: f64,
    /// Duration of each pull, seconds.
    pub pull_time: f64,
    /// Time to close, seconds.
    pub close_time: f64,
    /// Height to lift, metres.
    pub lift_height: f64,
    /// Time to lift, seconds.
    pub lift_time: f64,
    /// Greatest translation of the object's centre of mass, metres.
    pub max_shift: f64,
    /// Greatest rotation, radians.
    pub max_turn: f64,
    /// Greatest overlap of hand and object at the start, metres.
    pub max_depth: f64,
    /// Mass of the object, kg; `None` for its own.
    pub mass: Option<f64>,
    /// Coefficient of friction between the object and the pads of the hand, which scales that with bare surfaces and the table alike; `None`
    /// for that of the scene.
    pub friction: Option<f64>,
}

impl Default for ForceConfig {
    fn default() -> Self {
        let trial = TrialConfig::default();
        Self {
            acceleration: 10.0,
            pull_time: 2.0,
            close_time: trial.close_time,
            lift_height: 0.1,
            lift_time: trial.lift_time,
            max_shift: SECURE_SHIFT,
            max_turn: SECURE_TURN,
            max_depth: 0.01,
            mass: Some(0.1),
            friction: Some(0.6),
        }
    }
}

impl ForceConfig {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`EpisodeError::OutOfRange`], naming the first setting that is out of range.
    pub fn validate(&self) -> Result<(), EpisodeError> {
        in_range("acceleration", self.acceleration, 0.0..=1000.0, "m/s2")?;
        in_range("pull_time", self.pull_time, 0.0..=60.0, "s")?;
        in_range("close_time", self.close_time, 0.1..=10.0, "s")?;
        in_range("lift_height", self.lift_height, 0.0..=1.0, "m")?;
        in_range("lift_time", self.lift_time, 0.1..=10.0, "s")?;
        in_range("max_shift", self.max_shift, 1e-4..=1.0, "m")?;
        in_range("max_turn", self.max_turn, 1e-3..=std::f64::consts::PI, "rad")?;
        in_range("max_depth", self.max_depth, 0.0..=0.1, "m")?;
        self.mass.map_or(Ok(()), |mass| in_range("mass", mass, 1e-5..=25.0, "kg"))?;
        Ok(self.friction.map_or(Ok(()), |friction| in_range("friction", friction, 0.01..=5.0, ""))?)
    }

    /// Factors on the friction and the mass of the object of `world`.
    fn factors(&self, scene: &Scene, world: &World) -> [f64; 2] {
        let pads = world.hand().friction.pad * scene.template().config().friction.object;
        [
            self.friction.map_or(1.0, |friction| friction / pads),
            self.mass.map_or(1.0, |mass| mass / world.object_mass()),
        ]
    }
}

/// Motion of the object in the hand's frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Translation of the centre of mass, metres.
    pub shift: f64,
    /// Rotation, radians.
    pub turn: f64,
}

/// Outcome of a pull or of the lift; both verdicts are false and motions NaN where it never began, because the hand was too deep in the object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PullOutcome {
    /// Motion since the start of the trial, before the hand closed.
    pub since_start: Motion,
    /// Motion since the hand closed.
    pub since_closed: Motion,
    /// The motion since the start stayed within the limits: the benchmark's verdict.
    pub passes: bool,
    /// The motion since the hand closed stayed within the limits.
    pub holds: bool,
}

/// The outcome of a grasp.
#[derive(Clone, Debug, PartialEq)]
pub struct ForceOutcome {
    /// Overlap of hand and object in the first time step, metres.
    pub start_depth: f64,
    /// Overlap once the hand is closed in the air, metres; NaN if it was too deep at the start.
    pub closed_depth: f64,
    /// Contacts of the object with the closed hand in the air that press; hand frame.
    pub contacts: Vec<HandContact>,
    /// Outcome of each pull: along -x, x, -y, y, -z, z of the world. A lost object ends its pull.
    pub pulls: [PullOutcome; PULLS],
    /// Outcome of the lift.
    pub lift: PullOutcome,
    /// Simulated time, seconds.
    pub time: f64,
}

/// A world in which the hand holds its pose or lifts, and a force acts on the object.
#[derive(Clone)]
struct ForceWorld {
    world: World,
    start: Isometry3<f64>,
    /// The object in the hand before the hand closed, and afterwards.
    before: Isometry3<f64>,
    closed: Isometry3<f64>,
    center: Point3<f64>,
    close: Vec<ActuatorCommand>,
    config: ForceConfig,
}

impl ForceWorld {
    /// The hand open at `pose` around the object, which is `height` metres above its place on the table.
    fn new(scene: &Scene, pose: &GraspPose, config: ForceConfig, height: f64) -> Self {
        let object = Translation3::new(0.0, 0.0, height) * scene.world_from_object();
        let start = object * pose.object_from_hand;
        let mut world = scene.template().spawn(&start, &object, pose.preshape);
        let [friction, mass] = config.factors(scene, &world);
        world.scale_object(friction, mass);
        world.set_gravity(&Vector3::zeros());
        let targets = world.hand().closed_positions(pose.preshape).into_iter();
        let close = targets.map(|target| ActuatorCommand::Position { target, speed: None }).collect();
        let before = world.hand_from_object();
        Self { world, start, before, closed: before, center: scene.center_of_mass(), close, config }
    }

    fn steps(&self, time: f64) -> u64 {
        (time / self.world.dt()).round() as u64
    }

    /// Overlap of hand and object in the first time step, metres; the world does not move.
    fn start_depth(&self) -> Result<f64, SimError> {
        let mut copy = self.world.clone();
        copy.step(&self.start, &[])?;
        Ok(copy.contacts().hand_depth)
    }

    /// Closes the hand.
    fn close(&mut self) -> Result<(), SimError> {
        (0..self.steps(self.config.close_time)).try_for_each(|_| self.world.step(&self.start, &self.close))?;
        self.closed = self.world.hand_from_object();
        Ok(())
    }

    fn moved(&self) -> PullOutcome {
        let now = self.world.hand_from_object();
        let since = |then: &Isometry3<f64>| Motion {
            shift: (now * self.center - then * self.center).norm(),
            turn: (then.rotation.inverse() * now.rotation).angle(),
        };
        let (since_start, since_closed) = (since(&self.before), since(&self.closed));
        let diverged = self.world.has_diverged();
        let keeps = |moved: Motion| moved.shift < self.config.max_shift && moved.turn < self.config.max_turn;
        PullOutcome {
            since_start,
            since_closed,
            passes: !diverged && keeps(since_start),
            holds: !diverged && keeps(since_closed),
        }
    }

    /// Pulls along a unit vector of the world, until the end or until the object is lost.
    fn pull(&mut self, along: &Vector3<f64>) -> Result<PullOutcome, SimError> {
        self.set_force(along);
        let look = self.steps(LOOK_EVERY).max(1);
        let mut passed = true;
        for step in 1..=self.steps(self.config.pull_time) {
            self.world.step(&self.start, &self.close)?;
            if step.is_multiple_of(look) {
                let moved = self.moved();
                passed &= moved.passes;
                if !moved.holds {
                    break;
                }
            }
        }
        let moved = self.moved();
        Ok(PullOutcome { passes: passed && moved.passes, ..moved })
    }

    /// Closes and lifts under a force towards the table.
    fn lift(&mut self) -> Result<PullOutcome, SimError> {
        self.set_force(&-Vector3::z());
        self.close()?;
        let dt = self.world.dt();
        for step in 1..=self.steps(self.config.lift_time) {
            let share = minimum_jerk(step as f64 * dt / self.config.lift_time);
            let target = Translation3::new(0.0, 0.0, share * self.config.lift_height) * self.start;
            self.world.step(&target, &self.close)?;
        }
        Ok(self.moved())
    }

    fn set_force(&mut self, along: &Vector3<f64>) {
        let force = along * (self.config.acceleration * self.world.object_mass());
        self.world.set_object_force(&force);
    }
}

/// Tries every pose (`object_from_hand`) by the protocol, in parallel on the current rayon pool; the results do not depend on the number of
/// threads.
///
/// # Errors
/// [`EpisodeError::OutOfRange`], [`EpisodeError::BadPose`] or [`EpisodeError::BadPreshape`], naming the value, or
/// [`EpisodeError::Cancelled`] if `progress` was cancelled.
pub fn run_forces(
    scene: &Arc<Scene>,
    poses: &[GraspPose],
    config: ForceConfig,
    progress: &Progress,
) -> Result<Vec<ForceOutcome>, EpisodeError> {
    config.validate()?;
    check_poses(scene.template().hand(), poses)?;
    let one = |pose: &GraspPose| -> Result<Option<ForceOutcome>, EpisodeError> {
        let sim = |source| EpisodeError::Sim { object: scene.name().to_owned(), source };
        let outcome = judged(scene, pose, config, progress).map_err(sim)?;
        progress.step();
        Ok(outcome)
    };
    let outcomes = poses.par_iter().map(one).collect::<Result<Vec<_>, _>>()?;
    let total = outcomes.len();
    let finished: Vec<ForceOutcome> = outcomes.into_iter().flatten().collect();
    if finished.len() < total {
        return Err(EpisodeError::Cancelled { done: finished.len(), total });
    }
    Ok(finished)
}

/// The outcome of one grasp; `None` if `progress` was cancelled.
fn judged(
    scene: &Scene,
    pose: &GraspPose,
    config: ForceConfig,
    progress: &Progress,
) -> Result<Option<ForceOutcome>, SimError> {
    let mut bout = ForceWorld::new(scene, pose, config, IN_THE_AIR);
    let mut outcome = ForceOutcome::unmoved(bout.start_depth()?);
    if outcome.start_depth > config.max_depth {
        return Ok(Some(outcome));
    }
    bout.close()?;
    let closed = bout.world.contacts();
    outcome.closed_depth = closed.hand_depth;
    outcome.contacts = bout.world.hand_contacts().into_iter().filter(|contact| contact.object.is_some()).collect();
    outcome.time = bout.world.time();
    for (index, pull) in outcome.pulls.iter_mut().enumerate() {
        if progress.stopped() {
            return Ok(None);
        }
        let mut pulled = bout.clone();
        *pull = pulled.pull(&Vector3::ith(index / 2, if index % 2 == 0 { -1.0 } else { 1.0 }))?;
        outcome.time += pulled.world.time() - bout.world.time();
    }
    let mut table = ForceWorld::new(scene, pose, config, 0.0);
    outcome.lift = table.lift()?;
    outcome.time += table.world.time();
    Ok(Some(outcome))
}

impl ForceOutcome {
    fn unmoved(start_depth: f64) -> Self {
        let none = Motion { shift: f64::NAN, turn: f64::NAN };
        let none = PullOutcome { since_start: none, since_closed: none, passes: false, holds: false };
        Self { start_depth, closed_depth: f64::NAN, contacts: Vec::new(), pulls: [none; PULLS], lift: none, time: 0.0 }
    }
}
