//! Trials with their feasibility check: many on rayon, results in the order of the poses, whatever the number of threads; or one, traced.

use crate::sample::Sample;
use crate::trial::{Finished, Trial, TrialConfig, TrialOutcome};
use crate::{EpisodeError, Scene};
use graspbox_hand::{GraspPose, Hand};
use graspbox_mesh::in_range;
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

/// No pose puts the hand further than this from the object's origin, metres: more is a pose in millimetres.
pub const FURTHEST: f64 = 10.0;
/// A preshape may lie beyond the hand's limits by this much: the rounding of a float32.
const ROUNDING: f64 = 1e-6;

/// Least and greatest factor on an object's friction or mass: beyond them an object is another one.
const FACTORS: [f64; 2] = [0.01, 100.0];

/// Shared between a running batch and whoever watches it.
#[derive(Debug, Default)]
pub struct Progress {
    done: AtomicUsize,
    stop: AtomicBool,
}

impl Progress {
    /// Trials that are finished.
    pub fn done(&self) -> usize {
        self.done.load(Ordering::Relaxed)
    }

    /// Asks the batch to stop; it does so within a fraction of a second.
    pub fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// True once the batch was asked to stop.
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
/// An impossible setting, pose or preshape, which is named, or [`EpisodeError::Cancelled`] when `progress` was told to stop.
pub fn run_trials(
    scene: &Arc<Scene>,
    poses: &[GraspPose],
    config: TrialConfig,
    progress: &Progress,
) -> Result<Vec<TrialOutcome>, EpisodeError> {
    run_scaled_trials(scene, poses, &vec![[1.0, 1.0]; poses.len()], config, progress)
}

/// As [`run_trials`], with the object's friction and mass multiplied by the `factors` of each trial.
///
/// # Errors
/// As [`run_trials`]; [`EpisodeError::OutOfRange`] for a factor outside 0.01 to 100, and where there are more or fewer factors than poses.
pub fn run_scaled_trials(
    scene: &Arc<Scene>,
    poses: &[GraspPose],
    factors: &[[f64; 2]],
    config: TrialConfig,
    progress: &Progress,
) -> Result<Vec<TrialOutcome>, EpisodeError> {
    check_config(scene, &config)?;
    check_poses(scene.template().hand(), poses)?;
    let count = poses.len() as f64;
    in_range("number of factors", factors.len() as f64, count..=count, "(one pair for each pose)")?;
    for [friction, mass] in factors {
        in_range("friction factor", *friction, FACTORS[0]..=FACTORS[1], "")?;
        in_range("mass factor", *mass, FACTORS[0]..=FACTORS[1], "")?;
    }
    let one = |(pose, factors): (&GraspPose, &[f64; 2])| -> Result<Option<TrialOutcome>, EpisodeError> {
        if progress.stopped() {
            return Ok(None);
        }
        let finished = attempt(scene, pose, *factors, config, false, progress)?;
        progress.step();
        Ok(finished.map(|(outcome, _)| outcome))
    };
    let all = poses.par_iter().zip(factors);
    let outcomes = all.map(one).collect::<Result<Vec<Option<TrialOutcome>>, EpisodeError>>()?;
    let total = outcomes.len();
    let finished: Vec<TrialOutcome> = outcomes.into_iter().flatten().collect();
    if finished.len() < total {
        return Err(EpisodeError::Cancelled { done: finished.len(), total });
    }
    Ok(finished)
}

/// One trial as [`run_trials`] runs it, with what happened every 10 ms. A pose that the open hand does not reach gives an infeasible
/// outcome, and no sample: nothing moved.
///
/// # Errors
/// As [`run_trials`].
pub fn trace_trial(
    scene: &Arc<Scene>,
    pose: &GraspPose,
    config: TrialConfig,
    progress: &Progress,
) -> Result<(TrialOutcome, Vec<Sample>), EpisodeError> {
    check_config(scene, &config)?;
    check_poses(scene.template().hand(), std::slice::from_ref(pose))?;
    let finished = attempt(scene, pose, [1.0, 1.0], config, true, progress)?;
    let (outcome, trace) = finished.ok_or(EpisodeError::Cancelled { done: 0, total: 1 })?;
    Ok((outcome, trace.unwrap_or_default()))
}

/// Refuses settings that cannot be, or that the time step of the scene does not resolve.
///
/// # Errors
/// [`EpisodeError::OutOfRange`], naming the first setting that is out of range.
fn check_config(scene: &Scene, config: &TrialConfig) -> Result<(), EpisodeError> {
    config.validate()?;
    config.check_time_step(scene.template().config().dt)
}

/// Refuses poses that no trial can mean.
///
/// # Errors
/// [`EpisodeError::BadPose`] for a pose that is not finite or further than [`FURTHEST`] from the object, [`EpisodeError::BadPreshape`]
/// for a preshape beyond the hand's limits.
fn check_poses(hand: &Hand, poses: &[GraspPose]) -> Result<(), EpisodeError> {
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

/// Checks a pose and tries it; none when `progress` was told to stop.
fn attempt(
    scene: &Arc<Scene>,
    pose: &GraspPose,
    factors: [f64; 2],
    config: TrialConfig,
    trace: bool,
    progress: &Progress,
) -> Result<Option<Finished>, EpisodeError> {
    if scene.reachable(pose, config.standoff)? {
        Trial::scaled(scene, pose, factors, config, trace).run(&|| progress.stopped())
    } else {
        Ok(Some((TrialOutcome::infeasible(config.shake.is_some()), None)))
    }
}
