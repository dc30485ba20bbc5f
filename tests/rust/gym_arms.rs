//! Hands on arms: kinematics, limits, starts, what links push, and saved states.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_gym::robot_arm::LINK_CLEARANCE;
use graspbox_gym::{
    Control, EnvConfig, EnvError, EnvPool, Fingers, Objects, Observation, Randomization, ResetOptions, RobotArm, Source,
};
use graspbox_hand::arm::assets::{ARMS, arm_asset};
use graspbox_hand::assets::asset;
use graspbox_hand::{Hand, Shape};
use graspbox_objects::Family;
use graspbox_sim::{Geometry, ObjectModel, PhysicsConfig, Template};
use graspbox_tests::gym::{batch_bits, flags, seeds};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::sync::Arc;

const CONTROLS: [Control; 5] =
    [Control::Twist, Control::DeltaPose, Control::TargetPose, Control::TopDown, Control::JointVelocity];

fn hand(name: &str) -> Hand {
    asset(name).unwrap().read().unwrap()
}

/// A hand that the arm may carry.
fn hand_for(arm: &str) -> Hand {
    let mut hand = hand("panda_gripper");
    if arm == "so101" {
        // This arm carries 0.2 kg; no hand here is so light.
        hand.links.iter_mut().for_each(|link| link.mass *= 0.2);
    }
    hand
}

fn objects_on(arm: &str, base: Option<Isometry3<f64>>) -> Result<Arc<Objects>, EnvError> {
    let source = |family: &Family| Source::Procedural {
        name: family.name().to_owned(),
        family: *family,
        seed: 0,
        scale: 1.0,
        mass: None,
    };
    let sources = [Family::Box, Family::Can].iter().map(source).collect();
    let plain = Objects::new(sources, Arc::new(hand_for(arm)), PhysicsConfig::default(), None)?;
    Ok(Arc::new(plain.on_arm(Arc::new(arm_asset(arm).unwrap().read().unwrap()), base)?))
}

fn pool_on(arm: &str, config: EnvConfig, count: usize) -> Arc<EnvPool> {
    Arc::new(EnvPool::new(objects_on(arm, None).unwrap(), config, count).unwrap())
}

/// A config without the tactile sensors that these hands do not have.
fn plain() -> EnvConfig {
    EnvConfig { observations: vec![Observation::Proprio, Observation::State], ..EnvConfig::default() }
}

/// Actions that keep a direction for some steps, so that limits are reached.
fn actions(pool: &EnvPool, step: usize) -> Vec<f32> {
    let number = |entry: usize| ((7919 * entry + 104_729 * (step / 4)) as f64).sin() * 1e4;
    (0..pool.len() * pool.spec().action).map(|entry| (2.0 * number(entry).rem_euclid(1.0) - 1.0) as f32).collect()
}

/// In every control mode the hand is where the joints put it, and no posture leaves ranges, speeds or free space.
///
/// The hobby arm is too short for the gripper over the table's middle; `graspbox_arm::follow` tests its limits.
#[test]
fn postures_stay_within_all_limits() {
    for asset in ARMS.iter().filter(|asset| asset.name != "so101") {
        let arm = asset.read().unwrap();
        let count = arm.axes.len();
        for control in CONTROLS {
            let config = EnvConfig { control, max_episode_steps: Some(25), ..plain() };
            let pool = pool_on(asset.name, config, 2);
            pool.reset(&seeds(&pool), None, &ResetOptions::default()).unwrap();
            let spec = pool.spec().arm.as_ref().unwrap();
            let mut moved = 0.0;
            for step in 0..50 {
                pool.step(&actions(&pool, step)).unwrap();
                for env in 0..pool.len() {
                    let env = pool.env(env).unwrap();
                    let (controller, world) = (env.episode().unwrap().arm(), env.episode().unwrap().episode().world());
                    let (q, dq) = controller.joints();
                    for ((axis, joint), (q, dq)) in arm.axes.iter().zip(arm.axis_joints()).zip(q.iter().zip(dq)) {
                        assert!(
                            (joint.limits[0]..=joint.limits[1]).contains(q),
                            "{}: {} at {q}",
                            asset.name,
                            joint.name
                        );
                        assert!(dq.abs() <= axis.speed * (1.0 + 1e-9), "{}: {} at {dq}", asset.name, joint.name);
                        moved += dq.abs();
                    }
                    let flange = arm.forward_kinematics(&q[..count]).unwrap()[arm.flange];
                    let expected = spec.robot.world_from_base * flange * spec.robot.flange_from_hand;
                    let apart = expected.inverse() * world.world_from_hand();
                    assert!(apart.translation.vector.norm() < 1e-9 && apart.rotation.angle() < 1e-9);
                    let room = spec.room.measure(&spec.follower.chain().frames(&q.try_into().unwrap()));
                    assert!(room > 0.5 * LINK_CLEARANCE, "{} in {control:?}: {room} m are left", asset.name);
                    let lowest = pool.spec().guard.lowest(&world.world_from_hand());
                    assert!(lowest > 0.0, "{} in {control:?}: the palm is {lowest} m above the table", asset.name);
                }
            }
            assert!(moved > 1.0, "{} in {control:?} hardly moves", asset.name);
        }
    }
}

