//! Forward kinematics: from joint positions to the poses of links and shapes.

use nalgebra::{Isometry3, Vector3};

use crate::error::HandError;
use crate::model::{Collider, Hand, Joint};

/// A collision shape with its pose.
#[derive(Clone, Copy, Debug)]
pub struct PlacedShape<'a> {
    /// Pose of the shape in the hand (grasp) frame.
    pub hand_from_shape: Isometry3<f64>,
    /// The shape and its surface.
    pub collider: &'a Collider,
    /// Index of the link that it belongs to.
    pub link: usize,
}

/// Pose of every link in the frame of the first one; `positions` has one per joint.
pub(crate) fn link_poses(links: usize, joints: &[Joint], positions: &[f64]) -> Vec<Isometry3<f64>> {
    let mut poses = vec![Isometry3::identity(); links];
    for (joint, &position) in joints.iter().zip(positions) {
        poses[joint.child] = poses[joint.parent] * joint.parent_from_joint * joint.motion(position);
    }
    poses
}

impl Hand {
    /// Position of every joint, in the order of `joints`; 0 for fixed ones. Limits are not enforced.
    ///
    /// * `configuration`: positions of the independent joints, in the order of [`Hand::coordinates`], rad or m.
    ///
    /// # Errors
    /// [`HandError::CoordinateCount`] unless there is one position per independent joint; [`HandError::NotFinite`] for NaN and infinities.
    pub fn joint_positions(&self, configuration: &[f64]) -> Result<Vec<f64>, HandError> {
        let (found, expected) = (configuration.len(), self.coordinates().count());
        if found != expected {
            return Err(HandError::CoordinateCount { found, expected });
        }
        if let Some(&value) = configuration.iter().find(|position| !position.is_finite()) {
            return Err(HandError::NotFinite { what: "joint position", value });
        }
        let mut positions = vec![0.0; self.joints.len()];
        for (joint, &position) in self.coordinates().zip(configuration) {
            positions[joint] = position;
        }
        for (index, joint) in self.joints.iter().enumerate() {
            if let Some(mimic) = joint.mimic {
                positions[index] = mimic.ratio * positions[mimic.joint] + mimic.offset;
            }
        }
        Ok(positions)
    }

    /// Pose of every link in the base frame (`base_from_link`), in the order of `links`.
    ///
    /// # Errors
    /// As [`Hand::joint_positions`].
    pub fn forward_kinematics(&self, configuration: &[f64]) -> Result<Vec<Isometry3<f64>>, HandError> {
        let positions = self.joint_positions(configuration)?;
        Ok(link_poses(self.links.len(), &self.joints, &positions))
    }

    /// Pose of every link in the hand (grasp) frame (`hand_from_link`), in the order of `links`.
    ///
    /// # Errors
    /// As [`Hand::joint_positions`].
    pub fn hand_from_links(&self, configuration: &[f64]) -> Result<Vec<Isometry3<f64>>, HandError> {
        let hand_from_base = self.base_from_hand.inverse();
        let poses = self.forward_kinematics(configuration)?;
        Ok(poses.into_iter().map(|base_from_link| hand_from_base * base_from_link).collect())
    }

    /// Every collision shape with its pose, link by link.
    ///
    /// # Errors
    /// As [`Hand::joint_positions`].
    pub fn shapes_at(&self, configuration: &[f64]) -> Result<Vec<PlacedShape<'_>>, HandError> {
        let poses = self.hand_from_links(configuration)?;
        let mut shapes = Vec::new();
        for (link, (l, hand_from_link)) in self.links.iter().zip(poses).enumerate() {
            shapes.extend(l.colliders.iter().map(|collider| PlacedShape {
                hand_from_shape: hand_from_link * collider.link_from_shape,
                collider,
                link,
            }));
        }
        Ok(shapes)
    }

    /// Width of the open hand across its palm, metres: the larger side of the bounds of its shapes in the palm's plane.
    ///
    /// # Errors
    /// As [`Hand::joint_positions`].
    pub fn open_span(&self) -> Result<f64, HandError> {
        let (mut least, mut most) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        for placed in self.shapes_at(&self.open_configuration(self.preshape_limits()[0]))? {
            let half = placed.collider.shape.half_extents(&placed.hand_from_shape.rotation);
            let center = placed.hand_from_shape.translation.vector;
            least = least.inf(&(center - half));
            most = most.sup(&(center + half));
        }
        Ok((most - least).xy().max())
    }
}
