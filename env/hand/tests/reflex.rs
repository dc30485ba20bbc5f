//! The embedded ReFlex against the figures of its data sheet.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::f64::consts::FRAC_PI_2;

use graspbox_hand::{Drive, Hand, Joint, Material, Shape, Transmission};
use nalgebra::{Matrix3, Point3, Vector3};

fn reflex() -> &'static Hand {
    Hand::reflex().unwrap()
}

/// Positions of the independent joints: the swivel of finger 1, then proximal and distal joint of each finger.
fn at(preshape: f64, proximal: f64, distal: f64) -> Vec<f64> {
    vec![preshape, proximal, distal, proximal, distal, proximal, distal]
}

/// Joints of the three fingers that bend: proximal, distal.
fn bending() -> Vec<[&'static Joint; 2]> {
    let joint = |name: String| reflex().joints.iter().find(|joint| joint.name == name).unwrap();
    (1..=3).map(|i| ["proximal", "distal"].map(|kind| joint(format!("{kind}_joint_{i}")))).collect()
}

/// Distal joints of the three fingers in the base frame.
fn distal_joints(configuration: &[f64]) -> Vec<Point3<f64>> {
    let poses = reflex().forward_kinematics(configuration).unwrap();
    bending().iter().map(|[_, distal]| Point3::from(poses[distal.child].translation.vector)).collect()
}

#[test]
fn distal_joints_stand_where_the_data_sheet_says() {
    let figures = [
        (at(0.0, 0.0, 0.0), [[0.126, -0.026, 0.077], [0.126, 0.026, 0.077], [-0.096, 0.0, 0.077]]),
        (at(0.0, 1.0, 0.3), [[0.100, -0.026, 0.134], [0.100, 0.026, 0.134], [-0.070, 0.0, 0.134]]),
        (at(FRAC_PI_2, 1.0, 0.0), [[0.050, -0.076, 0.134], [0.050, 0.076, 0.134], [-0.070, 0.0, 0.134]]),
    ];
    for (configuration, expected) in figures {
        for (found, expected) in distal_joints(&configuration).iter().zip(expected) {
            let error = (found - Point3::from(expected)).abs().max();
            // The figures are rounded to 1 mm in each coordinate.
            assert!(error <= 0.5e-3 + 1e-9, "{found} is {error} m from {expected:?}");
        }
    }
}

/// The same in closed form, over the whole range: a planar two-link arm in the plane of each finger.
#[test]
fn kinematics_agree_with_the_closed_form_of_a_planar_finger() {
    for (theta, p, d) in [(0.0, 0.0, 0.0), (0.3, 0.7, 1.1), (FRAC_PI_2, 2.83, 0.2), (1.0, 0.0, 2.74)] {
        let poses = reflex().forward_kinematics(&at(theta, p, d)).unwrap();
        for (i, [_, distal]) in bending().into_iter().enumerate() {
            let (root, heading) = match i {
                0 => (Vector3::new(0.0504, -0.026, 0.0), -theta),
                1 => (Vector3::new(0.0504, 0.026, 0.0), theta),
                _ => (Vector3::new(-0.030, 0.0, 0.0), std::f64::consts::PI),
            };
            // In the finger's plane: forward from the swivel's axis (or the proximal joint) and up from the base.
            let offset = if i < 2 { 0.010 } else { 0.0 };
            let joint = (offset + 0.066 * p.cos() + 0.005 * p.sin(), 0.0816 + 0.066 * p.sin() - 0.005 * p.cos());
            let tip = (joint.0 + 0.04 * (p + d).cos(), joint.1 + 0.04 * (p + d).sin());
            let expected = root + Vector3::new(tip.0 * heading.cos(), tip.0 * heading.sin(), tip.1);
            let found = poses[distal.child] * Point3::new(0.04, 0.0, 0.0);
            assert!((found.coords - expected).norm() < 1e-12, "finger {i}: {found} is not {expected}");
        }
    }
}

#[test]
fn the_hand_frame_lies_on_the_palm_between_the_finger_roots() {
    let hand = reflex();
    assert_eq!(hand.base_from_hand.translation.vector, Vector3::new(0.015, 0.0, 0.09));
    let palm = hand.links[0].colliders.iter().find(|c| c.name == "palm_pad").unwrap();
    let Shape::Cuboid(half) = palm.shape else { panic!("the palm is a cuboid") };
    let top = palm.link_from_shape.translation.z + half.z;
    assert!((top - 0.09).abs() < 1e-12, "the palm's surface is at z = {top}");
    let base = hand.hand_from_links(&hand.open_configuration(0.0)).unwrap()[0];
    assert!((base.translation.vector - Vector3::new(-0.015, 0.0, -0.09)).norm() < 1e-12);
}