/// The same seeds give the same bits with other numbers of environments and threads, and from a saved state.
#[test]
fn environments_on_arms_repeat() {
    let config = || EnvConfig {
        max_episode_steps: Some(15),
        randomization: Randomization::standard(),
        fingers: Fingers::Each,
        ..plain()
    };
    let run = |pool: &EnvPool, from: usize| -> Vec<Vec<u64>> {
        let whole = pool_on("fr3", config(), 3);
        (from..from + 20)
            .map(|step| batch_bits(&pool.step(&actions(&whole, step)[..pool.len() * pool.spec().action]).unwrap().now))
            .collect()
    };
    let [many, one] = [3, 1].map(|count| pool_on("fr3", config(), count));
    for pool in [&many, &one] {
        pool.reset(&seeds(pool), None, &ResetOptions::default()).unwrap();
    }
    let threads = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let (all, alone) = (run(&many, 0), threads.install(|| run(&one, 0)));
    for (all, alone) in all.iter().zip(&alone) {
        assert_eq!(alone[..], all[..alone.len()]);
    }
    let state = many.env(1).unwrap().save(many.spec(), 1).unwrap();
    let other = pool_on("fr3", config(), 3);
    for env in 0..3 {
        let state = many.env(env).unwrap().save(many.spec(), env).unwrap();
        other.env(env).unwrap().restore(other.spec(), &state).unwrap();
    }
    assert_eq!(run(&many, 20), run(&other, 20));
    // An arm elsewhere, and a hand without an arm.
    let elsewhere = objects_on("fr3", Some(Isometry3::translation(-0.5, 0.0, 0.0))).unwrap();
    let elsewhere = EnvPool::new(elsewhere, config(), 1).unwrap();
    let refused = elsewhere.env(0).unwrap().restore(elsewhere.spec(), &state).unwrap_err().to_string();
    assert!(refused.contains("arm"), "{refused}");
    let free = Objects::new(
        vec![elsewhere.spec().objects.source(0).unwrap().clone()],
        Arc::new(hand("panda_gripper")),
        PhysicsConfig::default(),
        None,
    );
    let free = EnvPool::new(Arc::new(free.unwrap()), config(), 1).unwrap();
    assert!(free.env(0).unwrap().restore(free.spec(), &state).is_err());
}

