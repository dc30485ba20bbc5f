//! The scripted driver of an [`Episode`]: close, lift, hold, and shake if the config has one.

use crate::episode::Episode;
use crate::judge::{FailureKind, SuccessCriterion};
use crate::observer::Observer;
use crate::sample::{PERIOD, Sample};
use crate::shake::ShakeConfig;
use crate::{EpisodeError, Scene};
use graspbox_hand::{ActuatorCommand, GraspPose};
use graspbox_mesh::in_range;
use nalgebra::{Isometry3, Translation3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Settings of a trial.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrialConfig {
    /// Length of the approach, along the hand's z to the pose, metres.
    pub standoff: f64,
    /// Time to close, seconds.
    pub close_time: f64,
    /// Height to lift, metres.
    pub lift_height: f64,
    /// Time to lift, seconds.
    pub lift_time: f64,
    /// Time to hold, seconds.
    pub hold_time: f64,
    /// Stop as soon as success is out of reach.
    pub early_stop: bool,
    /// Early stops wait for the measurements of the trial's observer. Python's name is `legacy`: its observer takes the reference study's measures.
    #[serde(rename = "legacy")]
    pub await_observer: bool,
    /// The shake after a success; `None`: no shake.
    pub shake: Option<ShakeConfig>,
    pub success: SuccessCriterion,
}

impl Default for TrialConfig {
    fn default() -> Self {
        Self {
            standoff: 0.10,
            close_time: 1.3,
            lift_height: 0.20,
            lift_time: 1.0,
            hold_time: 1.0,
            early_stop: true,
            await_observer: false,
            shake: None,
            success: SuccessCriterion::default(),
        }
    }
}

impl TrialConfig {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`EpisodeError::OutOfRange`], naming the first setting that is out of range.
    pub fn validate(&self) -> Result<(), EpisodeError> {
        self.success.validate()?;
        in_range("standoff", self.standoff, 0.0..=0.5, "m")?;
        in_range("close_time", self.close_time, 0.1..=10.0, "s")?;
        in_range("lift_height", self.lift_height, self.success.lift_height..=1.0, "m")?;
        in_range("lift_time", self.lift_time, 0.1..=10.0, "s")?;
        in_range("hold_time", self.hold_time, self.success.hold_time..=60.0, "s")?;
        self.shake.map_or(Ok(()), |shake| shake.validate(self.lift_height))
    }

    /// Checks that time steps of `dt` seconds resolve the motion.
    ///
    /// # Errors
    /// As [`ShakeConfig::check_time_step`].
    pub fn check_time_step(&self, dt: f64) -> Result<(), EpisodeError> {
        self.shake.map_or(Ok(()), |shake| shake.check_time_step(dt))
    }
}

/// The outcome of a trial. Measures of the shake, time and steps apart, it describes the end of the hold, with or without a shake.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialOutcome {
    /// The object is held high, free and still at the end.
    pub success: bool,
    /// Success without translation or rotation in the hand.
    pub secure: bool,
    /// Kind of failure; `None` for a success.
    pub failure: Option<FailureKind>,
    /// Rise of the object's centre of mass at the end, metres.
    pub lift: f64,
    /// Success after the shake, judged again. `None` for a trial without a shake; false if the grasp failed before it.
    pub survives_shake: Option<bool>,
    /// Shift of the object's centre of mass in the hand's frame during the shake, metres; `None` if nothing was shaken.
    pub shake_shift: Option<f64>,
    /// Simulated time including the shake, seconds.
    pub time: f64,
    /// Steps in which the solver did not converge; 0 for an engine that does not measure it.
    pub unconverged_steps: u64,
}

#[derive(Clone, Debug)]
pub struct Finished<O> {
    pub outcome: TrialOutcome,
    /// Its trace if one was requested, else empty.
    pub trace: Vec<Sample>,
    /// Its observer; `None` if the pose was infeasible and nothing moved.
    pub observer: Option<O>,
}

/// A trial in progress.
#[derive(Clone)]
pub struct Trial<O = ()> {
    episode: Episode,
    config: TrialConfig,
    start: Isometry3<f64>,
    close: Vec<ActuatorCommand>,
    step: u64,
    /// Steps from one sample of the trace to the next.
    sample_every: u64,
    /// The hand touched the object at some time since lifting began.
    touched: bool,
    /// The trial ended early, and the kind of failure if it is known already.
    over: Option<Option<FailureKind>>,
    observer: O,
    /// The episode after the shake.
    shaken: Option<Episode>,
    trace: Option<Vec<Sample>>,
}

/// Steps between two checks of the object: 10 ms at the default time step.
const LOOK_EVERY: u64 = 5;
/// Steps between two checks for cancellation and divergence: 0.13 s at the default time step.
const CHECK_EVERY: u64 = 64;
/// The object may rise relative to the hand by this much while the fingers settle, metres.
const CURL_RISE: f64 = 0.03;

