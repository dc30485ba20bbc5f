//! Properties of forward kinematics, and the axes conventions of the hand frame.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::f64::consts::{FRAC_PI_2, PI};

use graspbox_hand::{Hand, rigid_motion};
use nalgebra::{Isometry3, Matrix3, Point3, Unit, UnitQuaternion, Vector3};
use proptest::prelude::*;

fn reflex() -> &'static Hand {
    Hand::reflex().unwrap()
}

/// Positions of the independent joints: the swivel of finger 1, then proximal and distal joint of each finger.
fn at(preshape: f64, proximal: &[f64], distal: &[f64]) -> Vec<f64> {
    let mut configuration = vec![preshape];
    configuration.extend(proximal.iter().zip(distal).flat_map(|(p, d)| [*p, *d]));
    configuration
}

/// The last link of a finger.
fn tip_link(finger: usize) -> usize {
    reflex().joints[*reflex().chains()[finger].joints.last().unwrap()].child
}

prop_compose! {
    fn configurations()(
        preshape in 0.0..FRAC_PI_2,
        proximal in prop::collection::vec(0.0..2.83f64, 3),
        distal in prop::collection::vec(0.0..2.74f64, 3),
    ) -> Vec<f64> {
        at(preshape, &proximal, &distal)
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
        let [poses, straight] = [theta, 0.0].map(|t| hand.forward_kinematics(&at(t, &[p; 3], &[d; 3])).unwrap());
        let tip = |poses: &[Isometry3<f64>], f: usize| poses[tip_link(f)] * Point3::new(x, 0.0, z);
        let [one, two] = [tip(&poses, 0), tip(&poses, 1)];
        prop_assert!((Point3::new(one.x, -one.y, one.z) - two).norm() < 1e-12);
        prop_assert_eq!(tip(&poses, 2), tip(&straight, 2));
    }

    /// Bending one finger moves no other.
    #[test]
    fn fingers_move_alone(configuration in configurations(), f in 0..3usize, p in 0.0..2.0f64) {
        let hand = reflex();
        let mut other = configuration.clone();
        // After the swivel's position there are two for each finger.
        other[1 + 2 * f] = p;
        let [a, b] = [configuration, other].map(|c| hand.forward_kinematics(&c).unwrap());
        for link in (0..hand.links.len()).filter(|&l| hand.chain_of_link(l) != Some(f)) {
            prop_assert_eq!(a[link], b[link]);
        }
    }

    /// A matrix that was rounded to float32 is a rigid motion again; anything else is none.
    #[test]
    fn rigid_motions_come_back_from_their_matrices(pose in poses(), bad in 0..16usize) {
        let matrix = pose.to_homogeneous();
        let rows: [f64; 16] = std::array::from_fn(|i| f64::from(matrix[(i / 4, i % 4)] as f32));
        let back = rigid_motion(&rows).unwrap();
        prop_assert!((back.to_homogeneous() - matrix).norm() < 1e-6);
        let turn = back.rotation.to_rotation_matrix();
        prop_assert!((turn.matrix().tr_mul(turn.matrix()) - nalgebra::Matrix3::identity()).amax() < 1e-11);
        let mut broken = rows;
        broken[bad] = f64::NAN;
        prop_assert_eq!(rigid_motion(&broken), None);
        let mirrored: [f64; 16] = std::array::from_fn(|i| if i % 4 == 0 { -rows[i] } else { rows[i] });
        prop_assert_eq!(rigid_motion(&mirrored), None);
    }
}

#[test]
fn a_pinch_preshape_points_finger_1_to_minus_y() {
    let hand = reflex();
    let poses = hand.forward_kinematics(&hand.open_configuration(FRAC_PI_2)).unwrap();
    let heading = |f: usize| poses[tip_link(f)] * Vector3::x();
    for (f, expected) in [(0, -Vector3::y()), (1, Vector3::y()), (2, -Vector3::x())] {
        assert!((heading(f) - expected).norm() < 1e-12, "finger {f} points to {}", heading(f));
    }
}
