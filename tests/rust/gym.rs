//! Environments do not know of each other: the same seed and actions give the same bits, alone or beside others, now or from a state.
//!
//! A mismatch is always a bug: a sample that depends on a neighbour, something that is missing from a saved state, an order that is not
//! fixed.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_episode::EpisodeError;
use graspbox_gym::pool::env_pool::StepBatches;
use graspbox_gym::{
    Autoreset, Batch, Control, EnvConfig, EnvError, EnvPool, Fingers, Objects, Randomization, ResetOptions,
};
use graspbox_hand::Hand;
use graspbox_objects::Family;
use graspbox_sim::PhysicsConfig;
use graspbox_tests::bench::in_pool;
use graspbox_tests::gym::{batch_bits, each_period, flags, indices, numbers, objects, pool, row_bits, seeds};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::mpsc::channel;

const FAMILIES: [Family; 3] = [Family::Box, Family::Can, Family::Ball];

/// A small generator for actions (splitmix64), the same everywhere.
fn noise(state: &mut u64) -> f32 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 40) as f32 / (1u64 << 23) as f32 - 1.0
}

/// The action of environment `env` at step `step`: towards the table with closing fingers, and some noise.
fn action(size: usize, env: usize, step: usize) -> Vec<f32> {
    let mut state = (env as u64) << 32 | step as u64;
    let mut action: Vec<f32> = (0..size).map(|_| 0.4 * noise(&mut state)).collect();
    action[2] = 0.5;
    let spools = action.len().min(9);
    action[6..spools].fill(if step % 40 > 12 { 0.9 } else { -0.5 });
    action
}

fn actions(pool: &EnvPool, step: usize) -> Vec<f32> {
    let size = pool.spec().action;
    (0..pool.len()).flat_map(|env| action(size, env, step)).collect()
}

fn configured(objects: &Arc<Objects>, config: EnvConfig, count: usize) -> Arc<EnvPool> {
    Arc::new(EnvPool::new(Arc::clone(objects), config, count).unwrap())
}

/// Resets and steps; the bits of every environment, step by step.
fn run(pool: &EnvPool, steps: usize) -> Vec<Vec<Vec<u64>>> {
    let first = pool.reset(&seeds(pool), None, &ResetOptions::default()).unwrap();
    let rows = |batch: &Batch| (0..pool.len()).map(|i| row_bits(batch, i)).collect();
    let mut bits = vec![rows(&first)];
    bits.extend((0..steps).map(|step| rows(&pool.step(&actions(pool, step)).unwrap().now)));
    bits
}

#[test]
fn results_depend_on_neither_threads_nor_neighbors() {
    let config =
        || EnvConfig { max_episode_steps: Some(30), randomization: Randomization::standard(), ..each_period() };
    let together = configured(&objects(&FAMILIES), config(), 5);
    let bits = in_pool(3, || run(&together, 70));
    // Another set of objects: nothing that was prepared before matters.
    let again = configured(&objects(&FAMILIES), config(), 5);
    assert_eq!(bits, in_pool(1, || run(&again, 70)));
    assert!(bits.iter().flatten().any(|row| row != &bits[0][0]));
    for env in [0, 4] {
        let alone = configured(&again.spec().objects, config(), 1);
        alone.reset(&[Some(env as u64)], None, &ResetOptions::default()).unwrap();
        for (step, all) in bits[1..].iter().enumerate() {
            let now = alone.step(&action(alone.spec().action, env, step)).unwrap().now;
            assert_eq!(all[env], row_bits(&now, 0), "environment {env} at step {step}");
        }
    }
}

#[test]
fn starts_vary_and_an_unseeded_reset_continues_the_stream() {
    let pool = pool(&objects(&FAMILIES), Control::Twist, 4);
    let options = ResetOptions::default();
    let none = vec![None; 4];
    assert!(matches!(pool.reset(&none, None, &options), Err(EnvError::NotSeeded { env: 0 })));
    let first = pool.reset(&seeds(&pool), None, &options).unwrap();
    let second = pool.reset(&none, None, &options).unwrap();
    let rows: Vec<_> = (0..4).map(|i| row_bits(&first, i)).chain((0..4).map(|i| row_bits(&second, i))).collect();
    for (i, a) in rows.iter().enumerate() {
        assert!(rows[i + 1..].iter().all(|b| a != b), "start {i} came twice");
    }
    assert_eq!(first, pool.reset(&seeds(&pool), None, &options).unwrap());
    assert_eq!(second, pool.reset(&none, None, &options).unwrap());
    // A part of them: the others stay as they are, and their streams too.
    let third = pool.reset(&none, None, &options).unwrap();
    pool.reset(&seeds(&pool), None, &options).unwrap();
    let partial = pool.reset(&none, Some(&[true, false, true, false]), &options).unwrap();
    for env in 0..4 {
        let expected = if env % 2 == 0 { &second } else { &first };
        assert_eq!(row_bits(&partial, env), row_bits(expected, env));
    }
    pool.reset(&none, Some(&[false, true, false, true]), &options).unwrap();
    assert_eq!(third, pool.reset(&none, None, &options).unwrap());
}

