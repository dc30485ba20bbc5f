//! Environments of procedural objects, and a driver that follows a planned grasp by ordinary actions.

use graspbox_episode::TrialConfig;
use graspbox_episode::trial::minimum_jerk;
use graspbox_gym::actions::control::CONTROL_PERIOD;
use graspbox_gym::actions::workspace::{WORKSPACE_HIGH, WORKSPACE_LOW};
use graspbox_gym::observations::info::InfoArray;
use graspbox_gym::rewards::reward::{TERM_COUNT, TermValues};
use graspbox_gym::{Batch, Control, EnvConfig, EnvPool, Fingers, Objects, ResetOptions, Source};
use graspbox_hand::{GraspPose, Hand};
use graspbox_objects::Family;
use graspbox_sim::PhysicsConfig;
use nalgebra::{Isometry3, Translation3};
use std::sync::Arc;

/// The objects `families` with seed 0, for the ReFlex.
pub fn objects(families: &[Family]) -> Arc<Objects> {
    let source = |family: &Family| Source::Procedural {
        name: family.name().to_owned(),
        family: *family,
        seed: 0,
        scale: 1.0,
        mass: None,
    };
    let hand = Arc::new(crate::bench::reflex());
    let sources = families.iter().map(source).collect();
    Arc::new(Objects::new(sources, hand, PhysicsConfig::default(), None).unwrap())
}

/// One action per actuator and control period: the space in which these tests move the hand.
pub fn each_period() -> EnvConfig {
    EnvConfig { fingers: Fingers::Each, control_freq: 20.0, ..EnvConfig::default() }
}

/// Environments with a given control mode.
pub fn pool(objects: &Arc<Objects>, control: Control, count: usize) -> Arc<EnvPool> {
    let config = EnvConfig { control, ..each_period() };
    Arc::new(EnvPool::new(Arc::clone(objects), config, count).unwrap())
}

/// Seeds 0, 1, ... for a pool.
pub fn seeds(pool: &EnvPool) -> Vec<Option<u64>> {
    (0..pool.len() as u64).map(Some).collect()
}

/// Every number of a batch, as bits.
pub fn batch_bits(batch: &Batch) -> Vec<u64> {
    (0..batch.len()).flat_map(|row| row_bits(batch, row)).collect()
}

/// Every number of a row of a batch but the index of its environment, as bits.
pub fn row_bits(batch: &Batch, row: usize) -> Vec<u64> {
    let numbers = batch.observations.iter().chain([&batch.terms]).flat_map(|values| {
        let size = values.len() / batch.len();
        values[row * size..(row + 1) * size].iter().map(|value| u64::from(value.to_bits()))
    });
    let flags = [&batch.terminated, &batch.truncated, &batch.reset].map(|values| u64::from(values[row]));
    let info = batch.info.iter().map(|values| match values {
        InfoArray::Flags(values) => u64::from(values[row]),
        InfoArray::Numbers(values) => values[row].to_bits(),
        InfoArray::Indices(values) => values[row] as u64,
    });
    numbers.chain(flags).chain(info).collect()
}

/// An entry of the infos that holds truth values.
pub fn flags<'a>(batch: &'a Batch, name: &str) -> &'a [bool] {
    match batch.info(name).unwrap() {
        InfoArray::Flags(values) => values,
        other => panic!("{name} is {other:?}"),
    }
}

/// An entry of the infos that holds numbers.
pub fn numbers<'a>(batch: &'a Batch, name: &str) -> &'a [f64] {
    match batch.info(name).unwrap() {
        InfoArray::Numbers(values) => values,
        other => panic!("{name} is {other:?}"),
    }
}

/// An entry of the infos that holds integers or indices into names.
pub fn indices<'a>(batch: &'a Batch, name: &str) -> &'a [i64] {
    match batch.info(name).unwrap() {
        InfoArray::Indices(values) => values,
        other => panic!("{name} is {other:?}"),
    }
}

/// The `target_pose` action that sends the hand to `world_from_hand`; fingers close with `spool` in [-1, 1].
pub fn target(hand: &Hand, world_from_hand: &Isometry3<f64>, spool: f64, preshape: f64) -> Vec<f32> {
    let mut action: Vec<f64> = (0..3)
        .map(|i| {
            let (low, high) = (WORKSPACE_LOW[i], WORKSPACE_HIGH[i]);
            2.0 * (world_from_hand.translation.vector[i] - low) / (high - low) - 1.0
        })
        .collect();
    let turn = world_from_hand.rotation.to_rotation_matrix();
    action.extend((0..6).map(|i| turn[(i % 3, i / 3)]));
    let [low, high] = hand.preshape_limits();
    let shape = hand.grasp.coordinate.map(|coordinate| coordinate.actuator);
    let share = 2.0 * (preshape - low) / (high - low) - 1.0;
    action.extend((0..hand.actuators.len()).map(|index| if shape == Some(index) { share } else { spool }));
    action.into_iter().map(|x| x as f32).collect()
}

