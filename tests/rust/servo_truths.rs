//! Slides and servos against closed forms: the force at the limit, the speed, and the stops.
#![allow(clippy::unwrap_used)]

use graspbox_hand::assets::asset;
use graspbox_hand::{ActuatorCommand, Shape};
use graspbox_sim::{EngineKind, Geometry, PhysicsConfig, SimError, Template, World};
use graspbox_tests::bench::{at, away, closing, palm_down, run, template, two_servos};
use nalgebra::Vector3;
use std::sync::Arc;

/// A heavy block between the fingers, whose pads are 80 mm apart; it is as wide as `width`.
fn around(width: f64, engine: EngineKind) -> World {
    let block = Geometry::Cuboid(Vector3::new(width / 2.0, width / 2.0, 0.05));
    let template = template(two_servos(), &block, 100.0, PhysicsConfig { engine, ..PhysicsConfig::default() });
    template.spawn(&palm_down(0.0, 0.0, 0.13), &at(0.0, 0.0, 0.05), 0.0)
}

const ENGINES: [EngineKind; 2] = [EngineKind::Implicit, EngineKind::Rapier];

fn positions(world: &World) -> Vec<f64> {
    world.hand().coordinates().map(|joint| world.joint(joint).position).collect()
}

/// A bug here: a limit in engine units, a damper that adds to a saturated force, a finger that pushes the wrong way.
#[test]
fn each_finger_presses_with_the_limit_of_its_servo() {
    for engine in ENGINES {
        presses(engine);
    }
}

fn presses(engine: EngineKind) {
    let mut world = around(0.05, engine);
    let close = closing(world.hand(), 0.0);
    run(&mut world, &palm_down(0.0, 0.0, 0.13), &close, 1.5);
    for (chain, joint) in [(0, 0), (1, 1)] {
        let link = world.hand().joints[joint].child;
        let force: f64 = world.link_contacts().iter().filter(|c| c.link == link).map(|c| c.force).sum();
        println!("{engine:?}, finger {chain}: presses with {force:.2} N, load {:.2} N", world.load(chain));
        assert!((force / 140.0 - 1.0).abs() < 0.02 && (world.load(chain) - 140.0).abs() < 1e-9);
    }
    for position in positions(&world) {
        assert!((position - 0.025).abs() < 1e-3, "the fingers stand at the sides of the block: {position}");
    }
}

/// A bug here: positions in centimetres, or a speed that is not the actuator's.
#[test]
fn free_fingers_close_at_their_speed_and_stop_at_their_limits() {
    for engine in ENGINES {
        closes(engine);
    }
}

fn closes(engine: EngineKind) {
    let mut world = around(0.02, engine);
    let hand = away();
    let open = positions(&world);
    assert!(open.iter().all(|position| (position - 0.04).abs() < 1e-6), "{open:?}");
    let close = closing(world.hand(), 0.0);
    let mut last = open;
    for step in 1..=600 {
        world.step(&hand, &close).unwrap();
        if step == 300 {
            // 0.6 s at 0.05 m/s; the servo lags by damping / stiffness of that, 0.15 mm, and the armature.
            for position in positions(&world) {
                assert!((position - 0.01).abs() < 0.5e-3, "{position}");
            }
        }
        let now = positions(&world);
        assert!(now.iter().zip(&last).all(|(now, last)| *now <= last + 1e-5), "a finger moved back at step {step}");
        last = now;
    }
    assert!(last.iter().all(|position| position.abs() < 1e-4), "{last:?}");
    let half: Vec<_> = (0..2).map(|_| ActuatorCommand::Position { target: 0.02, speed: None }).collect();
    run(&mut world, &hand, &half, 1.0);
    assert!(positions(&world).iter().all(|position| (position - 0.02).abs() < 1e-4));
}

/// Fingers with wide blocks at their sides meet half closed, unless the hand's file says that they pass through each other.
#[test]
fn shapes_without_contact_pass_through_each_other() {
    for (engine, passes) in ENGINES.into_iter().flat_map(|engine| [(engine, false), (engine, true)]) {
        let mut hand = two_servos();
        for data in &mut hand.links {
            for collider in data.colliders.iter_mut().filter(|collider| collider.name.ends_with("finger_body")) {
                collider.shape = Shape::Cuboid(Vector3::new(0.01, 0.035, 0.02));
            }
        }
        if passes {
            let [left, right] = [0, 1].map(|joint| hand.joints[joint].child);
            let others: Vec<_> = hand.shapes_of_body(right).collect();
            let pairs = hand.shapes_of_body(left).flat_map(|one| others.iter().map(move |two| [one, *two]));
            hand.no_contact.shapes = pairs.collect();
        }
        let config = PhysicsConfig { engine, ..PhysicsConfig::default() };
        let template = template(hand, &Geometry::Ball { radius: 0.02 }, 0.1, config);
        let mut world = template.spawn(&away(), &at(0.0, 0.0, 0.02), 0.0);
        let close = closing(world.hand(), 0.0);
        run(&mut world, &away(), &close, 1.5);
        let reached = positions(&world);
        println!("{engine:?}, without contact {passes}: the fingers reach {reached:?}");
        assert!(reached.iter().all(|position| (*position < 1e-3) == passes), "{engine:?}, {passes}: {reached:?}");
    }
}

