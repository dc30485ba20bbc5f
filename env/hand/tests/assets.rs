//! The hands that come with the project, against the figures that their makers publish.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_hand::assets::{ASSETS, asset};
use graspbox_hand::{Drive, Hand, JointKind, Shape, Transmission};
use nalgebra::{Point3, Vector3};
use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, FRAC_PI_8};

fn hand(name: &str) -> Hand {
    asset(name).unwrap().read().unwrap()
}

/// Joint positions by name; all others are at 0.
fn configuration(hand: &Hand, positions: &[(&str, f64)]) -> Vec<f64> {
    let position = |joint: usize| {
        let name = &hand.joints[joint].name;
        positions.iter().find(|(part, _)| name.contains(part)).map_or(0.0, |(_, position)| *position)
    };
    hand.coordinates().map(position).collect()
}

#[test]
fn every_asset_is_a_hand_of_its_name() {
    for asset in &ASSETS {
        let hand = asset.read().unwrap();
        assert_eq!(hand.name, asset.name);
        // Tests of planner and environments take any of them: all close, and open where their actuators begin.
        assert!(hand.coordinates().any(|joint| hand.closing_rate(joint) != 0.0));
        let open = hand.open_configuration(hand.preshape_limits()[0]);
        for (joint, position) in hand.coordinates().zip(open) {
            let [lower, upper] = hand.joints[joint].limits;
            assert!((lower..=upper).contains(&position), "{}", hand.joints[joint].name);
        }
    }
}

/// Both fingers move by 40 mm, so the pads are 80 mm apart in the open hand and meet in the closed one.
#[test]
fn the_gripper_opens_to_80_millimetres() {
    let hand = hand("panda_gripper");
    assert!(hand.joints.iter().all(|joint| joint.kind == JointKind::Prismatic));
    assert_eq!((hand.chain_count(), hand.coordinates().count(), hand.sensors.len()), (2, 1, 0));
    let gap = |configuration: &[f64]| {
        let shapes = hand.shapes_at(configuration).unwrap();
        let pads: Vec<_> = shapes.iter().filter(|s| s.collider.name.ends_with("pad")).collect();
        let Shape::Cuboid(half) = pads[0].collider.shape else { panic!("pads are boxes") };
        // The fingers close along the hand's x axis.
        let [a, b] = [0, 1].map(|i| pads[i].hand_from_shape.translation.vector);
        assert!((a - b).yz().norm() < 1e-12, "the pads face each other along x");
        (a - b).norm() - 2.0 * half.y
    };
    let (open, closed) = (hand.open_configuration(0.0), hand.closed_configuration(0.0, 1.0));
    assert!((gap(&open) - 0.08).abs() < 1e-12 && gap(&closed).abs() < 1e-12);
    // The actuator closes from 0 to 0.04, the joint from 0.04 to 0.
    assert_eq!((hand.open_positions(0.0), hand.closed_positions(0.0)), (vec![0.0], vec![0.04]));
    let Transmission::Joints { joints, drive: Drive::Servo { .. } } = &hand.actuators[0].transmission else {
        panic!("a servo drives the fingers")
    };
    assert_eq!([0.0, 0.01, 0.04, 0.05].map(|position| hand.led(&joints[0], position)), [0.04, 0.03, 0.0, 0.0]);
    let mass: f64 = hand.links.iter().map(|link| link.mass).sum();
    assert!((0.7..0.8).contains(&mass), "{mass} kg");
}

/// The linkage of the 2F-85: the pads stay parallel, are 85 mm apart in the open hand and meet in the closed one, and the tips advance from
/// 149.3 to 162.8 mm before the mounting plane.
#[test]
fn the_linkage_closes_85_millimetres_with_parallel_pads() {
    let hand = hand("robotiq_2f_85");
    assert_eq!((hand.chain_count(), hand.coordinates().count(), hand.actuators.len()), (2, 1, 1));
    assert_eq!(hand.joints.iter().filter(|joint| joint.mimic.is_some()).count(), 5);
    let mass: f64 = hand.links.iter().map(|link| link.mass).sum();
    assert!((mass - 0.9).abs() < 1e-3, "{mass} kg");
    assert_eq!((hand.open_configuration(0.0), hand.closed_configuration(0.0, 1.0)), (vec![0.0], vec![0.8]));
    // Opening between the pads, and the height of their ends over the base.
    let measured = |position: f64| {
        let shapes = hand.shapes_at(&[position]).unwrap();
        let pads: Vec<_> = shapes.iter().filter(|s| s.collider.name.ends_with("pad")).collect();
        let Shape::Cuboid(half) = pads[0].collider.shape else { panic!("pads are boxes") };
        assert!(pads.iter().all(|pad| pad.hand_from_shape.rotation.angle() < 1e-12), "the pads face each other");
        let [a, b] = [0, 1].map(|i| pads[i].hand_from_shape.translation.vector);
        assert!((a - b).yz().norm() < 1e-12 && a.x > 0.0);
        ((a - b).norm() - 2.0 * half.x, a.z + half.z + hand.base_from_hand.translation.z)
    };
    for (position, opening, height) in [(0.0, 0.085, 0.1493), (0.4, 0.0453, 0.1604), (0.8, 0.0002, 0.1628)] {
        let found = measured(position);
        assert!((found.0 - opening).abs() < 1e-4 && (found.1 - height).abs() < 1e-4, "{position}: {found:?}");
    }
    // The inner knuckles are hinged on the base, as the tree of joints does not say.
    for position in [0.0, 0.3, 0.8] {
        let poses = hand.forward_kinematics(&[position]).unwrap();
        for (side, sign) in [("left", 1.0), ("right", -1.0)] {
            let link = hand.links.iter().position(|link| link.name == format!("{side}_inner_knuckle_link")).unwrap();
            let hinge = poses[link] * Point3::new(-0.0371575 * sign, 0.0, -0.0434217);
            let error = (hinge.coords - Vector3::new(0.0127 * sign, 0.0, 0.06142)).amax();
            assert!(error < 1e-5, "{side} at {position}: {hinge}");
        }
    }
}

