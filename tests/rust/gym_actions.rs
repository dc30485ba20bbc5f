//! What an action does: the timing of a step, the closing motion of every hand, the palm that keeps facing down.
//!
//! A bug here: a motion that depends on how often it is commanded, fingers that close against each other, a palm that tilts.
#![allow(clippy::unwrap_used)]

use graspbox_gym::actions::action::actuator_commands;
use graspbox_gym::actions::arm_controller::{ANGULAR_SPEED, LINEAR_SPEED};
use graspbox_gym::actions::control::Timing;
use graspbox_gym::starts::reset_options::ObjectChoice;
use graspbox_gym::{ActionSpec, Control, EnvConfig, EnvPool, Fingers, ResetOptions};
use graspbox_hand::assets::ASSETS;
use graspbox_hand::{ActuatorCommand, Hand};
use graspbox_objects::Family;
use graspbox_tests::bench::palm_down;
use graspbox_tests::gym::{objects, row_bits, seeds};
use nalgebra::{Isometry3, Vector3};
use std::sync::Arc;

const DT: f64 = 0.002;

#[test]
fn a_step_has_control_periods_of_at_most_50_ms() {
    for (freq, periods, period, substeps) in
        [(5.0, 4, 0.05, 25), (10.0, 2, 0.05, 25), (20.0, 1, 0.05, 25), (50.0, 1, 0.02, 10), (100.0, 1, 0.01, 5)]
    {
        let timing = Timing::new(freq, DT).unwrap();
        assert_eq!((timing.periods, timing.substeps), (periods, substeps), "{freq} Hz");
        assert!((timing.period - period).abs() < 1e-12, "{freq} Hz: {timing:?}");
    }
    // Three periods of 1/21 s, which steps of 2 ms do not divide; those of 1/2100 s do.
    let message = Timing::new(7.0, DT).unwrap_err().to_string();
    assert!(message.contains("physics.dt") && message.contains("`control_freq` 7"), "{message}");
    assert_eq!(Timing::new(7.0, 1.0 / 2100.0).unwrap().periods, 3);
    for freq in [0.0, -5.0, 4.99, 100.1, f64::NAN, f64::INFINITY] {
        let message = Timing::new(freq, DT).unwrap_err().to_string();
        assert!(message.contains("control_freq") && message.contains("Hz"), "{message}");
    }
}

/// Preshapes of a hand: the ends of its range and one between.
fn preshapes(hand: &Hand) -> Vec<f64> {
    let [low, high] = hand.preshape_limits();
    [low, (low + high) / 2.0, high]
        .map(|preshape| if hand.grasp.coordinate.is_some() { preshape } else { preshape.round() })
        .into()
}

/// Checks the commands of one closing entry: closing actuators share it, opening ends at the open hand, the others hold the preshape.
fn check_closing(hand: &Hand, share: f32, preshape: f64) {
    let mut kept = preshape;
    let commands = actuator_commands(hand, Fingers::Synergy, &[share, 0.3], false, &mut kept);
    assert!((kept - preshape).abs() < 1e-12, "{}: a closed hand keeps its preshape", hand.name);
    assert_eq!(commands.len(), hand.actuators.len());
    let (clipped, open) = (f64::from(share).clamp(-1.0, 1.0), hand.open_positions(preshape));
    for (index, command) in commands.iter().enumerate() {
        let speed = clipped * hand.actuators[index].default_speed;
        let expected = match (hand.grasp.closing.contains(&index), clipped < 0.0) {
            (false, _) => ActuatorCommand::Position { target: open[index], speed: None },
            (true, true) => ActuatorCommand::Position { target: open[index], speed: Some(-speed) },
            (true, false) => ActuatorCommand::Velocity(speed),
        };
        assert_eq!(*command, expected, "{}, actuator {index}", hand.name);
    }
}