/// Outcome of a grasp that was executed by actions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Driven {
    /// It succeeded.
    pub success: bool,
    /// Failure code at the end.
    pub failure: i64,
    /// Actions that were sent.
    pub steps: usize,
    /// Of these, with the protective stop active.
    pub stopped: usize,
    /// Reward terms, summed.
    pub terms: TermValues,
}

/// Follows `grasp` in environment 0 of a pool of one in `target_pose` mode: over the object, to the standoff, down, close, lift, hold.
pub fn follow(pool: &EnvPool, options: &ResetOptions, seed: u64, grasp: &GraspPose) -> Driven {
    follow_until(pool, options, seed, grasp, |_| false)
}

/// As [`follow`], until `enough` says so after a step.
pub fn follow_until(
    pool: &EnvPool,
    options: &ResetOptions,
    seed: u64,
    grasp: &GraspPose,
    enough: impl FnMut(&Batch) -> bool,
) -> Driven {
    pool.reset(&[Some(seed)], None, options).unwrap();
    let trial = TrialConfig::default();
    let (start, object) = {
        let env = pool.env(0).unwrap();
        let world = env.episode().unwrap().episode().world();
        (world.world_from_hand(), world.world_from_object())
    };
    let goal = object * grasp.object_from_hand;
    let standoff = goal * Translation3::new(0.0, 0.0, -trial.standoff);
    let high = start.translation.vector.z.max(standoff.translation.vector.z).max(0.35);
    let over = |pose: &Isometry3<f64>| {
        let mut pose = *pose;
        pose.translation.vector.z = high;
        pose
    };
    let mut driver = Driver::new(pool, grasp.preshape, enough);
    for pose in [over(&start), over(&standoff), standoff, goal] {
        driver.approach(&pose);
    }
    let close = 3.0 / 3.5;
    let steps = |time: f64| (time / CONTROL_PERIOD).round() as usize;
    for _ in 0..steps(trial.close_time) {
        driver.go(&goal, close);
    }
    for i in 1..=steps(trial.lift_time) + steps(2.0) {
        let rise = trial.lift_height * minimum_jerk(i as f64 * CONTROL_PERIOD / trial.lift_time);
        driver.go(&(Translation3::new(0.0, 0.0, rise) * goal), close);
    }
    driver.driven
}

/// Sends target poses to environment 0 until its episode ends, or `enough` returns true, and adds up the results.
struct Driver<'a, Enough> {
    pool: &'a EnvPool,
    preshape: f64,
    enough: Enough,
    driven: Driven,
    ended: bool,
}

impl<'a, Enough: FnMut(&Batch) -> bool> Driver<'a, Enough> {
    fn new(pool: &'a EnvPool, preshape: f64, enough: Enough) -> Self {
        let driven = Driven { success: false, failure: 0, steps: 0, stopped: 0, terms: [0.0; TERM_COUNT] };
        Self { pool, preshape, enough, driven, ended: false }
    }

    /// One step towards `pose`; fingers close with `spool` in [-1, 1].
    fn go(&mut self, pose: &Isometry3<f64>, spool: f64) {
        if self.ended {
            return;
        }
        let action = target(self.pool.spec().hand(), pose, spool, self.preshape);
        let batch = self.pool.step(&action).unwrap().now;
        let driven = &mut self.driven;
        driven.success = flags(&batch, "is_success")[0];
        driven.failure = indices(&batch, "failure")[0];
        driven.steps += 1;
        driven.stopped += usize::from(flags(&batch, "protective_stop")[0]);
        driven.terms.iter_mut().zip(&batch.terms).for_each(|(sum, term)| *sum += term);
        self.ended = batch.terminated[0] || (self.enough)(&batch);
    }

    /// Open fingers, until the hand rests at `pose`, for at most 80 steps.
    fn approach(&mut self, pose: &Isometry3<f64>) {
        for _ in 0..80 {
            if self.ended || self.is_at(pose) {
                break;
            }
            self.go(pose, -1.0);
        }
    }

    fn is_at(&self, pose: &Isometry3<f64>) -> bool {
        let env = self.pool.env(0).unwrap();
        let arm = env.episode().unwrap().arm();
        let (at, still) = (*arm.estimated_pose(), arm.velocity().0.norm() < 0.005);
        still
            && (at.translation.vector - pose.translation.vector).norm() < 5e-4
            && at.rotation.angle_to(&pose.rotation) < 5e-3
    }
}