#[test]
fn parts_are_counted_as_in_the_data_sheet() {
    let hand = reflex();
    assert_eq!((hand.name.as_str(), hand.chain_count(), hand.actuators.len()), ("reflex", 3, 4));
    let lengths: Vec<_> = hand.chains().iter().map(|chain| chain.joints.len()).collect();
    assert_eq!((lengths, hand.coordinates().count()), (vec![3, 3, 2], 7), "swivel 2 follows swivel 1");
    // 8 of the 9 links move: 2 swivels and 2 links a finger.
    assert_eq!((hand.links.len(), hand.joints.len()), (9, 8));
    for (i, joint) in hand.joints.iter().enumerate() {
        assert_eq!(joint.child, i + 1, "joint i moves link i + 1");
        assert!(joint.parent < joint.child);
    }
    let grams: f64 = hand.links.iter().map(|l| l.mass).sum::<f64>() * 1e3;
    assert!((grams - 800.0).abs() < 1.0, "the hand weighs {grams} g");
    for (f, actuator) in hand.actuators[..3].iter().enumerate() {
        assert!(matches!(actuator.transmission, Transmission::Spool { tendon, .. } if tendon == f));
        let spanned = hand.tendons[f].arms.iter().map(|(joint, _)| hand.chain_of_link(hand.joints[*joint].child));
        assert!(spanned.eq([Some(f); 2]));
    }
    assert_eq!(hand.grasp.closing, [0, 1, 2]);
    let preshape = &hand.actuators[hand.grasp.coordinate.unwrap().actuator];
    assert_eq!(preshape.ratio, 1.5);
    // The actuator travels further than the joints.
    for (swivel, end) in [(0, FRAC_PI_2), (3, -FRAC_PI_2)] {
        assert_eq!(hand.rigid_position(swivel, |_| preshape.travel[1]), Some(end), "{}", hand.joints[swivel].name);
    }
    assert!(matches!(hand.driver(0), Some((3, _, Drive::Rigid))) && hand.driver(1).is_none());
    assert_eq!(hand.rigid_position(1, |_| 0.0), None, "the proximal joint moves under forces");
}

/// Links move their own masses: inertia is that of a uniform box over the link's colliders.
#[test]
fn inertia_of_finger_links_is_that_of_their_boxes() {
    for link in reflex().links.iter().filter(|l| l.name.starts_with("proximal") || l.name.starts_with("distal")) {
        let (mut low, mut high) = (Vector3::repeat(f64::MAX), Vector3::repeat(f64::MIN));
        for c in &link.colliders {
            let Shape::Cuboid(half) = c.shape else { panic!("{} is not a cuboid", c.name) };
            for corner in 0..8 {
                let sign = |axis: usize| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
                let p = c.link_from_shape * Point3::from(half.component_mul(&Vector3::from_fn(|a, _| sign(a))));
                (low, high) = (low.inf(&p.coords), high.sup(&p.coords));
            }
        }
        let s = (high - low).map(|x| x * x);
        let expected = Vector3::new(s.y + s.z, s.x + s.z, s.x + s.y) * (link.mass / 12.0);
        let error = (link.inertia - Matrix3::from_diagonal(&expected)).abs().max() / expected.max();
        assert!(error < 2e-3, "{}: {} is not {expected}", link.name, link.inertia);
        assert!((link.center_of_mass.coords - (low + high) / 2.0).norm() < 0.1e-3, "{}", link.name);
    }
}

