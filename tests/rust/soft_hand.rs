//! The SoftHand against measurements of its authors: how long it takes to close, and how hard it holds.
#![allow(clippy::unwrap_used)]

use graspbox_hand::Hand;
use graspbox_hand::assets::asset;
use graspbox_sim::{Geometry, ObjectModel, PhysicsConfig, Template, World};
use graspbox_tests::bench::{at, closing, run, template};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

fn hand() -> Hand {
    asset("soft_hand").unwrap().read().unwrap()
}

/// The hand 1 m above the table, its palm up, so that nothing but the object touches it.
fn palm_up() -> Isometry3<f64> {
    at(0.0, 0.0, 1.0)
}

/// A hand that closed about `object`, which lay on its palm at `hand_from_object`.
fn closed_about(object: &ObjectModel, hand_from_object: &Isometry3<f64>) -> World {
    let template = Template::new(Arc::new(hand()), object, PhysicsConfig::default()).unwrap();
    let mut world = template.spawn(&palm_up(), &(palm_up() * hand_from_object), 0.0);
    let close = closing(world.hand(), 0.0);
    run(&mut world, &palm_up(), &close, 2.0);
    world
}

/// From open to fist in 1.1 s, give or take 0.2.
#[test]
fn the_hand_closes_in_the_published_time() {
    let template = template(hand(), &Geometry::Ball { radius: 0.02 }, 0.1, PhysicsConfig::default());
    let mut world = template.spawn(&palm_up(), &at(0.3, 0.0, 0.02), 0.0);
    let close = closing(world.hand(), 0.0);
    let flexed = |world: &World| -> f64 {
        let joints = world.hand().coordinates().filter(|j| !world.hand().joints[*j].name.ends_with("abd"));
        joints.map(|joint| world.joint(joint).position).sum()
    };
    let mut history = Vec::new();
    for _ in 0..1000 {
        world.step(&palm_up(), &close).unwrap();
        history.push(flexed(&world));
    }
    let end = history[history.len() - 1];
    let time = history.iter().position(|flexed| *flexed > 0.95 * end).unwrap() as f64 * world.dt();
    println!(
        "14 flexions end at {:.2} rad on average, after {time:.2} s, tension {:.1} N",
        end / 14.0,
        world.tension(0)
    );
    assert!((time - 1.1).abs() < 0.2, "{time} s");
}

/// A preshape may wind the tendon: the hand begins where its springs balance it, and stays there.
#[test]
fn a_bent_preshape_stays_where_it_begins() {
    let files = asset("soft_hand").unwrap();
    let preshape = "[[grasp.preshapes]]\nname = \"bent\"\n\
        positions.motor = { value = 6.0, unit = \"rad\", source = \"test\" }\n\n[grasp.ranking]\n";
    let toml = files.toml.replace("[grasp.ranking]\n", preshape);
    let bent = Hand::from_strs(files.urdf, &toml, ["soft_hand.urdf", "hand.toml"]).unwrap();
    let template = template(bent, &Geometry::Ball { radius: 0.02 }, 0.1, PhysicsConfig::default());
    let mut world = template.spawn(&palm_up(), &at(0.3, 0.0, 0.02), 0.0);
    world.set_gravity(&Vector3::zeros());
    let positions =
        |world: &World| -> Vec<f64> { world.hand().coordinates().map(|joint| world.joint(joint).position).collect() };
    let begin = positions(&world);
    assert!(begin.iter().filter(|position| **position > 0.1).count() >= 14, "{begin:?}");
    for _ in 0..250 {
        world.step(&palm_up(), &[]).unwrap();
    }
    let moved = begin.iter().zip(positions(&world)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    println!("moved by at most {moved:.5} rad, tension {:.2} N", world.tension(0));
    assert!(moved < 0.01, "{moved} rad");
}

/// A cylinder of 45 mm is pulled along its axis until it slips: 20 N, give or take a quarter.
#[test]
fn a_cylinder_is_held_with_the_published_force() {
    const MASS: f64 = 2.0;
    let turned = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2);
    let cylinder = ObjectModel::solid(&Geometry::Cylinder { radius: 0.0225, half_length: 0.06 }, MASS).unwrap();
    let mut forces = Vec::new();
    for x in [0.0, 0.01, 0.02] {
        for direction in [1.0, -1.0] {
            let place = Isometry3::from_parts(Translation3::new(x, 0.01, 0.0255), turned);
            let mut world = closed_about(&cylinder, &place);
            let close = closing(world.hand(), 0.0);
            let held = world.hand_from_object() * Point3::origin();
            let mut force = 0.0;
            // 5 N per second along the axis.
            while force < 80.0 && (world.hand_from_object() * Point3::origin() - held).y.abs() < 0.005 {
                force += 5.0 * world.dt();
                world.set_gravity(&Vector3::new(0.0, direction * force / MASS, 0.0));
                world.step(&palm_up(), &close).unwrap();
            }
            println!("at x = {x}: held at {held}, slips at {force:.1} N, tension {:.1} N", world.tension(0));
            forces.push(force);
        }
    }
    let mean = forces.iter().sum::<f64>() / forces.len() as f64;
    println!("mean {mean:.1} N");
    assert!((mean / 20.0 - 1.0).abs() < 0.25, "{forces:?}");
}

/// Greatest torque, N m, that the closed hand puts on a disk that a shaft holds and turns slowly, by 0.6 rad, in one sense.
///
/// The disk weighs so much that a step changes its motion by almost nothing; that change gives the torque.
fn holding_torque(hand_from_disk: &Isometry3<f64>, sense: f64) -> f64 {
    const MASS: f64 = 2000.0;
    const RADIUS: f64 = 0.0475;
    const SPEED: f64 = 0.2;
    let inertia = 0.5 * MASS * RADIUS * RADIUS;
    let disk = ObjectModel::solid(&Geometry::Cylinder { radius: RADIUS, half_length: 0.01 }, MASS).unwrap();
    let template = Template::new(Arc::new(hand()), &disk, PhysicsConfig::default()).unwrap();
    let mut world = template.spawn(&palm_up(), &(palm_up() * hand_from_disk), 0.0);
    world.set_gravity(&Vector3::zeros());
    let close = closing(world.hand(), 0.0);
    let axis = (palm_up() * hand_from_disk) * Vector3::z();
    let mut torques = Vec::new();
    for (angular, seconds) in [(Vector3::zeros(), 2.0), (axis * (sense * SPEED), 3.0)] {
        torques.clear();
        for _ in 0..(seconds / world.dt()).round() as usize {
            world.set_object_velocity(&Vector3::zeros(), &angular);
            world.step(&palm_up(), &close).unwrap();
            let change = palm_up().rotation * world.object_velocity_in_hand().1 - angular;
            torques.push(-sense * axis.dot(&change) * inertia / world.dt());
        }
    }
    let mean = |window: &[f64]| window.iter().sum::<f64>() / window.len() as f64;
    torques.windows(25).map(mean).fold(0.0, f64::max)
}

/// A disk of 95 mm, flat before the palm as a lid that is opened, its middle 40 mm towards the fingertips and 30 mm from the palm. The
/// published torque is 2 N m, but how the disk lay is not known, and its place decides: the bounds are those of nine places of a lid, in
/// both senses. Here it is held with 3.4 N m on average.
#[test]
fn a_disk_on_a_shaft_is_held_in_both_senses() {
    let torques = [1.0, -1.0].map(|sense| holding_torque(&at(0.04, 0.01, 0.03), sense));
    println!("{torques:.2?} N m");
    assert!(torques.iter().all(|torque| (0.3..=11.0).contains(torque)), "{torques:?}");
}