#[test]
fn the_soft_hand_has_the_parts_of_its_paper() {
    let hand = hand("soft_hand");
    assert!(hand.joints.iter().all(|joint| joint.kind != JointKind::Prismatic));
    let revolute = hand.joints.iter().filter(|joint| joint.kind == JointKind::Revolute).count();
    let following = hand.joints.iter().filter(|joint| joint.mimic.is_some()).count();
    assert_eq!((revolute, following, hand.coordinates().count()), (33, 14, 19));
    assert_eq!((hand.chain_count(), hand.tendons.len(), hand.actuators.len()), (5, 1, 1));
    let mass: f64 = hand.links.iter().map(|link| link.mass).sum();
    assert!((mass - 0.48).abs() < 1e-9, "{mass} kg");
    // R R^T on half angles, and R q at all limits: 15.93 and 13.27.
    let ratios: Vec<(usize, f64)> = hand.tendons[0].arms.iter().map(|(joint, arm)| (*joint, arm / 0.007)).collect();
    assert!((ratios.iter().map(|(_, r)| r * r).sum::<f64>() - 15.93).abs() < 0.01);
    let most: f64 = hand.tendons[0].take_up(|joint| match hand.joints[joint].name.as_str() {
        "index_abd" => -0.2,
        "ring_abd" => 0.2,
        "little_abd" => 0.4,
        _ => hand.joints[joint].limits[1],
    });
    assert!((most / 0.007 - 13.27).abs() < 0.01, "{}", most / 0.007);
    // At its greatest speed the spool takes up all of it in the published 1.1 s.
    let Transmission::Spool { radius, .. } = hand.actuators[0].transmission else { panic!("a spool") };
    assert!((most / (radius * hand.actuators[0].max_speed) - 1.1).abs() < 0.02);
}

