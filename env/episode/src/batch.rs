//! Trials with their feasibility check: many on rayon, with results in the order of the poses for any number of threads, or one with its trace.

use crate::approach::{Approach, approach};
use crate::observer::Observer;
use crate::trial::{Finished, Trial, TrialConfig, TrialOutcome};
use crate::{Episode, EpisodeError, Scene};
use graspbox_hand::{GraspPose, Hand};
use graspbox_mesh::in_range;
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// Greatest distance of a hand pose from the object's origin, metres: poses beyond it are in millimetres.
pub const FURTHEST: f64 = 10.0;
/// A preshape may exceed the hand's limits by this, rad or m: the rounding of a float32.
const ROUNDING: f64 = 1e-6;

/// Least and greatest factor on an object's friction or mass, dimensionless: values beyond them are errors of the caller.
const FACTORS: [f64; 2] = [0.01, 100.0];

/// Most masses that a closed hand lifts.
const MOST_MASSES: f64 = 64.0;

/// Progress of a batch, shared between the batch and its caller.
#[derive(Debug, Default)]
pub struct Progress {
    done: AtomicUsize,
    stop: AtomicBool,
}

impl Progress {
    /// Number of finished trials.
    pub fn done(&self) -> usize {
        self.done.load(Ordering::Relaxed)
    }

    /// Stops the batch within a fraction of a second.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// True after a request to stop.
    pub fn stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    pub(crate) fn step(&self) {
        self.done.fetch_add(1, Ordering::Relaxed);
    }
}

/// Tries every pose (`object_from_hand`) on the scene's object, in parallel on the current rayon pool.
///
/// # Errors
/// [`EpisodeError::OutOfRange`], [`EpisodeError::BadPose`] or [`EpisodeError::BadPreshape`], naming the value, or
/// [`EpisodeError::Cancelled`] if `progress` was cancelled.
pub fn run_trials(
    scene: &Arc<Scene>,
    poses: &[GraspPose],
    config: TrialConfig,
    progress: &Progress,
) -> Result<Vec<TrialOutcome>, EpisodeError> {
    let factors = vec![[1.0, 1.0]; poses.len()];
    let finished = run_observed_trials(scene, poses, &factors, config, progress, |_| ())?;
    Ok(finished.into_iter().map(|trial| trial.outcome).collect())
}

/// As [`run_trials`], with the object's friction and mass multiplied by the `factors` of each trial, and an observer for each.
///
/// * `observer`: makes the observer of a trial from its episode before the first step.
///
/// # Errors
/// As [`run_trials`]; [`EpisodeError::OutOfRange`] also for a factor outside 0.01 to 100, and if the number of factors is not that of the poses.
pub fn run_observed_trials<O: Observer + Send>(
    scene: &Arc<Scene>,
    poses: &[GraspPose],
    factors: &[[f64; 2]],
    config: TrialConfig,
    progress: &Progress,
    observer: impl Fn(&Episode) -> O + Sync,
) -> Result<Vec<Finished<O>>, EpisodeError> {
    check_config(scene, &config)?;
    check_poses(scene.template().hand(), poses)?;
    check_factors(factors, poses.len())?;
    let one = |(pose, factors): (&GraspPose, &[f64; 2])| -> Result<Option<Finished<O>>, EpisodeError> {
        if progress.stopped() {
            return Ok(None);
        }
        let finished = attempt(scene, pose, *factors, config, false, progress, &observer)?;
        progress.step();
        Ok(finished)
    };
    let all = poses.par_iter().zip(factors);
    let trials = all.map(one).collect::<Result<Vec<Option<Finished<O>>>, EpisodeError>>()?;
    let total = trials.len();
    let finished: Vec<Finished<O>> = trials.into_iter().flatten().collect();
    if finished.len() < total {
        return Err(EpisodeError::Cancelled { done: finished.len(), total });
    }
    Ok(finished)
}

/// Tries every pose with several masses: the hand closes once, and lifts in a copy of the world for each. Much cheaper than a trial for each
/// mass, since closing takes most of the time of a trial.
///
/// * `masses`: factors on the mass of every object, at least one; the hand closes on the first. Once a mass is lost, those after it count as
///   lost in the same way.
///
/// Outcomes are one row per pose, one entry per mass.
///
/// # Errors
/// As [`run_observed_trials`]; [`EpisodeError::OutOfRange`] also for no mass, or more than 64.
pub fn run_loaded_trials(
    scene: &Arc<Scene>,
    poses: &[GraspPose],
    masses: &[f64],
    config: TrialConfig,
    progress: &Progress,
) -> Result<Vec<Vec<TrialOutcome>>, EpisodeError> {
    check_config(scene, &config)?;
    check_poses(scene.template().hand(), poses)?;
    let factors: Vec<[f64; 2]> = masses.iter().map(|mass| [1.0, *mass]).collect();
    in_range("number of masses", masses.len() as f64, 1.0..=MOST_MASSES, "")?;
    check_factors(&factors, masses.len())?;
    let rows = poses.par_iter().map(|pose| {
        let row = if progress.stopped() { None } else { loaded_trials(scene, pose, masses, config, progress)? };
        progress.step();
        Ok(row)
    });
    let rows = rows.collect::<Result<Vec<Option<Vec<TrialOutcome>>>, EpisodeError>>()?;
    let total = rows.len();
    let finished: Vec<_> = rows.into_iter().flatten().collect();
    if finished.len() < total {
        return Err(EpisodeError::Cancelled { done: finished.len(), total });
    }
    Ok(finished)
}