/// A forearm that sweeps about the vertical carries a ball along, without force on the hand. A bug here: bodies at wrong places or without velocity.
#[test]
fn a_link_pushes_an_object() {
    let arm = Arc::new(arm_asset("fr3").unwrap().read().unwrap());
    let (robot, hand) = RobotArm::new(Arc::clone(&arm), &hand("panda_gripper"), None).unwrap();
    let (chain, home) = (robot.inverse.chain(), robot.home());
    let frames = chain.frames(&home);
    let (shape, body_from_shape) = robot.bodies.shapes(5)[0];
    let center = (robot.world_from_base * frames.axes[4].isometry() * body_from_shape).translation.vector;
    let size = match shape {
        Shape::Cuboid(half) => half.norm(),
        Shape::Cylinder { radius, half_length } => radius.hypot(half_length),
        Shape::Sphere { radius } => radius,
    };
    let along = Vector3::z().cross(&(center - robot.world_from_base.translation.vector)).normalize();
    let ball = ObjectModel::solid(&Geometry::Ball { radius: 0.03 }, 0.2).unwrap();
    let template = Template::new(hand, &ball, PhysicsConfig::default()).unwrap();
    let start = Isometry3::from(Translation3::from(center + along * (size + 0.035)));
    let mut world = template.spawn(&robot.world_from_hand(&home), &start, 0.0);
    world.set_gravity(&Vector3::zeros());
    world.place_arm(&Isometry3::identity(), &home[..7]);
    let (mut joints, mut pressed, mut most) = (home, 0, 0.0_f64);
    for step in 0..400 {
        let rate = 0.8 * (f64::from(step) / 100.0).min(1.0);
        joints[0] += rate * world.dt();
        world.drive_arm(&joints[..7], false);
        world.step(&robot.world_from_hand(&joints), &[]).unwrap();
        assert_eq!(world.hand_load().force, Vector3::zeros());
        let before = pressed;
        world.each_arm_contact(|contact| {
            // Bodies count from the hand.
            assert!(contact.body <= 4 && contact.force.dot(&along) < 0.0, "{contact:?}");
            pressed += 1;
        });
        most = if pressed > before {
            most.max(world.world_from_object().translation.vector.metric_distance(&center))
        } else {
            most
        };
    }
    let moved = (world.world_from_object().translation.vector - start.translation.vector).norm();
    assert!(pressed > 0 && moved > 0.05, "{pressed} contacts, moved {moved} m");
}

/// A mount that is off moves the whole arm against the hand, so that its base stays where it is.
#[test]
fn an_error_of_the_mount_leaves_the_base() {
    let arm = Arc::new(arm_asset("ur5e").unwrap().read().unwrap());
    let (robot, hand) = RobotArm::new(arm, &hand("panda_gripper"), None).unwrap();
    let home = robot.home();
    let error = Isometry3::from_parts(
        Translation3::new(0.004, -0.003, 0.002),
        UnitQuaternion::from_scaled_axis(Vector3::new(0.02, 0.01, -0.03)),
    );
    // A ball in the base's column, which is pushed out by it.
    let ball = ObjectModel::solid(&Geometry::Ball { radius: 0.03 }, 0.2).unwrap();
    let template = Template::new(hand, &ball, PhysicsConfig::default()).unwrap();
    let at = |offset: f64| {
        let base = robot.world_from_base.translation.vector;
        let start = Isometry3::from(Translation3::from(base + Vector3::new(offset, 0.0, 0.05)));
        let hand = robot.world_from_hand(&home) * error;
        let mut world = template.spawn(&hand, &start, 0.0);
        world.set_gravity(&Vector3::zeros());
        world.place_arm(&error, &home[..6]);
        world.drive_arm(&home[..6], false);
        world.step(&hand, &[]).unwrap();
        let mut found = false;
        world.each_arm_contact(|contact| found |= contact.body == 6);
        found
    };
    // The base is round, with its axis at its origin.
    let radius = (0..400).map(|i| f64::from(i) * 5e-4).find(|offset| !at(*offset)).unwrap();
    let other = (0..400).map(|i| -f64::from(i) * 5e-4).find(|offset| !at(*offset)).unwrap();
    assert!(radius > 0.05 && (radius + other).abs() < 2e-3, "{radius} and {other} m");
}