#[test]
fn every_sensor_lies_on_rubber_and_looks_outward() {
    let hand = reflex();
    assert_eq!(hand.sensors.len(), 27);
    for (f, [proximal, distal]) in bending().into_iter().enumerate() {
        let own: Vec<_> = hand.sensors.iter().filter(|s| hand.chain_of_link(s.link) == Some(f)).collect();
        assert_eq!(own.len(), 9);
        assert!(own[..5].iter().all(|s| s.link == proximal.child), "root first");
        assert!(own[5..].iter().all(|s| s.link == distal.child), "then the tip");
        assert!(own[..5].is_sorted_by(|a, b| a.position.x < b.position.x));
        assert!(own[5..].is_sorted_by(|a, b| a.position.x < b.position.x));
    }
    for sensor in &hand.sensors {
        let pads = hand.links[sensor.link].colliders.iter().filter(|c| c.material == Material::Pad);
        let on_a_pad = pads.into_iter().any(|c| {
            let Shape::Cuboid(half) = c.shape else { return false };
            let local = c.link_from_shape.inverse() * sensor.position;
            let normal = c.link_from_shape.rotation.inverse() * sensor.normal.into_inner();
            let inside = local.x.abs() <= half.x + 1e-4 && local.y.abs() <= half.y;
            inside && (local.z - half.z).abs() < 0.2e-3 && (normal - Vector3::z()).norm() < 1e-3
        });
        assert!(on_a_pad, "sensor at {} of link {} is on no pad", sensor.position, sensor.link);
    }
}

/// Lying flat, the rubber of the proximal and the distal link is one level, and the palm lies below it.
#[test]
fn the_pads_of_an_open_finger_are_level() {
    let hand = reflex();
    let poses = hand.forward_kinematics(&hand.open_configuration(0.0)).unwrap();
    for f in 0..3 {
        let own: Vec<_> = hand.sensors.iter().filter(|s| hand.chain_of_link(s.link) == Some(f)).collect();
        let flat: Vec<f64> = own[..8].iter().map(|s| (poses[s.link] * s.position).z).collect();
        assert!(flat.iter().all(|z| (z - 0.097).abs() < 1e-4), "levels {flat:?}");
    }
}

#[test]
fn shapes_stand_in_the_hand_frame() {
    let hand = reflex();
    let shapes = hand.shapes_at(&hand.open_configuration(0.0)).unwrap();
    assert_eq!(shapes.len(), hand.links.iter().map(|l| l.colliders.len()).sum::<usize>());
    let palm = shapes.iter().find(|s| s.collider.name == "palm_pad").unwrap();
    assert!((palm.hand_from_shape.translation.vector - Vector3::new(0.0, 0.0, -0.0025)).norm() < 1e-12);
    let bare = shapes.iter().filter(|s| s.collider.material == Material::Bare).count();
    assert_eq!((bare, shapes.len() - bare), (7, 10));
}

#[test]
fn a_configuration_that_does_not_fit_is_refused() {
    let hand = reflex();
    let message = hand.forward_kinematics(&hand.open_configuration(0.0)[1..]).unwrap_err().to_string();
    assert_eq!(
        message,
        "the configuration has 6 positions, but the hand has 7 independent joints; give one position each"
    );
    let message = hand.forward_kinematics(&hand.open_configuration(f64::NAN)).unwrap_err().to_string();
    assert_eq!(message, "the joint position is NaN; give a finite number");
}

/// Preshapes are one number for the planner and the environments.
#[test]
fn the_preshapes_are_positions_of_one_actuator() {
    let hand = reflex();
    assert_eq!((hand.preshape_limits(), hand.preshape_unit()), ([0.0, FRAC_PI_2], "rad"));
    let names: Vec<_> = hand.preshapes().iter().map(|named| (named.name.as_str(), named.value)).collect();
    assert_eq!(names, [("power", 0.0), ("tripod", std::f64::consts::FRAC_PI_3), ("pinch", FRAC_PI_2)]);
    assert_eq!(hand.open_positions(0.7), [0.0, 0.0, 0.0, 0.7]);
    assert_eq!(hand.closed_positions(0.7), [3.6, 3.6, 3.6, 0.7]);
    assert_eq!(hand.open_configuration(0.7), [0.7, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert_eq!(hand.nearest_preshape(0.9).unwrap().name, "tripod");
    let touch: Vec<_> = hand.touch_links().into_iter().map(|link| hand.links[link].name.as_str()).collect();
    assert_eq!(touch, ["proximal_1", "distal_1", "proximal_2", "distal_2", "proximal_3", "distal_3"]);
    let palm: Vec<_> = (0..hand.links.len()).filter(|link| hand.meets_palm(*link)).collect();
    assert!(palm.iter().all(|link| hand.links[*link].name.starts_with("distal")) && palm.len() == 3, "{palm:?}");
}