impl<O: Observer> Trial<O> {
    /// Begins a trial with the hand at `pose`; the caller has checked that pose and approach are free of collisions.
    ///
    /// * `factors`: factors on the object's friction and mass.
    /// * `observer`: makes the observer from the episode before its first step.
    pub fn new(
        scene: &Arc<Scene>,
        pose: &GraspPose,
        factors: [f64; 2],
        config: TrialConfig,
        observer: impl FnOnce(&Episode) -> O,
        trace: bool,
    ) -> Self {
        let object = scene.world_from_object();
        let start = object * pose.object_from_hand;
        let mut episode = Episode::reset_at(scene, &start, object, pose.preshape, factors, config.success);
        episode.expect_rest();
        let observer = observer(&episode);
        Self::of(episode, &start, pose.preshape, config, observer, trace)
    }

    /// Begins a trial of an episode whose hand is open at `start` (world) with `preshape`.
    pub fn of(
        episode: Episode,
        start: &Isometry3<f64>,
        preshape: f64,
        config: TrialConfig,
        observer: O,
        trace: bool,
    ) -> Self {
        let hand = Arc::clone(episode.world().hand());
        let close = hand.closed_positions(preshape).into_iter();
        let close = close.map(|target| ActuatorCommand::Position { target, speed: None }).collect();
        let trace = trace.then(Vec::new);
        let sample_every = ((PERIOD / episode.world().dt()).round() as u64).max(1);
        Self {
            episode,
            config,
            start: *start,
            close,
            step: 0,
            sample_every,
            touched: false,
            over: None,
            observer,
            shaken: None,
            trace,
        }
    }

    /// Runs to the end; `None` if `stop`, which is called every 64 steps, returned true.
    ///
    /// # Errors
    /// [`EpisodeError::Sim`] for an actuator command that is not finite, which no finite pose causes.
    pub fn run(mut self, stop: &dyn Fn() -> bool) -> Result<Option<Finished<O>>, EpisodeError> {
        let finished = self.close(stop)? && self.lift(stop)? && self.shake(stop)?;
        Ok(finished.then(|| Finished {
            outcome: self.outcome(),
            trace: self.trace.unwrap_or_default(),
            observer: Some(self.observer),
        }))
    }

    /// Closes the hand; false if `stop` returned true.
    ///
    /// # Errors
    /// As [`Trial::run`].
    pub fn close(&mut self, stop: &dyn Fn() -> bool) -> Result<bool, EpisodeError> {
        if let Some(trace) = &mut self.trace {
            trace.push(Sample::of(&self.episode));
        }
        let closed = self.until(self.steps(self.config.close_time), stop)?;
        if self.episode.scene().is_any_target() {
            self.episode.target_most_pressed();
        }
        Ok(closed)
    }

    /// A copy in which the mass of every object is `factor` times as great, 0.01 to 100: what the closed hand would lift then.
    pub(crate) fn loaded(&self, factor: f64) -> Self
    where
        O: Clone,
    {
        let mut copy = self.clone();
        copy.episode.scale_masses(factor);
        copy
    }

    /// Lifts and holds, after [`Trial::close`]; false if `stop` returned true.
    ///
    /// # Errors
    /// As [`Trial::run`].
    pub fn lift(&mut self, stop: &dyn Fn() -> bool) -> Result<bool, EpisodeError> {
        self.episode.begin_lift();
        self.observer.begin_lift(&self.episode);
        let config = self.config;
        let phases = [config.close_time, config.lift_time, config.hold_time];
        let lifted = self.until(phases.iter().map(|time| self.steps(*time)).sum(), stop)?;
        if self.episode.scene().is_any_target() {
            self.episode.target_held();
        }
        Ok(lifted)
    }

    /// Shakes a success after [`Trial::lift`] if the config has a shake, and holds for the hold time again; false if `stop` returned true.
    ///
    /// A copy of the episode is shaken, so episode and labels stay those of the end of the hold.
    ///
    /// # Errors
    /// As [`Trial::run`].
    pub fn shake(&mut self, stop: &dyn Fn() -> bool) -> Result<bool, EpisodeError> {
        let Some(config) = self.config.shake.filter(|_| self.outcome().success) else { return Ok(true) };
        let mut episode = self.episode.clone();
        let (start, dt) = (episode.world().world_from_hand(), episode.world().dt());
        let center = episode.world().hand().grasp.center;
        for step in 1..=self.steps(config.time() + self.config.hold_time) {
            if step.is_multiple_of(CHECK_EVERY) && stop() {
                return Ok(false);
            }
            episode.advance(&(start * config.offset(step as f64 * dt, &center)), &self.close)?;
            if let Some(trace) = &mut self.trace
                && step.is_multiple_of(self.sample_every)
            {
                trace.push(Sample::of(&episode));
            }
            let fell = || episode.judge().on_scenery() && episode.world().contacts().links.is_empty();
            let lost = self.config.early_stop && step.is_multiple_of(LOOK_EVERY) && fell();
            if lost || step.is_multiple_of(CHECK_EVERY) && episode.world().has_diverged() {
                break;
            }
        }
        self.shaken = Some(episode);
        Ok(true)
    }