/// The outcome of one pose for each mass; `None` if `progress` was cancelled.
fn loaded_trials(
    scene: &Arc<Scene>,
    pose: &GraspPose,
    masses: &[f64],
    config: TrialConfig,
    progress: &Progress,
) -> Result<Option<Vec<TrialOutcome>>, EpisodeError> {
    let stop = || progress.stopped();
    let mut outcomes = Vec::with_capacity(masses.len());
    if !scene.reachable(pose, config.standoff)? {
        outcomes.resize(masses.len(), TrialOutcome::infeasible(config.shake.is_some()));
        return Ok(Some(outcomes));
    }
    let mut closed = Trial::new(scene, pose, [1.0, masses[0]], config, |_| (), false);
    if !closed.close(&stop)? {
        return Ok(None);
    }
    for mass in masses {
        let mut trial = closed.loaded(mass / masses[0]);
        if !(trial.lift(&stop)? && trial.shake(&stop)?) {
            return Ok(None);
        }
        let outcome = trial.outcome();
        let lost = !outcome.success;
        outcomes.push(outcome);
        if lost {
            break;
        }
    }
    let last = outcomes[outcomes.len() - 1].clone();
    outcomes.resize(masses.len(), last);
    Ok(Some(outcomes))
}

/// One trial as [`run_observed_trials`] runs it, with its trace. A pose that the open hand does not reach has an infeasible
/// outcome without samples.
///
/// # Errors
/// As [`run_observed_trials`].
pub fn trace_trial<O: Observer>(
    scene: &Arc<Scene>,
    pose: &GraspPose,
    factors: [f64; 2],
    config: TrialConfig,
    progress: &Progress,
    observer: impl Fn(&Episode) -> O,
) -> Result<Finished<O>, EpisodeError> {
    check_config(scene, &config)?;
    check_poses(scene.template().hand(), std::slice::from_ref(pose))?;
    check_factors(&[factors], 1)?;
    let finished = attempt(scene, pose, factors, config, true, progress, &observer)?;
    finished.ok_or(EpisodeError::Cancelled { done: 0, total: 1 })
}

/// Checks the settings, and that the time step of the scene resolves the motion.
///
/// # Errors
/// [`EpisodeError::OutOfRange`], naming the first setting that is out of range.
fn check_config(scene: &Scene, config: &TrialConfig) -> Result<(), EpisodeError> {
    config.validate()?;
    config.check_time_step(scene.template().config().dt)
}

/// Checks the factors on friction and mass of `count` trials.
fn check_factors(factors: &[[f64; 2]], count: usize) -> Result<(), EpisodeError> {
    let count = count as f64;
    in_range("number of factors", factors.len() as f64, count..=count, "(one pair for each pose)")?;
    for [friction, mass] in factors {
        in_range("friction factor", *friction, FACTORS[0]..=FACTORS[1], "")?;
        in_range("mass factor", *mass, FACTORS[0]..=FACTORS[1], "")?;
    }
    Ok(())
}

/// Checks that poses are near the object and preshapes within the hand's limits.
///
/// # Errors
/// [`EpisodeError::BadPose`] for a pose that is not finite or farther than [`FURTHEST`] from the object, [`EpisodeError::BadPreshape`]
/// for a preshape beyond the hand's limits.
pub(crate) fn check_poses(hand: &Hand, poses: &[GraspPose]) -> Result<(), EpisodeError> {
    let [low, high] = hand.preshape_limits();
    for (index, pose) in poses.iter().enumerate() {
        let at = &pose.object_from_hand;
        let distance = at.translation.vector.norm();
        if !(distance <= FURTHEST && at.rotation.coords.iter().all(|x| x.is_finite())) {
            return Err(EpisodeError::BadPose { index, distance, limit: FURTHEST });
        }
        let value = pose.preshape;
        if !(low - ROUNDING..=high + ROUNDING).contains(&value) {
            return Err(EpisodeError::BadPreshape { index, value, low, high, unit: hand.preshape_unit() });
        }
    }
    Ok(())
}

/// Checks the reachability of a pose and tries it; `None` if `progress` was cancelled.
fn attempt<O: Observer>(
    scene: &Arc<Scene>,
    pose: &GraspPose,
    factors: [f64; 2],
    config: TrialConfig,
    trace: bool,
    progress: &Progress,
    observer: &impl Fn(&Episode) -> O,
) -> Result<Option<Finished<O>>, EpisodeError> {
    let stop = || progress.stopped();
    if scene.reachable(pose, config.standoff)? {
        return Trial::new(scene, pose, factors, config, observer, trace).run(&stop);
    }
    let object = scene.world_from_object();
    if scene.is_any_target()
        && let Approach::Arrived(episode) = approach(scene, pose, object, factors, config.success, config.standoff)?
    {
        let (start, observer) = (object * pose.object_from_hand, observer(&episode));
        return Trial::of(episode, &start, pose.preshape, config, observer, trace).run(&stop);
    }
    let outcome = TrialOutcome::infeasible(config.shake.is_some());
    Ok(Some(Finished { outcome, trace: Vec::new(), observer: None }))
}