#[test]
fn one_number_closes_every_hand() {
    for asset in &ASSETS {
        let hand = asset.read().unwrap();
        let entries = 1 + usize::from(hand.grasp.coordinate.is_some());
        for control in Control::CLOSED_LOOP {
            let action = ActionSpec { control, fingers: Fingers::Synergy };
            assert_eq!(action.size(&hand), control.hand_size(&hand) + entries, "{}", hand.name);
            let columns = action.table(&hand);
            assert_eq!(columns.iter().map(|column| column.size).sum::<usize>(), action.size(&hand), "{}", hand.name);
            assert!(columns.iter().any(|column| column.name == "close"), "{}", hand.name);
        }
        for preshape in preshapes(&hand) {
            for share in [-3.0, -1.0, -0.25, 0.0, 0.25, 1.0, 3.0] {
                check_closing(&hand, share, preshape);
            }
        }
        // An open hand takes the preshape from the action.
        let [low, high] = hand.preshape_limits();
        let mut preshape = low;
        actuator_commands(&hand, Fingers::Synergy, &[0.0, 1.0], true, &mut preshape);
        let expected = if hand.grasp.coordinate.is_some() { high } else { low };
        assert!((preshape - expected).abs() < 1e-12, "{}", hand.name);
    }
}

fn pool(config: EnvConfig) -> EnvPool {
    EnvPool::new(objects(&[Family::Can]), config, 1).unwrap()
}

/// Starts high above the table, with the palm down.
fn high() -> ResetOptions {
    let hand = palm_down(0.0, 0.0, 0.5).to_homogeneous();
    ResetOptions {
        object: Some(ObjectChoice::Index(0)),
        world_from_hand: Some(std::array::from_fn(|i| std::array::from_fn(|j| hand[(i, j)]))),
        ..ResetOptions::default()
    }
}

/// Positions of the actuators of environment 0.
fn actuators(pool: &EnvPool) -> Vec<f64> {
    let env = pool.env(0).unwrap();
    env.episode().unwrap().episode().world().actuators().iter().map(|actuator| actuator.position).collect()
}

fn hand_pose(pool: &EnvPool) -> Isometry3<f64> {
    let env = pool.env(0).unwrap();
    env.episode().unwrap().episode().world().world_from_hand()
}

/// In the air all fingers close alike, and open again as far as the preshape says.
#[test]
fn fingers_close_together_and_open_again() {
    let pool = pool(EnvConfig::default());
    pool.reset(&[Some(0)], None, &high()).unwrap();
    let act = |close: f32, preshape: f32| vec![0.0, 0.0, 0.0, 0.0, 0.0, 0.0, close, preshape];
    for _ in 0..10 {
        pool.step(&act(-1.0, 0.0)).unwrap();
    }
    let hand = Arc::clone(pool.spec().objects.hand());
    let [low, high] = hand.preshape_limits();
    let open = hand.open_positions((low + high) / 2.0);
    let near = |positions: &[f64]| positions.iter().zip(&open).all(|(at, wanted)| (at - wanted).abs() < 1e-6);
    assert!(near(&actuators(&pool)), "{:?} instead of {open:?}", actuators(&pool));
    pool.step(&act(0.5, 0.0)).unwrap();
    let closed = actuators(&pool);
    for index in &hand.grasp.closing {
        let moved = closed[*index] - open[*index];
        let wanted = 0.5 * 0.2 * hand.actuators[*index].default_speed;
        assert!((moved - wanted).abs() < 1e-3, "actuator {index} moved by {moved} instead of {wanted}");
    }
    for _ in 0..10 {
        pool.step(&act(-0.7, 0.0)).unwrap();
    }
    assert!(near(&actuators(&pool)), "{:?} instead of {open:?}", actuators(&pool));
}

/// Angle between the palm's direction and the vertical, rad.
fn tilt(pose: &Isometry3<f64>) -> f64 {
    (pose.rotation * Vector3::z()).angle(&-Vector3::z())
}

fn top_down() -> EnvConfig {
    EnvConfig { control: Control::TopDown, ..EnvConfig::default() }
}