/// What no arm can do is refused with the reason.
#[test]
fn impossible_arms_are_refused() {
    let refused = |arm: &str, base: Isometry3<f64>| objects_on(arm, Some(base)).err().unwrap().to_string();
    assert!(refused("fr3", Isometry3::translation(-0.5, 0.0, -0.3)).contains("under the table"));
    assert!(refused("fr3", Isometry3::translation(-50.0, 0.0, 0.0)).contains("base"));
    let pool = |objects: Arc<Objects>, config: EnvConfig| {
        let made = EnvPool::new(objects, config, 1);
        let pool = match made {
            Err(error) => return error.to_string(),
            Ok(pool) => pool,
        };
        pool.reset(&seeds(&pool), None, &ResetOptions::default())
            .err()
            .map_or_else(String::new, |error| error.to_string())
    };
    let far = objects_on("fr3", Some(Isometry3::translation(-3.0, 0.0, 0.0))).unwrap();
    assert!(pool(Arc::clone(&far), plain()).contains("too far"));
    // For a decision the arm waits at home, wherever it stands.
    let decides = EnvConfig { control: Control::GraspPose, ..plain() };
    assert_eq!(pool(far, decides), "");
    let head_down = Isometry3::from_parts(
        Translation3::new(-0.5, 0.0, 0.3),
        UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI),
    );
    assert!(pool(objects_on("fr3", Some(head_down)).unwrap(), plain()).contains("home"));
    let heavy = Objects::new(
        vec![Source::Procedural { name: "box".into(), family: Family::Box, seed: 0, scale: 1.0, mass: None }],
        Arc::new(hand("panda_gripper")),
        PhysicsConfig::default(),
        None,
    );
    let arm = Arc::new(arm_asset("so101").unwrap().read().unwrap());
    assert!(heavy.unwrap().on_arm(arm, None).err().unwrap().to_string().contains("kg"));
    let rapier = PhysicsConfig { engine: graspbox_sim::EngineKind::Rapier, ..PhysicsConfig::default() };
    let (_, carried) =
        RobotArm::new(Arc::new(arm_asset("fr3").unwrap().read().unwrap()), &hand("panda_gripper"), None).unwrap();
    let ball = ObjectModel::solid(&Geometry::Ball { radius: 0.03 }, 0.2).unwrap();
    assert!(Template::new(carried, &ball, rapier).err().unwrap().to_string().contains("arm"));
}

/// A requested pose that the arm does not reach is refused with the reason; one that it reaches is met.
#[test]
fn requested_poses_are_met_or_refused() {
    let pool = pool_on("fr3", plain(), 1);
    let rows = |x: f64, z: f64, tilt: f64| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), tilt)
            * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let pose = Isometry3::from_parts(Translation3::new(x, 0.0, z), turn).to_homogeneous();
        let rows = std::array::from_fn(|row| std::array::from_fn(|column| pose[(row, column)]));
        ResetOptions { world_from_hand: Some(rows), ..ResetOptions::default() }
    };
    pool.reset(&[Some(0)], None, &rows(0.0, 0.3, 0.0)).unwrap();
    let found = pool.env(0).unwrap().episode().unwrap().episode().world().world_from_hand();
    assert!((found.translation.vector - Vector3::new(0.0, 0.0, 0.3)).norm() < 1e-5);
    let refused = pool.reset(&[Some(0)], None, &rows(-0.35, 0.75, 0.0)).unwrap_err().to_string();
    assert!(refused.contains("world_from_hand") && refused.contains("fr3"), "{refused}");
}

/// A hand that is driven down stops above the table, and the info says what stopped the arm.
#[test]
fn a_blocked_arm_says_so() {
    let config = EnvConfig { control: Control::JointVelocity, ..plain() };
    let pool = pool_on("fr3", config, 1);
    pool.reset(&[Some(0)], None, &ResetOptions::default()).unwrap();
    // The second joint bends the arm forwards, into the table.
    let mut action = vec![0.0; pool.spec().action];
    action[1] = 1.0;
    let blocked = (0..15).any(|_| flags(&pool.step(&action).unwrap().now, "arm_blocked")[0]);
    assert!(blocked);
    let env = pool.env(0).unwrap();
    let lowest = pool.spec().guard.lowest(&env.episode().unwrap().episode().world().world_from_hand());
    assert!((0.0..0.05).contains(&lowest), "{lowest} m");
}