    /// The episode; after a shake, its state before the shake.
    pub fn episode(&self) -> &Episode {
        &self.episode
    }

    /// The episode at the end of the trial, without the shake.
    pub fn into_episode(self) -> Episode {
        self.episode
    }

    fn steps(&self, time: f64) -> u64 {
        (time / self.episode.world().dt()).round() as u64
    }

    /// Advances to step `end`, unless the trial ends early; false if `stop` returned true.
    fn until(&mut self, end: u64, stop: &dyn Fn() -> bool) -> Result<bool, EpisodeError> {
        let dt = self.episode.world().dt();
        let close = self.steps(self.config.close_time);
        while self.step < end && self.over.is_none() {
            if self.step.is_multiple_of(CHECK_EVERY) && stop() {
                return Ok(false);
            }
            self.step += 1;
            let target = self.target(self.step as f64 * dt);
            self.episode.advance(&target, &self.close)?;
            self.observer.observe(&self.episode);
            if let Some(trace) = &mut self.trace
                && self.step.is_multiple_of(self.sample_every)
            {
                trace.push(Sample::of(&self.episode));
            }
            let looks = self.step > close && self.step.is_multiple_of(LOOK_EVERY);
            self.touched |= looks && self.touches();
            if looks && self.ends_early() && self.out_of_reach() {
                self.over = Some(None);
            } else if self.step.is_multiple_of(CHECK_EVERY) && self.episode.world().has_diverged() {
                self.over = Some(Some(FailureKind::Unstable));
            }
        }
        Ok(true)
    }

    /// Pose of the hand `time` seconds after closing began: at rest, then up along a minimum-jerk trajectory, then at rest.
    fn target(&self, time: f64) -> Isometry3<f64> {
        let rise = self.config.lift_height * minimum_jerk((time - self.config.close_time) / self.config.lift_time);
        Translation3::new(0.0, 0.0, rise) * self.start
    }

    fn ends_early(&self) -> bool {
        self.config.early_stop && !(self.config.await_observer && self.observer.pending())
    }

    fn touches(&self) -> bool {
        !self.episode.world().contacts().links.is_empty()
    }

    /// True if no object can be high enough at the end, even if the hand carried it up from now on.
    fn out_of_reach(&self) -> bool {
        self.episode.judges().iter().all(|judge| {
            let verdict = judge.verdict(self.episode.world());
            let reach = verdict.lift + (self.config.lift_height - verdict.hand_lift) + CURL_RISE;
            reach < judge.criterion().lift_height
        })
    }

    /// The outcome, once the trial is over.
    pub fn outcome(&self) -> TrialOutcome {
        let (world, failure) = (self.episode.world(), self.over.flatten());
        let verdict = self.episode.verdict();
        let success = verdict.success && failure.is_none() && !world.has_diverged();
        let missed = (!self.touched).then_some(FailureKind::NoContact);
        let judged = || self.episode.judge().failure(world, self.touches());
        let diverged = world.has_diverged().then_some(FailureKind::Unstable);
        let why = failure.or(diverged).or(missed).unwrap_or_else(judged);
        let end = self.shaken.as_ref().unwrap_or(&self.episode).world();
        let survives = |shaken: &Episode| shaken.verdict().success && !shaken.world().has_diverged();
        let center = self.episode.scene().center_of(world.target());
        let shift =
            |shaken: &Episode| (shaken.world().hand_from_object() * center - world.hand_from_object() * center).norm();
        TrialOutcome {
            success,
            secure: success && verdict.secure,
            failure: (!success).then_some(why),
            lift: verdict.lift,
            survives_shake: self.config.shake.map(|_| self.shaken.as_ref().is_some_and(survives)),
            shake_shift: self.shaken.as_ref().map(shift),
            time: end.time(),
            unconverged_steps: end.unconverged_steps(),
        }
    }
}

/// Share of the path after the share `time` of the duration, on a minimum-jerk trajectory: s^3 (10 - 15 s + 6 s^2).
///
/// Source: Flash, Hogan, "The coordination of arm movements: an experimentally confirmed mathematical model", 1985.
pub fn minimum_jerk(time: f64) -> f64 {
    let s = time.clamp(0.0, 1.0);
    s * s * s * (10.0 + s * (6.0 * s - 15.0))
}

impl TrialOutcome {
    /// The outcome of an infeasible pose: nothing moves.
    ///
    /// * `shake`: the trial has a shake.
    pub fn infeasible(shake: bool) -> Self {
        Self {
            success: false,
            secure: false,
            failure: Some(FailureKind::Infeasible),
            lift: 0.0,
            survives_shake: shake.then_some(false),
            shake_shift: None,
            time: 0.0,
            unconverged_steps: 0,
        }
    }
}