#[test]
fn the_palm_keeps_facing_down() {
    let pool = pool(top_down());
    let mut state = 1_u64;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1_u64 << 23) as f32 - 1.0
    };
    for seed in 0..4 {
        pool.reset(&[Some(seed)], None, &ResetOptions::default()).unwrap();
        let (start, mut turned) = (hand_pose(&pool), false);
        assert!(tilt(&start) < 1e-9, "seed {seed} starts with a tilt of {}", tilt(&start));
        for step in 0..30 {
            let action: Vec<f32> = (0..pool.spec().action).map(|_| noise()).collect();
            if pool.step(&action).unwrap().now.terminated[0] {
                break;
            }
            let pose = hand_pose(&pool);
            assert!(tilt(&pose) < 1e-6, "seed {seed}, step {step}: a tilt of {}", tilt(&pose));
            turned |= pose.rotation.angle_to(&start.rotation) > 0.1;
        }
        assert!(turned, "seed {seed}: the hand did not turn");
    }
}

#[test]
fn top_down_moves_along_the_axes_of_the_world() {
    let pool = pool(top_down());
    // A hand that has turned: its own axes are not those of the world.
    let start = |yaw: f32| {
        pool.reset(&[Some(0)], None, &high()).unwrap();
        for _ in 0..4 {
            pool.step(&[0.0, 0.0, 0.0, yaw, 0.0, 0.0]).unwrap();
        }
        pool.step(&[0.0; 6]).unwrap();
        hand_pose(&pool)
    };
    let before = start(0.0);
    let turned = start(1.0);
    let axis = (turned.rotation * before.rotation.inverse()).scaled_axis();
    assert!(axis.xy().norm() < 1e-6 && axis.z > 0.5 * 0.8 * ANGULAR_SPEED.min(2.0), "{axis}");
    for k in 0..3 {
        let from = start(1.0);
        let mut action = [0.0_f32; 6];
        action[k] = if k == 2 { -0.2 } else { 0.2 };
        pool.step(&action).unwrap();
        let moved = hand_pose(&pool).translation.vector - from.translation.vector;
        let along = moved[k] * f64::from(action[k]).signum();
        assert!(along > 0.5 * 0.2 * 0.2 * LINEAR_SPEED, "axis {k}: {moved}");
        assert!((moved.norm() - along).abs() < 1e-9, "axis {k}: {moved}");
    }
}

/// What a step of 5 Hz does, four of 20 Hz with the same action do, bit for bit; the sums of their reward terms too, up to rounding.
#[test]
fn slower_control_repeats_the_action() {
    for control in Control::CLOSED_LOOP {
        for fingers in Fingers::ALL {
            let make = |control_freq| pool(EnvConfig { control, fingers, control_freq, ..EnvConfig::default() });
            let (slow, fast) = (make(5.0), make(20.0));
            for pool in [&slow, &fast] {
                pool.reset(&seeds(pool), None, &ResetOptions::default()).unwrap();
            }
            for step in 0..5_u8 {
                let entry = |i: usize| 0.5 * (f32::from(step) * 1.7 + i as f32 * 0.9).sin();
                let action: Vec<f32> = (0..slow.spec().action).map(entry).collect();
                let mut now = slow.step(&action).unwrap().now;
                let mut terms = vec![0.0; now.terms.len()];
                let mut last = now.clone();
                for _ in 0..4 {
                    last = fast.step(&action).unwrap().now;
                    terms.iter_mut().zip(&last.terms).for_each(|(sum, term)| *sum += term);
                }
                for (sum, term) in terms.iter().zip(&now.terms) {
                    assert!((sum - term).abs() < 1e-5, "{control:?}, {fingers:?}: {terms:?}, {:?}", now.terms);
                }
                now.terms.clone_from(&last.terms);
                assert_eq!(row_bits(&now, 0), row_bits(&last, 0), "{control:?}, {fingers:?}, step {step}");
            }
        }
    }
}