#[test]
fn every_autoreset_mode_does_what_it_says() {
    const LIMIT: u32 = 7;
    let objects = objects(&[Family::Box]);
    let make = |autoreset| {
        let config = EnvConfig { autoreset, max_episode_steps: Some(LIMIT), ..each_period() };
        let pool = configured(&objects, config, 2);
        pool.reset(&seeds(&pool), None, &ResetOptions::default()).unwrap();
        pool
    };
    let (next, same, disabled) = (make(Autoreset::NextStep), make(Autoreset::SameStep), make(Autoreset::Disabled));
    let step = |pool: &EnvPool, i: usize| -> Result<StepBatches, EnvError> { pool.step(&actions(pool, i)) };
    for episode in 0..3 {
        for i in 0..LIMIT as usize {
            let (a, b, c) = (step(&next, i).unwrap(), step(&same, i).unwrap(), step(&disabled, i).unwrap());
            let ends = i + 1 == LIMIT as usize;
            assert_eq!(a.now.truncated, [ends; 2], "episode {episode}, step {i}");
            assert_eq!(a.now, c.now);
            assert!(a.last.is_empty() && c.last.is_empty());
            assert_eq!(a.now.terms, b.now.terms);
            assert_eq!(a.now.truncated, b.now.truncated);
            assert_eq!(b.now.reset, [ends; 2]);
            if ends {
                assert_eq!(b.last.observations, a.now.observations);
                assert_eq!(numbers(&b.last, "lift"), numbers(&a.now, "lift"));
                assert_eq!(indices(&b.last, "failure"), indices(&a.now, "failure"));
                // The next step begins anew, for any action.
                let mut ignored = actions(&next, i);
                ignored[0] = f32::NAN;
                let anew = next.step(&ignored).unwrap().now;
                assert_eq!((&anew.reset, &anew.truncated), (&vec![true; 2], &vec![false; 2]));
                assert!(anew.terms.iter().all(|t| *t == 0.0));
                assert_eq!(anew.observations, b.now.observations);
                assert!(matches!(step(&disabled, i), Err(EnvError::Over { env: 0 })));
                let fresh = disabled.reset(&[None; 2], None, &ResetOptions::default()).unwrap();
                assert_eq!(fresh.observations, anew.observations);
            }
        }
    }
}

#[test]
fn a_saved_state_goes_on_bit_for_bit() {
    let objects = objects(&FAMILIES);
    let config = EnvConfig { max_episode_steps: Some(40), randomization: Randomization::standard(), ..each_period() };
    let pool = configured(&objects, config.clone(), 2);
    pool.reset(&seeds(&pool), None, &ResetOptions::default()).unwrap();
    for step in 0..25 {
        pool.step(&actions(&pool, step)).unwrap();
    }
    let states: Vec<Vec<u8>> = (0..2).map(|env| pool.env(env).unwrap().save(pool.spec(), env).unwrap()).collect();
    let seen = pool.now();
    let go_on = |pool: &EnvPool| -> Vec<StepBatches> {
        (25..60).map(|step| pool.step(&actions(pool, step)).unwrap()).collect()
    };
    let expected = go_on(&pool);
    assert!(expected.iter().any(|s| s.now.reset[0]), "no autoreset on the way");
    assert!(expected.iter().any(|s| flags(&s.now, "touches").contains(&true)), "no contact on the way");
    let other = configured(&objects, config.clone(), 2);
    for (env, state) in states.iter().enumerate() {
        other.env(env).unwrap().restore(other.spec(), state).unwrap();
        assert_eq!(other.env(env).unwrap().save(other.spec(), env).unwrap(), *state);
    }
    assert_eq!(other.now().observations, seen.observations);
    assert_eq!(expected, go_on(&other));
    // Damage, other objects, another control mode.
    let refuse = |pool: &EnvPool, bytes: &[u8]| {
        let refused = pool.env(0).unwrap().restore(pool.spec(), bytes);
        assert!(refused.is_err());
    };
    for cut in [0, 4, 40, states[0].len() - 1] {
        refuse(&other, &states[0][..cut]);
    }
    for at in (0..states[0].len()).step_by(states[0].len() / 50) {
        let mut flipped = states[0].clone();
        flipped[at] ^= 4;
        refuse(&other, &flipped);
    }
    let delta = EnvConfig { control: Control::DeltaPose, ..config.clone() };
    refuse(&configured(&objects, delta, 1), &states[0]);
    let slower = EnvConfig { control_freq: 10.0, ..config.clone() };
    refuse(&configured(&objects, slower, 1), &states[0]);
    let together = EnvConfig { fingers: Fingers::Synergy, ..config.clone() };
    refuse(&configured(&objects, together, 1), &states[0]);
    let others = graspbox_tests::gym::objects(&[Family::Bottle]);
    refuse(&configured(&others, config, 1), &states[0]);
}

