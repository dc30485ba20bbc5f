//! The scripted driver: approach, close, lift, hold, and shake where it is asked to. It drives the same [`Episode`] as an agent does.

use crate::episode::Episode;
use crate::judge::{FailureKind, SuccessCriterion};
use crate::sample::Sample;
use crate::shake::ShakeConfig;
use crate::study::{READ_TIME, Reading, SAMPLE_PERIOD, Study};
use crate::{EpisodeError, Scene};
use graspbox_hand::{ActuatorCommand, GraspPose};
use graspbox_mesh::in_range;
use nalgebra::{Isometry3, Translation3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// How a trial runs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct TrialConfig {
    /// The hand approaches from this far back along its -z, metres.
    pub standoff: f64,
    /// Time to close, seconds (the study lifts 1.3 s after closing begins).
    pub close_time: f64,
    /// Height to lift, metres.
    pub lift_height: f64,
    /// Time to lift, seconds.
    pub lift_time: f64,
    /// Time to hold, seconds.
    pub hold_time: f64,
    /// Stop as soon as success is out of reach.
    pub early_stop: bool,
    /// Read the study's own measures as well; early stops then wait until these are read.
    pub legacy: bool,
    /// Shakes what was grasped at the end of a success; none: no shake.
    pub shake: Option<ShakeConfig>,
    /// What counts as success.
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
            legacy: false,
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

    /// Checks that time steps of `dt` seconds resolve every motion.
    ///
    /// # Errors
    /// As [`ShakeConfig::check_time_step`].
    pub fn check_time_step(&self, dt: f64) -> Result<(), EpisodeError> {
        self.shake.map_or(Ok(()), |shake| shake.check_time_step(dt))
    }
}

/// What came of a trial. All but the shake's measures, the time and the steps describe the end of the hold, with or without a shake.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrialOutcome {
    /// Held high, free and still at the end.
    pub success: bool,
    /// Success without shifting or turning in the hand.
    pub secure: bool,
    /// Why it failed; none for a success.
    pub failure: Option<FailureKind>,
    /// Rise of the object's centre of mass at the end, metres.
    pub lift: f64,
    /// Mean of |d distance/dt| between hand and object since lifting began, m/s; none where the study's measures were not watched.
    pub kindness_rate: Option<f64>,
    /// The study's success; none where an early stop cut it off.
    pub legacy_success: Option<bool>,
    /// The study's kindness; none where an early stop cut it off.
    pub kindness: Option<f64>,
    /// The object is in the hand after the shake: success, judged anew. None where the trial has no shake; false where the grasp failed
    /// before.
    pub survives_shake: Option<bool>,
    /// Shift of the object's centre of mass in the hand's frame from before the shake to its end, metres; none where nothing was shaken.
    pub shake_shift: Option<f64>,
    /// Simulated seconds, those of the shake included.
    pub time: f64,
    /// Steps in which the solver found no balance of forces; 0 for an engine that does not measure it.
    pub unconverged_steps: u64,
}

/// What a trial leaves: its outcome, and its trace if one was asked for.
pub type Finished = (TrialOutcome, Option<Vec<Sample>>);

/// A trial in progress.
pub struct Trial {
    episode: Episode,
    config: TrialConfig,
    start: Isometry3<f64>,
    close: Vec<ActuatorCommand>,
    step: u64,
    /// Steps from one sample of the trace to the next.
    sample_every: u64,
    /// The hand touched the object at some time since lifting began.
    touched: bool,
    /// It ended before its time, and why if it is known already.
    over: Option<Option<FailureKind>>,
    /// The study's measures, where they are asked for, and what they said.
    study: Option<Study>,
    reading: Option<Reading>,
    /// The episode after the shake.
    shaken: Option<Episode>,
    trace: Option<Vec<Sample>>,
}

/// Steps between two checks of the object.
const LOOK_EVERY: u64 = 5;
/// The object may rise relative to the hand by this much while fingers settle, metres.
const CURL_RISE: f64 = 0.03;

impl Trial {
    /// Begins a trial with the hand at `pose`, and watches the study's measures; the caller has checked that pose and approach are free of collision.
    pub fn new(scene: &Arc<Scene>, pose: &GraspPose, config: TrialConfig, trace: bool) -> Self {
        Self::scaled(scene, pose, [1.0, 1.0], config, trace)
    }

