//! One long step in place of several short ones: only where nothing can touch, and with the same result.
#![allow(clippy::unwrap_used)]

use graspbox_hand::assets::asset;
use graspbox_hand::{ActuatorCommand, Hand};
use graspbox_sim::{Geometry, PhysicsConfig, Template, World};
use graspbox_tests::bench::{at, away, bits, closing, palm_down, run, template};
use nalgebra::{Isometry3, Vector3};

const CAN: Geometry = Geometry::Cylinder { radius: 0.033, half_length: 0.05 };

fn can(hand: Hand) -> Template {
    template(hand, &CAN, 0.3, PhysicsConfig::default())
}

/// A can that stands and sleeps, the open hand far from it.
fn asleep(hand: Hand) -> World {
    asleep_under(hand, &away())
}

/// The same, the hand at a pose in the world.
fn asleep_under(hand: Hand, world_from_hand: &Isometry3<f64>) -> World {
    let mut world = can(hand).spawn(world_from_hand, &upright(), 0.0);
    run(&mut world, world_from_hand, &[], 0.4);
    assert!(world.is_free());
    world
}

/// The pose of the can on the table: its axis is its y axis.
fn upright() -> Isometry3<f64> {
    at(0.0, 0.0, 0.05) * Isometry3::rotation(Vector3::x() * std::f64::consts::FRAC_PI_2)
}

fn joints(world: &World) -> Vec<f64> {
    world.hand().coordinates().map(|joint| world.joint(joint).position).collect()
}