/// Positions of the joints whose names contain a part, rad; the first that fits holds.
type Positions = [(&'static str, f64)];

/// A fingertip is within 0.1 mm of its place in a published model, mm.
fn assert_near(finger: &str, tip: Vector3<f64>, expected: [f64; 3]) {
    let error = (tip - Vector3::from(expected)).amax();
    assert!(error < 0.1, "{finger}: {tip} is {error} mm from {expected:?}");
}

/// Fingertips (23.3 mm along the last link) of the published model, palm frame, mm: open, half closed, closed.
#[test]
fn fingertips_of_the_soft_hand_go_where_the_published_model_has_them() {
    let hand = hand("soft_hand");
    let half = [("thumb_abd", FRAC_PI_4), ("_abd", 0.0), ("", FRAC_PI_8)];
    let full = [("thumb_abd", FRAC_PI_2), ("_abd", 0.0), ("", FRAC_PI_4)];
    let figures: [(&Positions, [[f64; 3]; 5]); 3] = [
        (
            &[],
            [[9.0, 104.5, 85.6], [-3.3, 27.3, 182.7], [-3.3, 0.0, 190.0], [-3.3, -24.2, 182.9], [-3.3, -46.8, 172.7]],
        ),
        (
            &half,
            [[54.1, 28.9, 100.8], [57.5, 20.5, 104.6], [57.5, 0.0, 111.6], [57.5, -20.1, 104.6], [57.5, -40.0, 94.6]],
        ),
        (&full, [[4.9, 6.7, 72.9], [-8.4, 18.7, 84.5], [-8.4, 0.0, 91.5], [-8.4, -19.0, 84.5], [-8.4, -38.2, 74.5]]),
    ];
    for (positions, expected) in figures {
        let poses = hand.forward_kinematics(&configuration(&hand, positions)).unwrap();
        for (finger, expected) in ["thumb", "index", "middle", "ring", "little"].into_iter().zip(expected) {
            let link = hand.links.iter().position(|link| link.name == format!("{finger}_distal")).unwrap();
            let tip = (poses[link] * Point3::new(0.0233, 0.0, 0.0)).coords * 1e3;
            assert_near(finger, tip, expected);
        }
    }
}

/// Sixteen servos, one per joint. Fingertips (48 and 60 mm along the last links) are where MuJoCo Menagerie's model has them, palm frame, mm.
#[test]
fn fingertips_of_the_leap_hand_go_where_the_published_model_has_them() {
    let hand = hand("leap");
    assert_eq!((hand.chain_count(), hand.coordinates().count(), hand.actuators.len()), (4, 16, 16));
    assert!(hand.joints.iter().all(|joint| joint.kind == JointKind::Revolute && joint.mimic.is_none()));
    let mass: f64 = hand.links.iter().map(|link| link.mass).sum();
    assert!((mass - 0.746).abs() < 1e-9, "{mass} kg");
    let bent = [
        ("th_cmc", 1.2),
        ("th_axl", 0.4),
        ("th_mcp", 0.3),
        ("th_ipl", 0.5),
        ("mcp", 0.5),
        ("rot", 0.2),
        ("pip", 0.6),
        ("dip", 0.7),
    ];
    let closed = [
        ("th_cmc", 1.8),
        ("th_axl", 1.0),
        ("th_mcp", -0.5),
        ("th_ipl", 1.0),
        ("mcp", 1.0),
        ("rot", -0.3),
        ("pip", 1.0),
        ("dip", 0.5),
    ];
    let figures: [(&Positions, [[f64; 3]; 4]); 3] = [
        (&[], [[130.2, 7.6, -19.5], [130.1, -37.8, -19.5], [130.1, -83.2, -19.5], [-82.3, 136.7, -21.9]]),
        (&bent, [[43.5, -3.8, -123.1], [43.4, -49.2, -123.1], [43.4, -94.6, -123.1], [-30.1, 20.5, -139.3]]),
        (&closed, [[-33.2, 18.8, -124.2], [-33.3, -26.6, -124.2], [-33.3, -72.0, -124.2], [-79.1, -35.0, -141.9]]),
    ];
    for (positions, expected) in figures {
        let poses = hand.forward_kinematics(&configuration(&hand, positions)).unwrap();
        for (finger, expected) in ["if", "mf", "rf", "th"].into_iter().zip(expected) {
            let link = hand.links.iter().position(|link| link.name == format!("{finger}_ds")).unwrap();
            let [along, across] = if finger == "th" { [0.06, -0.015] } else { [0.048, 0.015] };
            let tip = (poses[link] * Point3::new(0.0, -along, across)).coords * 1e3;
            assert_near(finger, tip, expected);
        }
    }
}

/// Thumb and fingers face each other along hand x in every preshape, with the pads apart as the preshape's width says.
#[test]
fn the_thumb_of_the_leap_hand_opposes_the_fingers() {
    let hand = hand("leap");
    for preshape in hand.preshapes() {
        let shapes = hand.shapes_at(&hand.open_configuration(preshape.value)).unwrap();
        let pad = |name: &str| shapes.iter().find(|shape| shape.collider.name == format!("{name}_ds_pad")).unwrap();
        // Middle of the face of a pad, and its outward normal: -x of the link.
        let face = |name: &str| {
            let pad = pad(name);
            let Shape::Cuboid(half) = pad.collider.shape else { panic!("pads are boxes") };
            let out = pad.hand_from_shape.rotation * -Vector3::x();
            (pad.hand_from_shape.translation.vector + out * half.x, out)
        };
        let (thumb, out) = face("th");
        for finger in ["if", "mf", "rf"] {
            let (at, inward) = face(finger);
            assert!(out.x > 0.7 && inward.x < -0.6, "{}: {out} {inward}", preshape.name);
            let [_, widest] = preshape.face.width;
            assert!(at.x - thumb.x > widest && (at.z - thumb.z).abs() < 0.04, "{}: {thumb} {at}", preshape.name);
        }
    }
}

/// Six motors for twelve joints. Fingertips are where the models of robosuite, with the ratios of MuJoCo Menagerie, have them, base frame, mm.
#[test]
fn fingertips_of_the_inspire_hand_go_where_the_published_model_has_them() {
    let hand = hand("inspire");
    assert_eq!((hand.chain_count(), hand.coordinates().count(), hand.actuators.len()), (5, 6, 6));
    assert_eq!(hand.joints.iter().filter(|joint| joint.mimic.is_some()).count(), 6);
    let mass: f64 = hand.links.iter().map(|link| link.mass).sum();
    assert!((mass - 0.54).abs() < 1e-6, "{mass} kg");
    let closed = hand.joint_positions(&hand.closed_configuration(0.0, 1.0)).unwrap();
    for (joint, position) in hand.joints.iter().zip(closed).filter(|(joint, _)| !joint.is_fixed()) {
        assert!((position - joint.limits[1]).abs() < 1e-3, "{} closes to {position}", joint.name);
    }
    let figures: [([f64; 3], [[f64; 3]; 5]); 3] = [
        (
            [0.0, 0.0, 0.0],
            [
                [-41.8, -86.0, -112.4],
                [-0.3, -180.1, -28.9],
                [-0.1, -180.5, -7.0],
                [-0.1, -179.9, 16.2],
                [-0.1, -170.2, 38.5],
            ],
        ),
        (
            [1.3, 0.25, 0.6],
            [
                [-78.5, -114.6, -19.6],
                [-59.1, -142.5, -27.6],
                [-59.0, -143.0, -7.0],
                [-58.6, -143.7, 14.3],
                [-51.4, -138.1, 35.1],
            ],
        ),
        (
            [0.6, 0.6, 1.2],
            [
                [-21.0, -119.3, -25.4],
                [-52.3, -78.5, -25.3],
                [-52.2, -79.0, -7.0],
                [-54.3, -80.0, 11.0],
                [-47.1, -83.3, 29.3],
            ],
        ),
    ];
    for ([yaw, pitch, finger], expected) in figures {
        let positions = [("thumb_proximal_yaw", yaw), ("thumb_proximal_pitch", pitch), ("proximal", finger)];
        let poses = hand.forward_kinematics(&configuration(&hand, &positions)).unwrap();
        let tips =
            ["thumb_distal", "index_intermediate", "middle_intermediate", "ring_intermediate", "pinky_intermediate"];
        for (name, expected) in tips.into_iter().zip(expected) {
            let link = hand.links.iter().position(|link| link.name == name).unwrap();
            let point = match name {
                "thumb_distal" => Point3::new(0.02, 0.013, -0.006),
                "pinky_intermediate" => Point3::new(0.0, 0.035, -0.005),
                _ => Point3::new(0.0, 0.043, -0.005),
            };
            let tip = (poses[link] * point).coords * 1e3;
            let error = (tip - Vector3::from(expected)).amax();
            assert!(error < 0.1, "{name}: {tip} is {error} mm from {expected:?}");
        }
    }
}

/// Thumb and fingers oppose each other along hand x in every preshape, with the pads apart as the preshape's width says, and face each other within
/// 25 degrees where the fingers are bent by 0.3 rad.
#[test]
fn the_thumb_of_the_inspire_hand_opposes_the_fingers() {
    let hand = hand("inspire");
    // Middle of the face of a pad, hand frame, and its outward normal: +y of the thumb's link, -x of a finger's.
    let face = |configuration: &[f64], name: &str| {
        let shapes = hand.shapes_at(configuration).unwrap();
        let pad = shapes.iter().find(|shape| shape.collider.name == name).unwrap();
        let Shape::Cuboid(half) = pad.collider.shape else { panic!("pads are boxes") };
        let (out, depth) = if name.starts_with("thumb") { (Vector3::y(), half.y) } else { (-Vector3::x(), half.x) };
        let out = pad.hand_from_shape.rotation * out;
        (pad.hand_from_shape.translation.vector + out * depth, out)
    };
    let openings: [[f64; 2]; 2] = [[0.114, 0.139], [0.094, 0.118]];
    for (preshape, [least, most]) in hand.preshapes().iter().zip(openings) {
        let open = hand.open_configuration(preshape.value);
        for part in ["pad", "tip"] {
            let (thumb, out) = face(&open, &format!("thumb_distal_{part}"));
            for finger in ["index", "middle", "ring", "pinky"] {
                let (at, inward) = face(&open, &format!("{finger}_intermediate_{part}"));
                assert!(out.x > 0.7 && inward.x < -0.55, "{}: {out} {inward}", preshape.name);
                let opening = at.x - thumb.x;
                assert!(
                    (least..most).contains(&opening) && opening > preshape.face.width[1],
                    "{finger} {part}: {opening}"
                );
                assert!((at.z - thumb.z).abs() < 0.04, "{}: {thumb} {at}", preshape.name);
            }
        }
    }
    let bent = configuration(&hand, &[("yaw", 1.3), ("pitch", 0.0), ("proximal", 0.3)]);
    let ((thumb, out), (at, inward)) = (face(&bent, "thumb_distal_pad"), face(&bent, "middle_intermediate_pad"));
    assert!(out.dot(&inward) < -0.9 && (at.z - thumb.z).abs() < 0.012, "{out} {inward}, {thumb} {at}");
}