/// The shipped gripper moves both fingers with one servo: each presses with half of its force, 70 N, wherever the block is.
#[test]
fn coupled_fingers_share_the_force_of_their_servo() {
    let panda = asset("panda_gripper").unwrap().read().unwrap();
    let block = Geometry::Cuboid(Vector3::new(0.02, 0.02, 0.05));
    let template = template(panda, &block, 100.0, PhysicsConfig::default());
    let hand = palm_down(0.0, 0.0, 0.13);
    let mut world = template.spawn(&hand, &at(0.0, 0.0, 0.05), 0.0);
    let close = closing(world.hand(), 0.0);
    run(&mut world, &hand, &close, 1.5);
    assert!((world.load(0) - 140.0).abs() < 1e-9, "{} N", world.load(0));
    for joint in 0..2 {
        let link = world.hand().joints[joint].child;
        let force: f64 = world.link_contacts().iter().filter(|c| c.link == link).map(|c| c.force).sum();
        assert!((force / 70.0 - 1.0).abs() < 0.02, "finger {joint}: {force} N");
        assert!((world.joint(joint).position - 0.02).abs() < 1e-3);
    }
    assert_eq!(world.joint(0).position, world.joint(1).position, "the second follows the first");
}

/// One servo turns both knuckles of the linkage: half of its torque bears the moment of a pad's normal force about its knuckle, and of the
/// friction along the arc on which the pad moves. The arms are those of the fingertip's hinge; that of friction is 0 at an opening of 10.7 mm.
#[test]
fn the_pads_of_a_linkage_press_with_the_torque_of_their_servo() {
    let gripper = asset("robotiq_2f_85").unwrap().read().unwrap();
    // Width of the block, position of the knuckles, arms of the normal force and of friction, with a coefficient of at most 1.
    for (width, position, arm, across) in
        [(0.05_f64, 0.3567_f64, 0.05366_f64, 0.02_f64), (0.02, 0.6262, 0.05696, 0.005), (0.0107, 0.7077, 0.05715, 0.0)]
    {
        let block = Geometry::Cuboid(Vector3::new(width / 2.0, 0.02, 0.05));
        let template = template(gripper.clone(), &block, 100.0, PhysicsConfig::default());
        let hand = palm_down(0.0, 0.0, 0.13);
        let mut world = template.spawn(&hand, &at(0.0, 0.0, 0.05), 0.0);
        let close = closing(world.hand(), 0.0);
        run(&mut world, &hand, &close, 1.5);
        assert!((world.load(0) - 20.4).abs() < 1e-9, "{} N m", world.load(0));
        let found = world.joint(0).position;
        assert!((found - position).abs() < 0.01, "{found} rad");
        let bounds = [10.2 / (arm + across), 10.2 / arm];
        for side in ["left", "right"] {
            let link = world.hand().links.iter().position(|link| link.name == format!("{side}_finger_tip_link"));
            let contacts = world.link_contacts();
            let force: f64 = contacts.iter().filter(|c| Some(c.link) == link).map(|c| c.force).sum();
            println!("{side} pad on {width} m: {force:.1} N, expected {bounds:.1?} N, at {found:.4} rad");
            assert!((0.98 * bounds[0]..1.02 * bounds[1]).contains(&force), "{force} N at {found}");
        }
    }
}

/// Joints that follow others under forces are beyond this engine: it says so, and names itself.
#[test]
fn a_hand_that_the_engine_cannot_simulate_is_refused() {
    let config = PhysicsConfig { engine: EngineKind::Rapier, ..PhysicsConfig::default() };
    let block = graspbox_sim::ObjectModel::solid(&Geometry::Ball { radius: 0.03 }, 0.1).unwrap();
    let refused = [
        ("panda_gripper", "finger_joint2"),
        ("soft_hand", "thumb_inner_mimic"),
        ("robotiq_2f_85", "left_finger_tip_joint"),
    ];
    for (name, joint) in refused {
        let hand = Arc::new(asset(name).unwrap().read().unwrap());
        let error = Template::new(hand, &block, config).err().unwrap();
        assert!(matches!(error, SimError::BadHand { engine: "rapier", .. }), "{error}");
        let message = format!(
            "the engine `rapier` cannot simulate the hand `{name}`: joint `{joint}` mimics a joint that is not driven rigidly; \
             choose another engine"
        );
        assert_eq!(error.to_string(), message);
    }
}
