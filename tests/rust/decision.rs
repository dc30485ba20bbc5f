//! One decision per episode: the environment returns the verdicts of a batch of trials, whatever else runs at the same time.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_episode::{Progress, Scene, TrialConfig, run_trials};
use graspbox_gym::actions::action::pose_and_preshape;
use graspbox_gym::{Autoreset, Control, EnvConfig, EnvPool, Objects, Observation, Randomization, ResetOptions};
use graspbox_hand::GraspPose;
use graspbox_objects::Family;
use graspbox_tests::bench::in_pool;
use graspbox_tests::gym::{batch_bits, flags, indices, numbers, objects, seeds};
use nalgebra::{Isometry3, Matrix3, Rotation3, Vector3};
use std::sync::Arc;

const FAMILIES: [Family; 3] = [Family::Box, Family::Can, Family::Ball];
/// Index of a reward term.
const REACH: usize = 0;
const TERMS: usize = graspbox_gym::rewards::reward::TERM_COUNT;

fn decisions(objects: &Arc<Objects>, count: usize, randomization: Randomization) -> EnvPool {
    let config = EnvConfig {
        control: Control::GraspPose,
        autoreset: Autoreset::SameStep,
        observations: vec![Observation::State],
        randomization,
        ..EnvConfig::default()
    };
    EnvPool::new(Arc::clone(objects), config, count).unwrap()
}

/// Poses around and above the middle of the table, the palm down but for some tilt.
fn action(seed: usize) -> Vec<f32> {
    let at = |k: usize| ((seed * 7 + k * 13) as f64 * 0.618_034).fract();
    let down = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
    let yaw = Rotation3::from_axis_angle(&Vector3::z_axis(), 6.3 * at(0));
    let tilt = Rotation3::from_axis_angle(&Vector3::x_axis(), 1.2 * at(1) - 0.6);
    let turn = (yaw * tilt).matrix() * down;
    let mut numbers = vec![0.8 * at(2) - 0.4, 0.8 * at(3) - 0.4, 1.2 * at(4) - 0.9];
    numbers.extend((0..6).map(|i| turn[(i % 3, i / 3)]));
    numbers.push(2.0 * at(5) - 1.0);
    numbers.into_iter().map(|x| x as f32).collect()
}

fn actions(pool: &EnvPool, step: usize) -> Vec<f32> {
    (0..pool.len()).flat_map(|env| action(100 * step + env)).collect()
}

/// Scene and object pose of an environment.
fn lies(pool: &EnvPool, env: usize) -> (Arc<Scene>, Isometry3<f64>) {
    let env = pool.env(env).unwrap();
    let episode = env.episode().unwrap().episode();
    (Arc::clone(episode.scene()), episode.world().world_from_object())
}

/// Same failure, and lift to two millimetres: the trial is the same but for rounding, since the table stands elsewhere. Attempts that are
/// out of reach are not simulated; their trials touch nothing.
#[test]
fn a_decision_is_a_trial() {
    let pool = decisions(&objects(&FAMILIES), 12, Randomization::default());
    pool.reset(&seeds(&pool), None, &ResetOptions::default()).unwrap();
    let (mut same, mut total, mut kinds) = (0, 0, [0; 6]);
    for step in 0..4 {
        let before: Vec<_> = (0..pool.len()).map(|env| lies(&pool, env)).collect();
        let stepped = pool.step(&actions(&pool, step)).unwrap();
        let last = &stepped.last;
        assert_eq!(last.len(), pool.len());
        for (env, (scene, object)) in before.iter().enumerate() {
            let row = last.envs.iter().position(|e| *e == env).unwrap();
            let action = action(100 * step + env);
            let (hand, preshape) = pose_and_preshape(Control::GraspPose, &action, pool.spec().hand()).unwrap();
            let object_from_hand = object.inverse() * hand;
            let grasp = GraspPose { object_from_hand, preshape };
            let trial = &run_trials(scene, &[grasp], TrialConfig::default(), &Progress::default()).unwrap()[0];
            let failure = trial.failure.map_or(0, |f| f as i64 + 1);
            kinds[failure as usize] += 1;
            total += 1;
            let lift = (numbers(last, "lift")[row] - trial.lift).abs() < 2e-3 || failure == 5;
            same += usize::from(
                indices(last, "failure")[row] == failure && lift && flags(last, "is_success")[row] == trial.success,
            );
        }
    }
    // Where contact is a matter of rounding the verdict is too.
    assert!(same + 3 >= total, "{same} of {total}");
    assert!(kinds[0] >= 3 && kinds[1] >= 3 && kinds[2] >= 3, "{kinds:?}");
}