#[test]
fn sent_environments_arrive_as_if_stepped_together() {
    let objects = objects(&FAMILIES);
    let (whole, apart) = (pool(&objects, Control::Twist, 4), pool(&objects, Control::Twist, 4));
    whole.reset(&seeds(&whole), None, &ResetOptions::default()).unwrap();
    apart.reset(&seeds(&apart), None, &ResetOptions::default()).unwrap();
    let size = apart.spec().action;
    for step in 0..12 {
        let expected = whole.step(&actions(&whole, step)).unwrap().now;
        let (sender, arrivals) = channel();
        for envs in [[3, 1], [0, 2]] {
            let rows: Vec<f32> = envs.iter().flat_map(|env| action(size, *env, step)).collect();
            let sender = sender.clone();
            apart.send(&envs, &rows, move |env, result| sender.send((env, result)).unwrap()).unwrap();
        }
        assert!(matches!(apart.step(&actions(&apart, step)), Err(EnvError::Busy { .. })));
        assert!(matches!(apart.env(1).map(|_| ()), Err(EnvError::Busy { env: 1 })));
        for _ in 0..4 {
            let (env, result) = arrivals.recv().unwrap();
            apart.arrived(env);
            assert_eq!(row_bits(&result.unwrap().now, 0), row_bits(&expected, env), "environment {env}, step {step}");
        }
        assert_eq!(apart.away(), 0);
    }
    let twice = apart.send(&[1, 1], &actions(&apart, 0)[..2 * size], |_, _| ());
    assert!(matches!(twice, Err(EnvError::Busy { env: 1 })));
    assert_eq!(apart.away(), 0, "nothing was sent");
}

/// A stopped call leaves the rest of its work untouched, and the next call does it all.
#[test]
fn a_stopped_call_leaves_environments_as_they_are() {
    let pool = pool(&objects(&[Family::Can, Family::Box]), Control::Twist, 4);
    let stop = AtomicBool::new(true);
    let (begin, all) = (ResetOptions::default(), seeds(&pool));
    assert!(matches!(
        pool.reset_until(&stop, &all, None, std::slice::from_ref(&begin)),
        Err(EnvError::Episode(EpisodeError::Cancelled { done: 0, total: 4 }))
    ));
    assert!(pool.step(&actions(&pool, 0)).is_err());
    let first = pool.reset(&all, None, &begin).unwrap();
    let stopped = pool.step_until(&stop, &actions(&pool, 0));
    assert!(matches!(stopped, Err(EnvError::Episode(EpisodeError::Cancelled { done: 0, total: 4 }))));
    assert_eq!(batch_bits(&pool.now()), batch_bits(&first));
    let other = pool_of_same(&pool);
    let [ours, theirs] = [&pool, &other].map(|p| p.step(&actions(p, 0)).unwrap());
    assert_eq!(batch_bits(&ours.now), batch_bits(&theirs.now));
}

