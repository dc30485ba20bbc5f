//! The embedded ReFlex against the figures of its data sheet.
#![allow(clippy::unwrap_used)]

use graspbox_hand::{Hand, HandConfiguration};
use nalgebra::Point3;

fn at(preshape: f64, proximal: f64, distal: f64) -> HandConfiguration {
    HandConfiguration {
        preshape,
        proximal: vec![proximal; 3],
        distal: vec![distal; 3],
    }
}

/// Distal joints of the three fingers in the base frame.
fn distal_joints(configuration: &HandConfiguration) -> Vec<Point3<f64>> {
    let hand = Hand::reflex().unwrap();
    let poses = hand.forward_kinematics(configuration).unwrap();
    let child = |f: &graspbox_hand::Finger| hand.joints[f.distal].child;
    hand.fingers
        .iter()
        .map(|f| Point3::from(poses[child(f)].translation.vector))
        .collect()
}

#[test]
fn distal_joints_stand_where_the_data_sheet_says() {
    let figures = [
        (
            at(0.0, 0.0, 0.0),
            [[0.126, -0.026, 0.077], [0.126, 0.026, 0.077], [-0.096, 0.0, 0.077]],
        ),
        (
            at(0.0, 1.0, 0.3),
            [[0.100, -0.026, 0.134], [0.100, 0.026, 0.134], [-0.070, 0.0, 0.134]],
        ),
        (
            at(std::f64::consts::FRAC_PI_2, 1.0, 0.0),
            [[0.050, -0.076, 0.134], [0.050, 0.076, 0.134], [-0.070, 0.0, 0.134]],
        ),
    ];
    for (configuration, expected) in figures {
        for (found, expected) in distal_joints(&configuration).iter().zip(expected) {
            let error = (found - Point3::from(expected)).norm();
            // The figures are rounded to 1 mm in each coordinate.
            assert!(error < 0.9e-3, "{found} is {error} m from {expected:?}");
        }
    }
}