#[test]
fn results_depend_neither_on_neighbors_nor_on_threads() {
    let objects = objects(&FAMILIES);
    let run = |count: usize, threads: usize| -> Vec<Vec<u64>> {
        in_pool(threads, || {
            let pool = decisions(&objects, count, Randomization::standard());
            let first = pool.reset(&seeds(&pool), None, &ResetOptions::default()).unwrap();
            let mut bits = vec![batch_bits(&first)];
            bits.extend((0..2).map(|step| batch_bits(&pool.step(&actions(&pool, step)).unwrap().last)));
            bits
        })
    };
    assert_eq!(run(4, 1), run(4, 3));
    let alone = decisions(&objects, 1, Randomization::standard());
    let beside = decisions(&objects, 4, Randomization::standard());
    let first = alone.reset(&[Some(3)], None, &ResetOptions::default()).unwrap();
    let all = beside.reset(&seeds(&beside), None, &ResetOptions::default()).unwrap();
    let size = first.observations[0].len();
    assert_eq!(first.observations[0], all.observations[0][3 * size..]);
    let one = alone.step(&action(3)).unwrap();
    let every = beside.step(&actions(&beside, 0)).unwrap();
    assert_eq!(one.now.terms, every.now.terms[3 * TERMS..]);
    assert_eq!(one.now.observations[0], every.now.observations[0][3 * size..]);
}

#[test]
fn a_saved_state_goes_on_with_the_same_bits() {
    let objects = objects(&FAMILIES);
    let (pool, other) =
        (decisions(&objects, 1, Randomization::standard()), decisions(&objects, 1, Randomization::standard()));
    pool.reset(&[Some(5)], None, &ResetOptions::default()).unwrap();
    other.reset(&[Some(6)], None, &ResetOptions::default()).unwrap();
    for step in 0..2 {
        let state = pool.env(0).unwrap().save(pool.spec(), 0).unwrap();
        other.env(0).unwrap().restore(other.spec(), &state).unwrap();
        assert_eq!(pool.now().observations, other.now().observations);
        let [ours, theirs] = [&pool, &other].map(|p| p.step(&action(step + 40)).unwrap());
        assert_eq!(batch_bits(&ours.last), batch_bits(&theirs.last));
        assert_eq!(batch_bits(&ours.now), batch_bits(&theirs.now));
    }
}

/// The hand never reaches further than the spec say, however it closes.
#[test]
fn the_reach_of_the_hand_holds_every_part_of_it() {
    let pool = decisions(&objects(&FAMILIES), 1, Randomization::default());
    let hand = pool.spec().hand();
    let reach = pool.spec().reach;
    assert!((0.1..0.3).contains(&reach), "{reach}");
    let [low, high] = hand.preshape_limits();
    for i in 0..40 {
        let share = f64::from(i) / 39.0;
        let mut joints = hand.open_configuration(low + (high - low) * share);
        // After the swivel's position there are two for each finger.
        for finger in joints[1..].chunks_mut(2) {
            finger.copy_from_slice(&[2.8 * share, 2.4 * (1.0 - share)]);
        }
        for link in hand.hand_from_links(&joints).unwrap() {
            assert!(link.translation.vector.norm() < reach);
        }
        for shape in hand.shapes_at(&joints).unwrap() {
            assert!(shape.hand_from_shape.translation.vector.norm() < reach);
        }
    }
}

#[test]
fn what_a_decision_cannot_be_is_refused() {
    let objects = objects(&FAMILIES);
    let pool = decisions(&objects, 1, Randomization::default());
    let options = ResetOptions { preshape: Some(9.0), ..ResetOptions::default() };
    assert!(pool.reset(&[Some(0)], None, &options).unwrap_err().to_string().contains("preshape"));
    pool.reset(&[Some(0)], None, &ResetOptions::default()).unwrap();
    let degenerate = pool.step(&[0.0; 10]).unwrap();
    assert_eq!((degenerate.now.terms[REACH], indices(&degenerate.last, "failure")[0]), (0.0, 1));
    assert!(flags(&degenerate.last, "infeasible")[0]);
}
