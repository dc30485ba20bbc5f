//! The scripted driver: approach, close, lift, hold. It drives the same [`Episode`] as an agent does.

use crate::episode::Episode;
use crate::judge::{FailureKind, SuccessCriterion};
use crate::study::{READ_TIME, Reading, SAMPLE_PERIOD, Study, distance};
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
        Ok(in_range("hold_time", self.hold_time, self.success.hold_time..=60.0, "s")?)
    }
}

/// What came of a trial.
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
    /// Simulated seconds.
    pub time: f64,
    /// Steps in which the solver found no balance of forces; 0 for an engine that does not measure it.
    pub unconverged_steps: u64,
}

/// One row of a trial's trace, every 10 ms.
#[derive(Clone, Debug, PartialEq)]
pub struct Sample {
    /// Seconds since closing began.
    pub time: f64,
    /// Distance between hand frame and object frame, metres.
    pub distance: f64,
    /// Grasp frame in the world.
    pub world_from_hand: Isometry3<f64>,
    /// Object in the world.
    pub world_from_object: Isometry3<f64>,
    /// Positions of the hand's independent joints, rad or m.
    pub joints: Vec<f64>,
    /// Positions of its actuators, rad or m.
    pub actuators: Vec<f64>,
    /// Loads on its actuators, N or N m.
    pub loads: Vec<f64>,
    /// Tension of every tendon, N.
    pub tensions: Vec<f64>,
    /// Sum of the normal forces between hand and object, N.
    pub hand_force: f64,
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
    contact_lost: u64,
    /// The hand touched the object at some time since lifting began.
    touched: bool,
    /// It ended before its time, and why if it is known already.
    over: Option<Option<FailureKind>>,
    /// The study's measures, where they are asked for, and what they said.
    study: Option<Study>,
    reading: Option<Reading>,
    trace: Option<Vec<Sample>>,
}

/// Steps without contact, seconds, after which an object in the air is lost.
const LOST_AFTER: f64 = 0.06;
/// Steps between two checks for contact.
const LOOK_EVERY: u64 = 5;
/// An object that lies in a closed hand without touching them is met by the time the hand has risen this far, metres.
const MEETS_WITHIN: f64 = 0.05;
/// The object may rise relative to the hand by this much while fingers settle, metres.
const CURL_RISE: f64 = 0.03;

impl Trial {
    /// Begins a trial with the hand at `pose`, and watches the study's measures; the caller has checked that pose and approach are free of collision.
    pub fn new(scene: &Arc<Scene>, pose: &GraspPose, config: TrialConfig, trace: bool) -> Self {
        let start = scene.world_from_object() * pose.object_from_hand;
        let episode = Episode::reset(scene, &start, pose.preshape, config.success);
        let study = Study::new(&episode);
        Self { study: Some(study), ..Self::of(episode, &start, pose.preshape, config, trace) }
    }

    /// Begins a trial of a fresh episode, whose hand stands open at `start` (world) with `preshape`, without the study's measures.
    pub fn of(episode: Episode, start: &Isometry3<f64>, preshape: f64, config: TrialConfig, trace: bool) -> Self {
        let hand = Arc::clone(episode.world().hand());
        let close = hand.closed_positions(preshape).into_iter();
        let close = close.map(|target| ActuatorCommand::Position { target, speed: None }).collect();
        let trace = trace.then(Vec::new);
        Self {
            episode,
            config,
            start: *start,
            close,
            step: 0,
            contact_lost: 0,
            touched: false,
            over: None,
            study: None,
            reading: None,
            trace,
        }
    }

    /// Runs to the end; `stop` is asked now and then and ends the trial when it says so (then the result is none).
    ///
    /// # Errors
    /// An actuator command that is not finite, which a finite pose never gives.
    pub fn run(mut self, stop: &dyn Fn() -> bool) -> Result<Option<Finished>, EpisodeError> {
        let finished = self.close(stop)? && self.lift(stop)?;
        Ok(finished.then(|| (self.outcome(), self.trace)))
    }

    /// Closes the hand; false if `stop` said so.
    ///
    /// # Errors
    /// As [`Trial::run`].
    pub fn close(&mut self, stop: &dyn Fn() -> bool) -> Result<bool, EpisodeError> {
        self.sample();
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

    /// The episode as it stands.
    pub fn episode(&self) -> &Episode {
        &self.episode
    }

    /// The episode as the trial leaves it.
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
        let sample_every = self.steps(SAMPLE_PERIOD).max(1);
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
            if self.step.is_multiple_of(sample_every) {
                self.sample();
            }
            if self.step == read_at {
                self.reading = self.study.as_ref().map(|study| study.read(&self.episode));
            }
            if self.step > close && self.step.is_multiple_of(LOOK_EVERY) {
                self.look_for_contact();
            }
            if self.step > close && self.ends_early() && self.hopeless(dt) {
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

    fn look_for_contact(&mut self) {
        let touches = self.touches();
        self.touched |= touches;
        self.contact_lost = if touches { 0 } else { self.contact_lost + LOOK_EVERY };
    }

    /// True once the object cannot be held high enough at the end any more.
    fn hopeless(&self, dt: f64) -> bool {
        if !self.step.is_multiple_of(LOOK_EVERY) {
            return false;
        }
        let verdict = self.episode.verdict();
        let lost = self.contact_lost as f64 * dt >= LOST_AFTER && verdict.hand_lift >= MEETS_WITHIN;
        let reach = verdict.lift + (self.config.lift_height - verdict.hand_lift) + CURL_RISE;
        lost || reach < self.episode.judge().criterion().lift_height
    }

    fn sample(&mut self) {
        let Some(trace) = &mut self.trace else { return };
        let world = self.episode.world();
        trace.push(Sample {
            time: world.time(),
            distance: distance(world, &self.episode.scene().base_point()),
            world_from_hand: world.world_from_hand(),
            world_from_object: world.world_from_object(),
            joints: world.configuration(),
            actuators: world.actuators().iter().map(|actuator| actuator.position).collect(),
            loads: (0..world.actuators().len()).map(|actuator| world.load(actuator)).collect(),
            tensions: (0..world.hand().tendons.len()).map(|tendon| world.tension(tendon)).collect(),
            hand_force: world.contacts().hand_force,
        });
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
        TrialOutcome {
            success,
            secure: success && verdict.secure,
            failure: (!success).then_some(why),
            lift: verdict.lift,
            kindness_rate: self.study.as_ref().map(|study| study.kindness_rate(world)),
            legacy_success: self.reading.map(|reading| reading.success),
            kindness: self.reading.map(|reading| reading.kindness),
            time: world.time(),
            unconverged_steps: world.unconverged_steps(),
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
    pub fn infeasible() -> Self {
        Self {
            success: false,
            secure: false,
            failure: Some(FailureKind::Infeasible),
            lift: 0.0,
            kindness_rate: Some(0.0),
            legacy_success: None,
            kindness: None,
            time: 0.0,
            unconverged_steps: 0,
        }
    }
}