fn farthest(some: &[f64], others: &[f64]) -> f64 {
    some.iter().zip(others).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// A hand that rises from `away` with 0.3 m/s.
fn rising(time: f64) -> Isometry3<f64> {
    at(0.0, 0.0, 0.3 * time) * away()
}

/// A bug here: springs that make a long step unstable, a servo against a load that its own motion made, a clock that counts steps but not their
/// length, a frame whose acceleration is lost.
#[test]
fn fingers_close_in_long_steps_as_in_short_ones() {
    for name in ["reflex", "leap", "soft_hand", "inspire", "panda_gripper", "robotiq_2f_85"] {
        let hand = asset(name).unwrap().read().unwrap();
        let mut short = asleep(hand);
        let (mut long, close, dt) = (short.clone(), closing(short.hand(), 0.0), short.dt());
        let (steps, travel) = (short.free_steps(), 0.5);
        assert_eq!(steps, 5);
        let (mut taken, mut most) = (0, 0.0_f64);
        for piece in 1..=(travel / (f64::from(steps) * dt)) as u32 {
            let time = f64::from(piece * steps) * dt;
            for step in 1..=steps {
                short.step(&rising(f64::from((piece - 1) * steps + step) * dt), &close).unwrap();
            }
            if long.step_freely(&rising(time), &close, steps).unwrap() {
                taken += 1;
            } else {
                for step in 1..=steps {
                    long.step(&rising(f64::from((piece - 1) * steps + step) * dt), &close).unwrap();
                }
            }
            most = most.max(farthest(&joints(&short), &joints(&long)));
            assert!((short.time() - long.time()).abs() < 1e-12);
        }
        println!("{name}: {taken} long steps, joints differ by {most:.4}");
        assert!(taken >= 10, "{name} takes {taken} long steps");
        assert!(most < 0.03, "{name}: {most}");
        let apart = short.world_from_object().inv_mul(&long.world_from_object());
        assert!(apart.translation.vector.norm() < 1e-9, "{name} moves the can");
    }
}

/// A bug here: a step over the moment in which fingers or table come within reach; a refused step that moves actuators, hand or objects.
#[test]
fn no_long_step_near_anything() {
    let over = |height: f64| palm_down(0.0, 0.0, height);
    let mut world = asleep_under(asset("reflex").unwrap().read().unwrap(), &over(0.5));
    let (steps, close) = (world.free_steps(), closing(world.hand(), 0.0));
    // Down with 0.5 m/s, while the fingers close around the can, 0.1 m high.
    let mut height = 0.5;
    loop {
        height -= 0.5 * f64::from(steps) * world.dt();
        let before = world.clone();
        if !world.step_freely(&over(height), &close, steps).unwrap() {
            assert_eq!(bits(&world), bits(&before), "a refused step changes the world");
            break;
        }
        assert!(height > 0.08, "a long step through the can");
        assert!(world.hand_contacts().is_empty() && world.is_free());
    }
    println!("the first short step begins at {height:.3} m");
    assert!(height < 0.4, "the fingers, 0.14 m long, are 0.1 m above the can");
}

/// A bug here: a reach by the speed at which a step begins, which fingers that start to move leave far behind.
#[test]
fn fast_fingers_meet_no_object_in_a_long_step() {
    for name in ["leap", "reflex", "inspire", "soft_hand"] {
        let hand = asset(name).unwrap().read().unwrap();
        let fastest: Vec<_> = hand.actuators.iter().map(|actuator| actuator.max_speed).collect();
        let commands: Vec<_> = fastest.iter().map(|speed| ActuatorCommand::Velocity(*speed)).collect();
        // A can that stands where the fingers close: around its axis, or beside the palm.
        let mut met = 0;
        for height in [0.12, 0.13, 0.14, 0.15, 0.16, 0.18, 0.2] {
            for aside in [0.0, 0.03, 0.05, 0.07, 0.09] {
                let pose = palm_down(aside, 0.0, height);
                let mut world = can(hand.clone()).spawn(&pose, &upright(), 0.0);
                run(&mut world, &pose, &[], 0.4);
                if !world.is_free() {
                    continue;
                }
                let (steps, start) = (world.free_steps(), world.world_from_object());
                while world.step_freely(&pose, &commands, steps).unwrap() {
                    assert!(world.time() < 5.0);
                    if world.time() > 2.0 {
                        break;
                    }
                }
                world.step(&pose, &commands).unwrap();
                let hardest = world.hand_contacts().iter().map(|contact| contact.force).fold(0.0, f64::max);
                let moved = start.inv_mul(&world.world_from_object()).translation.vector.norm();
                // The force of half a millimetre of overlap.
                assert!(hardest < 60.0, "{name} at {height}, {aside}: {hardest} N in the first short step");
                assert!(moved < 2e-3, "{name} at {height}, {aside}: the can jumps by {moved} m");
                met += usize::from(world.time() < 2.0);
            }
        }
        println!("{name}: {met} long closings end at something");
        assert!(met > 2);
    }
}

/// A bug here: an object that hangs in the air because it sleeps.
#[test]
fn what_acts_on_a_sleeper_wakes_it() {
    let rests = || asleep(asset("panda_gripper").unwrap().read().unwrap());
    let pushed = |act: &dyn Fn(&mut World)| {
        let mut world = rests();
        let start = world.object_center();
        act(&mut world);
        let steps = world.free_steps();
        assert!(!world.step_freely(&away(), &[], steps).unwrap(), "a long step is taken");
        run(&mut world, &away(), &[], 0.2);
        (world.object_center() - start).norm()
    };
    assert!(pushed(&|world| world.set_gravity(&Vector3::new(6.0, 0.0, -8.0))) > 0.01);
    assert!(pushed(&|world| world.set_object_force(&Vector3::new(3.0, 0.0, 0.0))) > 0.01);
    assert!(pushed(&|world| world.set_object_velocity(&Vector3::new(0.5, 0.0, 0.0), &Vector3::zeros())) > 0.01);
    let mut still = rests();
    let start = still.world_from_object();
    run(&mut still, &away(), &[], 1.0);
    assert_eq!(still.world_from_object(), start, "a sleeper moves by nothing");
}

/// A bug here: a state whose long steps depend on what is not saved.
#[test]
fn a_restored_world_takes_the_same_long_steps() {
    let template = can(asset("reflex").unwrap().read().unwrap());
    let mut world = template.spawn(&away(), &upright(), 0.0);
    run(&mut world, &away(), &[], 0.4);
    let mut copy = template.restore(&world.snapshot().unwrap()).unwrap();
    let steps = world.free_steps();
    let commands: Vec<ActuatorCommand> = closing(world.hand(), 0.0);
    for piece in 1..=20 {
        let hand = rising(f64::from(piece * steps) * world.dt());
        let long = world.step_freely(&hand, &commands, steps).unwrap();
        assert_eq!(long, copy.step_freely(&hand, &commands, steps).unwrap());
        if !long {
            world.step(&hand, &commands).unwrap();
            copy.step(&hand, &commands).unwrap();
        }
        assert_eq!(bits(&world), bits(&copy), "piece {piece}");
    }
}
