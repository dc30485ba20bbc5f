use super::*;
use crate::bodies::{ArmBodies, Carried};
use crate::chain::MAX_AXES;
use crate::postures::within_limits;
use crate::room::Room;
use crate::room::way::{Hung, Measured};
use graspbox_hand::arm::assets::{ARMS, arm_asset};
use graspbox_hand::assets::asset;
use nalgebra::{Isometry3, Point3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Period of a decision, and of a time step, seconds.
const PERIOD: f64 = 0.01;
const STEP: f64 = 0.002;
const CLEARANCE: f64 = 0.005;

fn follower(name: &str) -> Follower {
    let arm = arm_asset(name).unwrap().read().unwrap();
    Follower::new(&arm, Chain::new(&arm))
}

/// An arm on a table, with a wall before it.
fn room(name: &str) -> (Follower, Room, ArmBodies, Positions) {
    let arm = arm_asset(name).unwrap().read().unwrap();
    let chain = Chain::new(&arm);
    let bodies = ArmBodies::new(&arm, &chain);
    let hand = asset("panda_gripper").unwrap().read().unwrap();
    let carried = Carried::new(&arm, &chain, &bodies, &hand, 0.0, &arm.flange_from_base_of(&hand)).unwrap();
    let wall = (Vector3::new(0.01, 0.3, 0.1), Isometry3::translation(0.9 * chain.length(), 0.0, 0.1));
    let room = Room::new(&chain, &bodies, carried, Isometry3::identity(), &[wall]);
    let mut home = [0.0; MAX_AXES];
    home[..chain.len()].copy_from_slice(&arm.home());
    (Follower::new(&arm, chain), room, bodies, home)
}

fn random_vector(random: &mut ChaCha8Rng, size: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| size * (2.0 * random.random::<f64>() - 1.0))
}

/// Away from limits and singularities the rates give the twist that was asked for. A bug here: a wrong frame, point or sign.
#[test]
fn rates_give_the_twist() {
    for name in ["fr3", "ur5e", "xarm7"] {
        let follower = follower(name);
        let chain = follower.chain();
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut tried = 0;
        while tried < 50 {
            let positions = within_limits(chain, || random.random());
            if chain.least_singular_value(&positions) < 0.1 || chain.room(&positions) < 0.2 {
                continue;
            }
            tried += 1;
            let (linear, angular) = (random_vector(&mut random, 0.1), random_vector(&mut random, 0.2));
            let state = AxesState { positions, rates: [0.0; MAX_AXES] };
            let frames = chain.frames(&positions);
            let point = frames.flange.shift + random_vector(&mut random, 0.1);
            let rates = follower.rates(&state, &frames, &point, (&linear, &angular), PERIOD);
            let found = follower.twist(&frames, &point, &rates);
            assert!((found.0 - linear).norm() < 1e-6 && (found.1 - angular).norm() < 1e-6, "{name}: {found:?}");
        }
    }
}

/// Five axes meet the velocity of a point, and of a turn what they can.
#[test]
fn five_axes_meet_the_velocity() {
    let follower = follower("so101");
    let chain = follower.chain();
    let mut home = [0.0; MAX_AXES];
    (0..chain.len()).for_each(|axis| home[axis] = chain.home(axis));
    let state = AxesState { positions: home, rates: [0.0; MAX_AXES] };
    let frames = chain.frames(&home);
    for linear in [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| axis * 0.05) {
        let point = frames.flange.shift;
        let rates = follower.rates(&state, &frames, &point, (&linear, &Vector3::zeros()), PERIOD);
        let found = follower.twist(&frames, &point, &rates);
        assert!((found.0 - linear).norm() < 0.2 * linear.norm(), "{linear:?}: {found:?}");
    }
}

