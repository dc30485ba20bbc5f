//! The arm that carries the hand: bodies that move as they are told, push objects, and are pushed by nothing.
//!
//! Their coordinates in the frame of the hand's base are six of the mount (x, y, z, yaw, pitch, roll: the displacement of the arm from where the
//! files of hand and arm have it) and the positions of the axes, from the base on reversed. Until [`World::place_arm`] the arm is parked far away.

use super::World;
use crate::engine::Part;
use nalgebra::{Isometry3, Point3, Vector3};

/// Number of coordinates of the mount.
const MOUNT: usize = 6;
/// An arm may count as far if its links are this far from all objects, metres: neither comes so near in a few steps that they touch.
pub const ARM_IS_FAR: f64 = 0.08;
/// Where an arm without a posture is, metres along x from the hand.
const PARKED: f64 = 100.0;

/// Coordinates of a parked arm with this number of axes.
pub(crate) fn parked(axes: usize) -> Vec<f64> {
    let mut arm = vec![0.0; MOUNT + axes];
    arm[0] = PARKED;
    arm
}

/// A contact point of an object that presses on the arm; world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArmContact {
    /// Body of the arm: 0 is what bears the hand, the last one the base.
    pub body: usize,
    /// Metres.
    pub point: Point3<f64>,
    /// Normal force on the arm, N.
    pub force: Vector3<f64>,
}

impl World {
    /// Number of axes of the arm that carries the hand; 0 without one.
    pub fn arm_axes(&self) -> usize {
        self.state.arm.len().saturating_sub(MOUNT)
    }

    /// Puts the arm into a posture, at rest.
    ///
    /// * `hand_error`: the true hand in the one of forward kinematics, both grasp frames.
    /// * `positions`: of the axes, from the base on, rad or m; of another number than the arm has, nothing changes.
    pub fn place_arm(&mut self, hand_error: &Isometry3<f64>, positions: &[f64]) {
        if positions.is_empty() || positions.len() != self.arm_axes() {
            return;
        }
        let base_from_hand = &self.shared.hand.base_from_hand;
        let mount = base_from_hand * hand_error.inverse() * base_from_hand.inverse();
        let (roll, pitch, yaw) = mount.rotation.euler_angles();
        self.state.arm[..3].copy_from_slice(mount.translation.vector.as_slice());
        self.state.arm[3..MOUNT].copy_from_slice(&[yaw, pitch, roll]);
        self.drive_arm(positions, false);
        self.engine.place_arm(&self.state.arm);
    }

    /// Sets the posture that the arm reaches at the end of the next step; it stays until it is set again.
    ///
    /// * `positions`: as for [`World::place_arm`].
    /// * `is_far`: no object comes near a link in that step, which saves time; see [`ARM_IS_FAR`].
    pub fn drive_arm(&mut self, positions: &[f64], is_far: bool) {
        if positions.len() == self.arm_axes() {
            self.state.arm_is_far = is_far;
            // In the order of the bodies, from the hand on.
            self.state.arm[MOUNT..].iter_mut().zip(positions.iter().rev()).for_each(|(own, position)| *own = *position);
        }
    }

    /// Radius of a sphere about an object's centre of mass that contains it, metres.
    pub fn radius_of(&self, object: usize) -> f64 {
        self.shared.radii[object]
    }

    /// Visits the contact points of objects that press on the arm.
    pub fn each_arm_contact(&self, mut visit: impl FnMut(&ArmContact)) {
        if self.state.arm.is_empty() {
            return;
        }
        let world_from_base = self.state.motion.world_from_base;
        let wanted = |parts: [Part; 2]| parts.into_iter().any(|part| matches!(part, Part::Arm(_)));
        self.engine.contacts(&wanted, &mut |contact| {
            if contact.force <= 0.0 {
                return;
            }
            let (body, sign) = match contact.sides.map(|side| side.part) {
                [Part::Arm(body), _] => (body, -1.0),
                [_, Part::Arm(body)] => (body, 1.0),
                _ => return,
            };
            visit(&ArmContact {
                body,
                point: world_from_base * contact.point,
                force: world_from_base * (sign * contact.force * contact.normal),
            });
        });
    }
}