    /// As [`Trial::new`], with the object's friction and mass multiplied by `factors`.
    pub fn scaled(scene: &Arc<Scene>, pose: &GraspPose, factors: [f64; 2], config: TrialConfig, trace: bool) -> Self {
        let object = scene.world_from_object();
        let start = object * pose.object_from_hand;
        let episode = Episode::reset_at(scene, &start, object, pose.preshape, factors, config.success);
        let study = Study::new(&episode);
        Self { study: Some(study), ..Self::of(episode, &start, pose.preshape, config, trace) }
    }

    /// Begins a trial of a fresh episode, whose hand stands open at `start` (world) with `preshape`, without the study's measures.
    pub fn of(episode: Episode, start: &Isometry3<f64>, preshape: f64, config: TrialConfig, trace: bool) -> Self {
        let hand = Arc::clone(episode.world().hand());
        let close = hand.closed_positions(preshape).into_iter();
        let close = close.map(|target| ActuatorCommand::Position { target, speed: None }).collect();
        let trace = trace.then(Vec::new);
        let sample_every = ((SAMPLE_PERIOD / episode.world().dt()).round() as u64).max(1);
        Self {
            episode,
            config,
            start: *start,
            close,
            step: 0,
            sample_every,
            touched: false,
            over: None,
            study: None,
            reading: None,
            shaken: None,
            trace,
        }
    }

    /// Runs to the end; `stop` is asked now and then and ends the trial when it says so (then the result is none).
    ///
    /// # Errors
    /// An actuator command that is not finite, which a finite pose never gives.
    pub fn run(mut self, stop: &dyn Fn() -> bool) -> Result<Option<Finished>, EpisodeError> {
        let finished = self.close(stop)? && self.lift(stop)? && self.shake(stop)?;
        Ok(finished.then(|| (self.outcome(), self.trace)))
    }

    /// Closes the hand; false if `stop` said so.
    ///
    /// # Errors
    /// As [`Trial::run`].
    pub fn close(&mut self, stop: &dyn Fn() -> bool) -> Result<bool, EpisodeError> {
        if let Some(trace) = &mut self.trace {
            trace.push(Sample::of(&self.episode));
        }
        self.until(self.steps(self.config.close_time), stop)
    }

    /// Lifts and holds, after [`Trial::close`]; false if `stop` said so.
    ///
    /// # Errors
    /// As [`Trial::run`].
    pub fn lift(&mut self, stop: &dyn Fn() -> bool) -> Result<bool, EpisodeError> {
        self.episode.begin_lift();
        if let Some(study) = &mut self.study {
            study.begin_lift(self.episode.world());
        }
        let config = self.config;
        let phases = [config.close_time, config.lift_time, config.hold_time];
        self.until(phases.iter().map(|time| self.steps(*time)).sum(), stop)
    }

