//! Points on an arm and its hand are told from others.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_arm::{ArmBodies, Inverse, Mounted, on_arm};
use graspbox_hand::arm::assets::arm_asset;
use graspbox_hand::assets::asset;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

/// A closed finger is between the open ones, and a margin reaches as far as it says.
#[test]
fn points_are_on_links_and_on_fingers_open_or_closed() {
    let arm = arm_asset("ur5e").unwrap().read().unwrap();
    let inverse = Inverse::new(&arm);
    let bodies = ArmBodies::new(&arm, inverse.chain());
    let hand = asset("panda_gripper").unwrap().read().unwrap();
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.4);
    let world_from_base = Isometry3::from_parts(Translation3::new(0.3, -0.2, 0.1), turn);
    let frames = arm.forward_kinematics(&arm.home()).unwrap();
    let flange_from_base = arm.flange_from_base_of(&hand);
    let hand_from_world = world_from_base * frames[arm.flange] * flange_from_base * hand.base_from_hand;
    let fingers: Vec<Point3<f64>> = [0.0, 1.0]
        .iter()
        .flat_map(|share| hand.shapes_at(&hand.closed_configuration(0.0, *share)).unwrap())
        .map(|shape| Point3::from((hand_from_world * shape.hand_from_shape).translation.vector))
        .collect();
    let links = frames.iter().take(arm.flange).map(|frame| Point3::from((world_from_base * frame).translation.vector));
    let mut points: Vec<Point3<f64>> = links.collect();
    let on_links = points.len();
    points.extend(&fingers);
    points.push(world_from_base * Point3::new(0.0, 0.0, -0.5));
    let near = |hand, distance: f64| {
        let distances = vec![distance; points.len()];
        on_arm((&inverse, &bodies), &arm.home(), &world_from_base, hand, &points, &distances).unwrap()
    };
    let mounted = Mounted { hand: &hand, flange_from_base };
    let with = near(Some(mounted), 0.001);
    assert!(with[on_links..points.len() - 1].iter().all(|near| *near), "{with:?}");
    assert!(!with[points.len() - 1]);
    assert!(near(None, 0.001)[on_links..].iter().any(|near| !near));
    assert!(with[..on_links].iter().filter(|near| **near).count() >= 4, "{with:?}");
    assert!(near(None, 1.0).iter().all(|near| *near));
}
