//! Inverse kinematics: solutions are within the limits and meet the pose, and nearly every pose with a solution gets one.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_arm::chain::Motion;
use graspbox_arm::inverse::Unsolved;
use graspbox_arm::{Inverse, Solution};
use graspbox_hand::Arm;
use graspbox_hand::arm::assets::{ARMS, arm_asset};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use proptest::prelude::*;
use std::ops::ControlFlow;
use std::sync::OnceLock;

/// The included arms, prepared.
fn arms() -> &'static [(Arm, Inverse)] {
    static ALL: OnceLock<Vec<(Arm, Inverse)>> = OnceLock::new();
    ALL.get_or_init(|| {
        let prepared = ARMS.iter().map(|asset| asset.read().unwrap());
        prepared.map(|arm| (arm.clone(), Inverse::new(&arm))).collect()
    })
}

fn posture(arm: &Arm, shares: &[f64]) -> Vec<f64> {
    let joints = arm.axis_joints().zip(shares);
    joints.map(|(joint, share)| joint.limits[0] + share * (joint.limits[1] - joint.limits[0])).collect()
}

fn flange(arm: &Arm, q: &[f64]) -> Isometry3<f64> {
    arm.forward_kinematics(q).unwrap()[arm.flange]
}

fn solutions(
    inverse: &Inverse,
    pose: &Isometry3<f64>,
    most: usize,
    max_angle: f64,
) -> (Vec<Solution>, Result<(), Unsolved>) {
    let mut found = Vec::new();
    let solved = inverse.solve(pose, 32, max_angle, |solution| {
        found.push(solution);
        if found.len() >= most { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    (found, solved)
}

/// Checks that solutions are within the limits, meet the pose, and differ.
fn check_solutions(arm: &Arm, pose: &Isometry3<f64>, found: &[Solution]) {
    for (index, solution) in found.iter().enumerate() {
        let q = solution.values(arm.axes.len());
        for (x, joint) in q.iter().zip(arm.axis_joints()) {
            assert!((joint.limits[0]..=joint.limits[1]).contains(x), "{}: {q:?}", arm.name);
        }
        let at = flange(arm, q);
        assert!((at.translation.vector - pose.translation.vector).norm() < 2e-6, "{}: {q:?}", arm.name);
        assert!((at.rotation.angle_to(&pose.rotation) - solution.angle).abs() < 1e-6, "{}: {q:?}", arm.name);
        for other in &found[..index] {
            let apart = |a: usize| (q[a] - other.positions[a]).abs();
            assert!((0..q.len()).any(|axis| apart(axis) > 0.09), "{}: one solution twice", arm.name);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn solutions_are_within_the_limits_and_meet_the_pose(
        which in 0..4_usize, shares in prop::collection::vec(0.0..=1.0f64, 7), shift in -0.3..0.3f64,
    ) {
        let (arm, inverse) = &arms()[which];
        let mut pose = flange(arm, &posture(arm, &shares));
        check_solutions(arm, &pose, &solutions(inverse, &pose, 4, 0.0).0);
        // A pose that may have no solution.
        pose.translation.vector += Vector3::new(shift, -shift, shift);
        check_solutions(arm, &pose, &solutions(inverse, &pose, 4, 0.2).0);
    }

    /// A bug here: a pose that the arm is in, called too far.
    #[test]
    fn no_posture_is_too_far(which in 0..4_usize, shares in prop::collection::vec(0.0..=1.0f64, 7)) {
        let (arm, inverse) = &arms()[which];
        let pose = flange(arm, &posture(arm, &shares));
        prop_assert!(inverse.chain().excess(&Motion::new(&pose)) <= 1e-9);
    }

    #[test]
    fn the_jacobian_is_the_derivative_of_the_flange(which in 0..4_usize, shares in prop::collection::vec(0.1..0.9f64, 7)) {
        const STEP: f64 = 1e-6;
        let (arm, inverse) = &arms()[which];
        let q = posture(arm, &shares);
        let frames = inverse.chain().frames(&inverse.positions_of(&q));
        prop_assert!((frames.flange.isometry().translation.vector - flange(arm, &q).translation.vector).norm() < 1e-12);
        for axis in 0..q.len() {
            let mut moved = q.clone();
            moved[axis] += STEP;
            let (before, after) = (flange(arm, &q), flange(arm, &moved));
            let linear = (after.translation.vector - before.translation.vector) / STEP;
            let angular = (after.rotation * before.rotation.inverse()).scaled_axis() / STEP;
            let column = inverse.chain().column(&frames, axis);
            prop_assert!((column.fixed_rows::<3>(0) - linear).norm() < 1e-4);
            prop_assert!((column.fixed_rows::<3>(3) - angular).norm() < 1e-4);
        }
    }
}

/// `examples/measure_inverse.rs` measures 10,000 poses per arm; a few hundred show a broken search.
#[test]
fn nearly_all_poses_with_a_solution_get_one() {
    for (arm, inverse) in arms() {
        let shares = |sample: u32| {
            (0..7)
                .map(|axis| (f64::from(sample) * 0.618_034 + f64::from(sample * axis) * 0.414_214).fract())
                .collect::<Vec<_>>()
        };
        let reached =
            |sample: &u32| solutions(inverse, &flange(arm, &posture(arm, &shares(*sample))), 1, 1e-5).1.is_ok();
        let found = (0..400).filter(reached).count();
        assert!(found >= 399, "{}: {found} of 400", arm.name);
    }
}

#[test]
fn reasons_name_the_distance_and_the_joint() {
    let (_, inverse) = &arms()[0];
    let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    let at = |x: f64, z: f64| Isometry3::from_parts(Translation3::new(x, 0.0, z), down);
    assert_eq!(solutions(inverse, &at(1.3, 0.3), 1, 0.0).1, Err(Unsolved::TooFar));
    assert!(matches!(solutions(inverse, &at(0.05, 0.1), 1, 0.0).1, Err(Unsolved::AtLimit(_) | Unsolved::NotFound)));
    assert!(solutions(inverse, &at(0.5, 0.2), 1, 0.0).1.is_ok());
}

/// Five axes: the position is met exactly whatever the rotation, and the remaining angle is as small as a nearby search can make it.
#[test]
fn five_axes_meet_positions_and_tell_the_remaining_angle() {
    let arm = arm_asset("so101").unwrap().read().unwrap();
    let inverse = Inverse::new(&arm);
    let mut pose = flange(&arm, &[0.3, -0.4, 0.6, 0.9, 0.2]);
    // Turned about the axis that is normal to the arm's plane it is met; out of that plane it is not.
    pose.rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.2) * pose.rotation;
    let (found, _) = solutions(&inverse, &pose, 8, 0.3);
    check_solutions(&arm, &pose, &found);
    let least = found.iter().map(|solution| solution.angle).fold(f64::INFINITY, f64::min);
    assert!(least < 0.2 + 1e-6, "{least}");
    match solutions(&inverse, &pose, 8, 1e-4).1 {
        Ok(()) => assert!(least < 1e-4),
        Err(Unsolved::Turned(angle)) => assert!((angle - least).abs() < 1e-3, "{angle} and {least}"),
        Err(other) => panic!("{other:?}"),
    }
}
