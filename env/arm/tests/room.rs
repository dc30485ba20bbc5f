//! The room that a posture leaves: what is remembered of earlier postures changes no answer.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_arm::chain::MAX_AXES;
use graspbox_arm::room::Measured;
use graspbox_arm::{ArmBodies, Carried, Inverse, Room};
use graspbox_hand::arm::assets::arm_asset;
use graspbox_hand::assets::asset;
use nalgebra::Isometry3;
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Distance that is asked for, metres.
const LEAST: f64 = 0.005;

#[test]
fn remembered_distances_change_no_answer() {
    for name in ["fr3", "ur5e", "xarm7"] {
        let (arm, hand) = (arm_asset(name).unwrap().read().unwrap(), asset("panda_gripper").unwrap().read().unwrap());
        let inverse = Inverse::new(&arm);
        let (chain, bodies) = (inverse.chain(), ArmBodies::new(&arm, inverse.chain()));
        let mount = arm.flange_from_base_of(&hand);
        let carried = Carried::new(&arm, chain, &bodies, &hand, hand.preshape_limits()[0], &mount).unwrap();
        let room = Room::new(chain, &bodies, carried, Isometry3::identity(), &[]);
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let (mut known, mut near) = (Measured::default(), 0);
        let mut q = inverse.positions_of(&arm.home());
        let mut rates = [0.0; MAX_AXES];
        for step in 0..6000 {
            if step % 40 == 0 {
                rates.iter_mut().take(chain.len()).for_each(|rate| *rate = random.random_range(-0.03..0.03));
            }
            for axis in 0..chain.len() {
                q[axis] = (q[axis] + rates[axis]).clamp(-2.8, 2.8);
            }
            let exact = room.measure(&chain.frames(&q));
            near += usize::from(exact < 2.0 * LEAST);
            let leaves = room.leaves(chain, &q, LEAST, &mut known);
            assert_eq!(leaves, exact >= LEAST, "{name} at step {step}: {exact}");
        }
        assert!(near > 20, "{name} was near something in {near} steps only");
    }
}