    /// Shakes a success where the config asks for it, after [`Trial::lift`], and holds for the hold time again; false if `stop` said so.
    ///
    /// A copy of the world is shaken, so that episode and labels stay those of the end of the hold.
    ///
    /// # Errors
    /// As [`Trial::run`].
    pub fn shake(&mut self, stop: &dyn Fn() -> bool) -> Result<bool, EpisodeError> {
        let Some(config) = self.config.shake.filter(|_| self.outcome().success) else { return Ok(true) };
        let mut episode = self.episode.clone();
        let (start, dt) = (episode.world().world_from_hand(), episode.world().dt());
        let center = episode.world().hand().grasp.center;
        for step in 1..=self.steps(config.time() + self.config.hold_time) {
            if step.is_multiple_of(64) && stop() {
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
            if lost || step.is_multiple_of(64) && episode.world().has_diverged() {
                break;
            }
        }
        self.shaken = Some(episode);
        Ok(true)
    }

    /// The episode as it stands; after a shake, as it stood before.
    pub fn episode(&self) -> &Episode {
        &self.episode
    }

    /// The episode as the trial leaves it, without the shake.
    pub fn into_episode(self) -> Episode {
        self.episode
    }

    fn steps(&self, time: f64) -> u64 {
        (time / self.episode.world().dt()).round() as u64
    }

    /// Goes on up to step `end`, unless it is over before; false if `stop` said so.
    fn until(&mut self, end: u64, stop: &dyn Fn() -> bool) -> Result<bool, EpisodeError> {
        let dt = self.episode.world().dt();
        let (close, read_at) = (self.steps(self.config.close_time), self.steps(READ_TIME));
        while self.step < end && self.over.is_none() {
            if self.step.is_multiple_of(64) && stop() {
                return Ok(false);
            }
            self.step += 1;
            let target = self.target(self.step as f64 * dt);
            self.episode.advance(&target, &self.close)?;
            if let Some(study) = &mut self.study {
                study.observe(self.episode.world());
            }
            if let Some(trace) = &mut self.trace
                && self.step.is_multiple_of(self.sample_every)
            {
                trace.push(Sample::of(&self.episode));
            }
            if self.step == read_at {
                self.reading = self.study.as_ref().map(|study| study.read(&self.episode));
            }
            let looks = self.step > close && self.step.is_multiple_of(LOOK_EVERY);
            self.touched |= looks && self.touches();
            if looks && self.ends_early() && self.out_of_reach() {
                self.over = Some(None);
            } else if self.step.is_multiple_of(64) && self.episode.world().has_diverged() {
                self.over = Some(Some(FailureKind::Unstable));
            }
        }
        Ok(true)
    }

    /// Where the hand is to be `time` seconds after closing began: still, then up along a minimum-jerk curve, then still.
    fn target(&self, time: f64) -> Isometry3<f64> {
        let rise = self.config.lift_height * minimum_jerk((time - self.config.close_time) / self.config.lift_time);
        Translation3::new(0.0, 0.0, rise) * self.start
    }

    fn ends_early(&self) -> bool {
        self.config.early_stop && (!self.config.legacy || self.reading.is_some())
    }

    fn touches(&self) -> bool {
        !self.episode.world().contacts().links.is_empty()
    }

    /// True once the object cannot be held high enough at the end any more, even if the hand meets it now and carries it up.
    fn out_of_reach(&self) -> bool {
        let verdict = self.episode.verdict();
        let reach = verdict.lift + (self.config.lift_height - verdict.hand_lift) + CURL_RISE;
        reach < self.episode.judge().criterion().lift_height
    }

    /// What came of it, once it is over.
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
        let center = self.episode.scene().center_of_mass();
        let shift =
            |shaken: &Episode| (shaken.world().hand_from_object() * center - world.hand_from_object() * center).norm();
        TrialOutcome {
            success,
            secure: success && verdict.secure,
            failure: (!success).then_some(why),
            lift: verdict.lift,
            kindness_rate: self.study.as_ref().map(|study| study.kindness_rate(world)),
            legacy_success: self.reading.map(|reading| reading.success),
            kindness: self.reading.map(|reading| reading.kindness),
            survives_shake: self.config.shake.map(|_| self.shaken.as_ref().is_some_and(survives)),
            shake_shift: self.shaken.as_ref().map(shift),
            time: end.time(),
            unconverged_steps: end.unconverged_steps(),
        }
    }
}

/// Share of the way after the share `time` of the duration, along the smoothest start and stop: s^3 (10 - 15 s + 6 s^2).
///
/// Source: Flash, Hogan, "The coordination of arm movements: an experimentally confirmed mathematical model", 1985.
pub fn minimum_jerk(time: f64) -> f64 {
    let s = time.clamp(0.0, 1.0);
    s * s * s * (10.0 + s * (6.0 * s - 15.0))
}

impl TrialOutcome {
    /// The outcome of a pose that collides before anything moves.
    ///
    /// * `shake`: the trial would have ended with one.
    pub fn infeasible(shake: bool) -> Self {
        Self {
            success: false,
            secure: false,
            failure: Some(FailureKind::Infeasible),
            lift: 0.0,
            kindness_rate: Some(0.0),
            legacy_success: None,
            kindness: None,
            survives_shake: shake.then_some(false),
            shake_shift: None,
            time: 0.0,
            unconverged_steps: 0,
        }
    }
}