/// Whatever is wanted, no limit of position, speed or acceleration is exceeded in any time step, no posture leaves free space, and the arm moves.
#[test]
fn limits_hold_for_random_wishes() {
    for asset in &ARMS {
        let (follower, room, _, home) = room(asset.name);
        let chain = follower.chain();
        let count = chain.len();
        let mut random = ChaCha8Rng::seed_from_u64(7);
        let (mut travel, mut blocked, mut known) = (0.0, 0, Measured::default());
        let nothing = Hung { height: &|_| 1.0, center: Point3::origin(), radius: 0.0 };
        for _ in 0..6 {
            let mut state = AxesState { positions: home, rates: [0.0; MAX_AXES] };
            for _ in 0..30 {
                let mut wanted = [0.0; MAX_AXES];
                (0..count).for_each(|axis| wanted[axis] = follower.speed(axis) * (4.0 * random.random::<f64>() - 2.0));
                for _ in 0..20 {
                    let is_free = |way: &[Positions]| room.is_clear(chain, way, CLEARANCE, &nothing, &mut known);
                    let next = follower.next(&state, &wanted, PERIOD, is_free);
                    blocked += usize::from(next.blocked);
                    let begun = state;
                    for step in 0..5 {
                        let share = 1.0 / f64::from(5 - step);
                        let mut rates = state.rates;
                        (0..count).for_each(|axis| rates[axis] += share * (next.rates[axis] - rates[axis]));
                        let moved = follower.after(&state, &rates, STEP);
                        for (axis, rate) in rates.iter().enumerate().take(count) {
                            let [lower, upper] = chain.limits(axis);
                            let change = (moved.rates[axis] - state.rates[axis]).abs();
                            let unclamped = state.positions[axis] + 0.5 * STEP * (state.rates[axis] + rate);
                            assert!(
                                (lower - 1e-9..=upper + 1e-9).contains(&unclamped),
                                "{}: position {axis}",
                                asset.name
                            );
                            assert!(moved.rates[axis].abs() <= follower.speed(axis) * (1.0 + 1e-9));
                            assert!(change <= follower.acceleration(axis) * STEP * (1.0 + 1e-9));
                        }
                        state = moved;
                    }
                    travel += room.motion(&begun.positions, &state.positions);
                    let left = room.measure(&chain.frames(&state.positions));
                    assert!(left > 0.9 * CLEARANCE, "{}: {left} m are left", asset.name);
                }
            }
        }
        assert!(travel > 10.0 && blocked > 0, "{}: {travel} m, {blocked} times blocked", asset.name);
    }
}

/// What one measurement says of other postures is true, by a query that asks only whether shapes touch.
#[test]
fn room_is_true_for_a_neighbourhood() {
    for asset in &ARMS {
        let (follower, room, bodies, _) = room(asset.name);
        let chain = follower.chain();
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut counts = [0, 0];
        for _ in 0..200 {
            let at = within_limits(chain, || random.random());
            let mut near = at;
            (0..chain.len()).for_each(|axis| near[axis] += 0.05 * (2.0 * random.random::<f64>() - 1.0));
            let here = room.measure(&chain.frames(&at));
            let frames = chain.frames(&near);
            let placed = bodies.place(&frames);
            let low = bodies
                .moving(&placed)
                .map(|(_, solid, at)| at.translation.z - crate::bodies::half_height(&solid.shape, &at.rotation));
            let touches = bodies.self_contact(&placed).is_some() || low.fold(f64::INFINITY, f64::min) < 0.0;
            let left = here - room.motion(&at, &near);
            assert!(!touches || left <= 1e-6, "{}: {left} m should be left", asset.name);
            counts[usize::from(touches)] += 1;
        }
        assert!(counts[0] > 5 && counts[1] > 5, "{}: {counts:?}", asset.name);
    }
}

/// A body that yields to a force moves along it.
#[test]
fn links_yield_along_a_force() {
    let follower = follower("fr3");
    let chain = follower.chain();
    let mut home = [0.0; MAX_AXES];
    (0..chain.len()).for_each(|axis| home[axis] = chain.home(axis));
    let frames = chain.frames(&home);
    let (point, force) = (frames.axes[4].shift + Vector3::new(0.0, 0.0, 0.05), Vector3::new(0.0, 10.0, 3.0));
    let rates = follower.yielding(&frames, 4, &point, &force);
    assert!(rates[5..].iter().all(|rate| *rate == 0.0), "axes beyond the body do not move it");
    let mut velocity = Vector3::zeros();
    (0..5).for_each(|axis| velocity += chain.column_at(&frames, axis, &point).fixed_rows::<3>(0) * rates[axis]);
    assert!(velocity.dot(&force) > 0.0);
}