/// Environments that were sent off and have not begun to step can be called back: they stay as they are.
#[test]
fn environments_that_are_called_back_stay_as_they_are() {
    let pool = pool(&objects(&[Family::Can]), Control::Twist, 3);
    let first = pool.reset(&seeds(&pool), None, &ResetOptions::default()).unwrap();
    let (sender, arrivals) = channel();
    // Nothing that is sent from the only thread of a rayon pool begins before this closure returns.
    in_pool(1, || {
        let action = actions(&pool, 0);
        pool.send(&[0, 1, 2], &action, move |env, result| sender.send((env, result)).unwrap()).unwrap();
        assert_eq!(pool.away(), 3);
        pool.call_back();
    });
    while pool.away() > 0 {
        std::thread::yield_now();
    }
    assert!(arrivals.recv().is_err(), "an environment stepped");
    assert_eq!(pool.now(), first);
    let other = pool_of_same(&pool);
    let [ours, theirs] = [&pool, &other].map(|p| p.step(&actions(p, 0)).unwrap());
    assert_eq!(ours, theirs);
    // Actions sent afterwards step.
    let (sender, arrivals) = channel();
    pool.send(&[1], &actions(&pool, 1)[..pool.spec().action], move |env, result| sender.send((env, result)).unwrap())
        .unwrap();
    assert!(arrivals.recv().unwrap().1.is_ok());
}

/// Another pool of the same objects that begins the same episodes.
fn pool_of_same(pool: &EnvPool) -> Arc<EnvPool> {
    let other = configured(&pool.spec().objects, pool.spec().config.clone(), pool.len());
    other.reset(&seeds(pool), None, &ResetOptions::default()).unwrap();
    other
}

/// A step with one bad action moves nothing, and the error says whose it was.
#[test]
fn bad_actions_are_refused_before_anything_moves() {
    let pool = pool(&objects(&[Family::Box]), Control::DeltaPose, 3);
    assert!(matches!(pool.step(&actions(&pool, 0)), Err(EnvError::NotReset { env: 0 })));
    pool.reset(&seeds(&pool), None, &ResetOptions::default()).unwrap();
    let before: Vec<_> = (0..3).map(|env| pool.env(env).unwrap().save(pool.spec(), env).unwrap()).collect();
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        let mut wrong = actions(&pool, 0);
        wrong[2 * pool.spec().action + 4] = bad;
        let error = pool.step(&wrong).unwrap_err();
        assert!(matches!(error, EnvError::BadAction { env: 2, .. }), "{error}");
        assert!(error.to_string().contains("environment 2"), "{error}");
    }
    let short = pool.step(&actions(&pool, 0)[1..]);
    assert!(matches!(short, Err(EnvError::BadLength { .. })));
    let after: Vec<_> = (0..3).map(|env| pool.env(env).unwrap().save(pool.spec(), env).unwrap()).collect();
    assert_eq!(before, after);
    // Beyond [-1, 1] counts as the bound.
    let far: Vec<f32> = actions(&pool, 0).iter().map(|a| a.signum() * 7.0).collect();
    let near: Vec<f32> = far.iter().map(|a| a.clamp(-1.0, 1.0)).collect();
    let one = pool.step(&far).unwrap();
    for (env, state) in before.iter().enumerate() {
        pool.env(env).unwrap().restore(pool.spec(), state).unwrap();
    }
    assert_eq!(one, pool.step(&near).unwrap());
}

/// A hand of two fingers without a preshape: fewer numbers, the same environments.
#[test]
fn another_hand_acts_as_well() {
    let files = Path::new(env!("CARGO_MANIFEST_DIR")).join("../env/hand/tests/fixtures");
    let hand = Hand::load(&files.join("gripper.urdf"), &files.join("gripper.toml")).unwrap();
    let (actuators, sensors) = (hand.actuators.len(), hand.sensors.len());
    let sources = vec![objects(&[Family::Box]).source(0).unwrap().clone()];
    let objects = Arc::new(Objects::new(sources, Arc::new(hand), PhysicsConfig::default(), None).unwrap());
    for control in Control::CLOSED_LOOP {
        let pool = pool(&objects, control, 2);
        assert_eq!(pool.spec().action, control.hand_size(pool.spec().hand()) + actuators);
        pool.reset(&seeds(&pool), None, &ResetOptions::default()).unwrap();
        for step in 0..20 {
            let batch = pool.step(&actions(&pool, step)).unwrap().now;
            assert_eq!(batch.observations[1].len(), 2 * sensors);
            let proprio: usize = pool.spec().observations[0].size;
            assert_eq!((proprio, batch.observations[0].len()), (15 + 2 + 3 * actuators, 2 * proprio), "two encoders");
        }
    }
}
