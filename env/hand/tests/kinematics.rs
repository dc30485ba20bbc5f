//! Properties of forward kinematics, and the axes conventions of the hand frame.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::f64::consts::{FRAC_PI_2, PI};

use graspbox_hand::{GraspPose, Hand, HandConfiguration, HandFrame};
use nalgebra::{Isometry3, Matrix3, Point3, Unit, UnitQuaternion, Vector3};
use proptest::prelude::*;

fn reflex() -> &'static Hand {
    Hand::reflex().unwrap()
}

prop_compose! {
    fn configurations()(
        preshape in 0.0..FRAC_PI_2,
        proximal in prop::collection::vec(0.0..2.83f64, 3),
        distal in prop::collection::vec(0.0..2.74f64, 3),
    ) -> HandConfiguration {
        HandConfiguration { preshape, proximal, distal }
    }
}

prop_compose! {
    fn directions()(x in -1.0..1.0f64, y in -1.0..1.0f64, z in 0.1..1.0f64) -> Unit<Vector3<f64>> {
        Unit::new_normalize(Vector3::new(x, y, z))
    }
}

prop_compose! {
    fn poses()(axis in directions(), angle in -PI..PI, x in -1.0..1.0f64, y in -1.0..1.0f64, z in -1.0..1.0f64)
        -> Isometry3<f64> {
        Isometry3::from_parts(Vector3::new(x, y, z).into(), UnitQuaternion::from_axis_angle(&axis, angle))
    }
}

proptest! {
    /// Every pose is rigid, and a child's joint stays where its parent carries it.
    #[test]
    fn links_are_rigid_and_stay_on_their_joints(configuration in configurations()) {
        let hand = reflex();
        let poses = hand.forward_kinematics(&configuration).unwrap();
        for joint in &hand.joints {
            let [parent, child] = [poses[joint.parent], poses[joint.child]];
            let turn = child.rotation.to_rotation_matrix();
            prop_assert!((turn.matrix() * turn.matrix().transpose() - Matrix3::identity()).norm() < 1e-12);
            prop_assert!((turn.matrix().determinant() - 1.0).abs() < 1e-12);
            let carried = parent * Point3::from(joint.parent_from_joint.translation.vector);
            prop_assert!((carried - Point3::from(child.translation.vector)).norm() < 1e-12);
            let axis = parent.rotation * (joint.parent_from_joint.rotation * joint.axis.into_inner());
            prop_assert!((axis - child.rotation * joint.axis.into_inner()).norm() < 1e-12, "the axis turned");
        }
    }

    /// The preshape is a mirror: with equal angles, finger 2 is finger 1 with y turned over, and finger 3 does not move.
    #[test]
    fn the_preshape_turns_fingers_1_and_2_as_mirror_images(
        theta in 0.0..FRAC_PI_2, p in 0.0..2.83f64, d in 0.0..2.74f64, x in 0.0..0.05f64, z in 0.0..0.02f64,
    ) {
        let hand = reflex();
        let at = |theta| HandConfiguration { preshape: theta, proximal: vec![p; 3], distal: vec![d; 3] };
        let [poses, straight] = [theta, 0.0].map(|t| hand.forward_kinematics(&at(t)).unwrap());
        let tip = |poses: &[Isometry3<f64>], f: usize| poses[hand.joints[hand.fingers[f].distal].child] * Point3::new(x, 0.0, z);
        let [one, two] = [tip(&poses, 0), tip(&poses, 1)];
        prop_assert!((Point3::new(one.x, -one.y, one.z) - two).norm() < 1e-12);
        prop_assert_eq!(tip(&poses, 2), tip(&straight, 2));
    }

    /// Bending one finger moves no other.
    #[test]
    fn fingers_move_alone(configuration in configurations(), f in 0..3usize, p in 0.0..2.0f64) {
        let hand = reflex();
        let mut other = configuration.clone();
        other.proximal[f] = p;
        let [a, b] = [configuration, other].map(|c| hand.forward_kinematics(&c).unwrap());
        for link in (0..hand.links.len()).filter(|&l| hand.finger_of_link(l) != Some(f)) {
            prop_assert_eq!(a[link], b[link]);
        }
    }

    /// Both conventions put z into the object and their own axis along the long side, and name the same palm.
    #[test]
    fn hand_frames_follow_their_conventions(long in directions(), into in directions(), pose in poses()) {
        prop_assume!(long.cross(&into).norm() > 1e-3);
        for frame in [HandFrame::ReFlex, HandFrame::SoftHand] {
            let turn = frame.rotation(&long, &into).unwrap();
            let axis = turn * frame.long_axis().into_inner();
            prop_assert!((turn * Vector3::z() - into.into_inner()).norm() < 1e-9);
            prop_assert!(axis.dot(&into).abs() < 1e-9 && axis.dot(&long) > 0.0);
            prop_assert!(axis.cross(&into).dot(&long).abs() < 1e-9, "in the plane of both");
            let reflex = frame.to_reflex(&Isometry3::from_parts(Vector3::zeros().into(), turn));
            let expected = HandFrame::ReFlex.rotation(&long, &into).unwrap();
            prop_assert!(reflex.rotation.angle_to(&expected) < 1e-7);
            let back = frame.from_reflex(&frame.to_reflex(&pose));
            prop_assert!((back.to_homogeneous() - pose.to_homogeneous()).norm() < 1e-12);
        }
    }

    #[test]
    fn a_grasp_pose_moves_along_its_approach(pose in poses(), preshape in 0.0..1.5f64, distance in -0.2..0.2f64) {
        let grasp = GraspPose { object_from_hand: pose, preshape };
        let moved = grasp.advanced(distance);
        let step = moved.object_from_hand.translation.vector - pose.translation.vector;
        prop_assert!((step - grasp.approach().into_inner() * distance).norm() < 1e-12);
        prop_assert_eq!(moved.object_from_hand.rotation, pose.rotation);
        let turned = grasp.turned(PI);
        prop_assert!((turned.approach().into_inner() - grasp.approach().into_inner()).norm() < 1e-12);
        prop_assert!((turned.object_from_hand * Vector3::x() + pose * Vector3::x()).norm() < 1e-12);
        let base = grasp.object_from_base(reflex()) * reflex().base_from_hand;
        prop_assert!((base.to_homogeneous() - pose.to_homogeneous()).norm() < 1e-12);
    }
}

#[test]
fn a_long_side_along_the_approach_has_no_rotation() {
    let z = Vector3::z_axis();
    assert_eq!(HandFrame::ReFlex.rotation(&z, &z), None);
    assert_eq!(HandFrame::SoftHand.rotation(&-z, &z), None);
}

#[test]
fn a_pinch_preshape_points_finger_1_to_minus_y() {
    let hand = reflex();
    let poses = hand.forward_kinematics(&hand.open_configuration(FRAC_PI_2)).unwrap();
    let heading = |f: usize| poses[hand.joints[hand.fingers[f].distal].child] * Vector3::x();
    for (f, expected) in [(0, -Vector3::y()), (1, Vector3::y()), (2, -Vector3::x())] {
        assert!((heading(f) - expected).norm() < 1e-12, "finger {f} points to {}", heading(f));
    }
}
