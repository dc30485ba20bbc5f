//! The room that a motion leaves: bounds, and what is remembered of earlier motions, change no answer.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_arm::chain::{Chain, Frames, MAX_AXES, Positions};
use graspbox_arm::room::way::{Hung, Measured};
use graspbox_arm::{ArmBodies, AxesState, Carried, Follower, Room};
use graspbox_hand::arm::assets::arm_asset;
use graspbox_hand::assets::asset;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Distance that is asked for, metres.
const LEAST: f64 = 0.005;
/// Longest motion between two postures that count, metres.
const CHECKED: f64 = 0.01;
const PERIOD: f64 = 0.02;

/// An arm that moves by random rates, and stops or starts anew where it is blocked.
fn counts(name: &str, base: Isometry3<f64>, walls: &[(Vector3<f64>, Isometry3<f64>)]) -> [usize; 2] {
    let (arm, hand) = (arm_asset(name).unwrap().read().unwrap(), asset("panda_gripper").unwrap().read().unwrap());
    let chain = Chain::new(&arm);
    let (bodies, mount) = (ArmBodies::new(&arm, &chain), arm.flange_from_base_of(&hand));
    let carried = Carried::new(&arm, &chain, &bodies, &hand, hand.preshape_limits()[0], &mount).unwrap();
    let (room, follower) = (Room::new(&chain, &bodies, carried, base, walls), Follower::new(&arm, chain.clone()));
    let mut home = [0.0; MAX_AXES];
    home[..chain.len()].copy_from_slice(&arm.home());
    // A ball in front of the flange.
    let (center, radius) = (Point3::new(0.02, 0.0, 0.1), 0.05);
    let height = |frames: &Frames| (base * frames.flange.isometry() * center).z - radius;
    let hung = Hung { height: &height, center, radius };
    let exact = |at: &Positions| {
        let frames = chain.frames(at);
        room.measure(&frames) >= LEAST && height(&frames) >= 0.0
    };
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let (mut known, mut counts, mut wanted) = (Measured::default(), [0, 0], [0.0; MAX_AXES]);
    let mut state = AxesState { positions: home, rates: [0.0; MAX_AXES] };
    for step in 0..1500 {
        if step % 15 == 0 {
            (0..chain.len()).for_each(|axis| wanted[axis] = follower.speed(axis) * random.random_range(-1.0..1.0));
        }
        if step % 300 == 0 {
            state = AxesState { positions: home, rates: [0.0; MAX_AXES] };
        }
        let next = follower.next(&state, &wanted, PERIOD, |way| {
            let clear = room.is_clear(&chain, way, LEAST, &hung, &mut known);
            assert_eq!(clear, postures(&room, way).iter().all(exact), "{name} at step {step}");
            counts[usize::from(clear)] += 1;
            clear
        });
        state = follower.after(&state, &next.rates, PERIOD);
    }
    counts
}

/// All postures of a way that count.
fn postures(room: &Room, way: &[Positions]) -> Vec<Positions> {
    let mut all = Vec::new();
    for line in way.windows(2) {
        let parts = (room.motion(&line[0], &line[1]) / CHECKED).ceil();
        let between = |share: f64| std::array::from_fn(|axis| line[0][axis] + share * (line[1][axis] - line[0][axis]));
        all.extend((1..=parts as usize).map(|part| between(part as f64 / parts)));
    }
    all
}

#[test]
fn a_way_is_clear_if_all_its_postures_are() {
    let tilted = Isometry3::from_parts(
        Isometry3::translation(0.0, 0.0, 0.1).translation,
        UnitQuaternion::from_euler_angles(0.2, 0.3, 0.4),
    );
    let wall = (Vector3::new(0.02, 0.4, 0.15), Isometry3::translation(0.5, 0.1, 0.15));
    for name in ["fr3", "ur5e", "xarm7"] {
        for (base, walls) in [(Isometry3::identity(), vec![]), (tilted, vec![]), (Isometry3::identity(), vec![wall])] {
            let [blocked, free] = counts(name, base, &walls);
            assert!(blocked > 100 && free > 500, "{name}: {blocked} ways are blocked, {free} are free");
        }
    }
}
