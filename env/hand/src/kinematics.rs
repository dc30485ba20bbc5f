//! Forward kinematics: from joint angles to the poses of links and shapes.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::error::HandError;
use crate::model::{Collider, Hand};

/// Angles of a hand: one preshape angle, and a proximal and a distal angle per finger. Radians; 0 is flat and open.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HandConfiguration {
    /// Preshape angle: 0 for power, pi/2 for pinch.
    pub preshape: f64,
    /// Proximal angle of each finger.
    pub proximal: Vec<f64>,
    /// Distal angle of each finger, relative to its proximal link.
    pub distal: Vec<f64>,
}

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

impl Hand {
    /// The open hand: all fingers flat, at their least travel.
    #[must_use]
    pub fn open_configuration(&self, preshape: f64) -> HandConfiguration {
        let zeros = vec![0.0; self.fingers.len()];
        HandConfiguration { preshape, proximal: zeros.clone(), distal: zeros }
    }

    /// Angle of every joint, in the order of `joints`; 0 for fixed ones. Limits are not enforced.
    ///
    /// # Errors
    /// [`HandError::FingerCount`] unless there is one angle per finger; [`HandError::NotFinite`] for NaN and infinities.
    pub fn joint_angles(&self, configuration: &HandConfiguration) -> Result<Vec<f64>, HandError> {
        let HandConfiguration { preshape, proximal, distal } = configuration;
        let expected = self.fingers.len();
        for (joint, angles) in [("proximal angle", proximal), ("distal angle", distal)] {
            if angles.len() != expected {
                return Err(HandError::FingerCount { joint, found: angles.len(), expected });
            }
            if let Some(&value) = angles.iter().find(|a| !a.is_finite()) {
                return Err(HandError::NotFinite { what: joint, value });
            }
        }
        if !preshape.is_finite() {
            return Err(HandError::NotFinite { what: "preshape angle", value: *preshape });
        }
        let mut angles = vec![0.0; self.joints.len()];
        for (finger, (&p, &d)) in self.fingers.iter().zip(proximal.iter().zip(distal)) {
            if let Some((joint, sign)) = finger.swivel {
                angles[joint] = sign * preshape;
            }
            angles[finger.proximal] = p;
            angles[finger.distal] = d;
        }
        Ok(angles)
    }

    /// Pose of every link in the base frame (`base_from_link`), in the order of `links`.
    ///
    /// # Errors
    /// As [`Hand::joint_angles`].
    pub fn forward_kinematics(&self, configuration: &HandConfiguration) -> Result<Vec<Isometry3<f64>>, HandError> {
        let angles = self.joint_angles(configuration)?;
        let mut poses = vec![Isometry3::identity(); self.links.len()];
        for (joint, angle) in self.joints.iter().zip(angles) {
            let turn = UnitQuaternion::from_axis_angle(&joint.axis, angle);
            poses[joint.child] = poses[joint.parent] * joint.parent_from_joint * turn;
        }
        Ok(poses)
    }

    /// Pose of every link in the hand (grasp) frame (`hand_from_link`), in the order of `links`.
    ///
    /// # Errors
    /// As [`Hand::joint_angles`].
    pub fn hand_from_links(&self, configuration: &HandConfiguration) -> Result<Vec<Isometry3<f64>>, HandError> {
        let hand_from_base = self.base_from_hand.inverse();
        let poses = self.forward_kinematics(configuration)?;
        Ok(poses.into_iter().map(|base_from_link| hand_from_base * base_from_link).collect())
    }

    /// Every collision shape with its pose, link by link.
    ///
    /// # Errors
    /// As [`Hand::joint_angles`].
    pub fn shapes_at(&self, configuration: &HandConfiguration) -> Result<Vec<PlacedShape<'_>>, HandError> {
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
    /// As [`Hand::joint_angles`].
    pub fn open_span(&self) -> Result<f64, HandError> {
        let (mut least, mut most) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        for placed in self.shapes_at(&self.open_configuration(self.preshape_limits[0]))? {
            let half = placed.collider.shape.half_extents(&placed.hand_from_shape.rotation);
            let center = placed.hand_from_shape.translation.vector;
            least = least.inf(&(center - half));
            most = most.sup(&(center + half));
        }
        Ok((most - least).xy().max())
    }

    /// Index of the finger that moves a link; `None` for the base and what is fixed to it.
    #[must_use]
    pub fn finger_of_link(&self, link: usize) -> Option<usize> {
        let joint = link.checked_sub(1)?;
        let roots = self.fingers.iter().map(|f| f.swivel.map_or(f.proximal, |s| s.0));
        roots.into_iter().position(|root| self.is_below(joint, root))
    }

    /// True where joint `below` is joint `above` or a descendant of it.
    pub(crate) fn is_below(&self, below: usize, above: usize) -> bool {
        let mut joint = below;
        loop {
            if joint == above {
                return true;
            }
            match self.joints[joint].parent.checked_sub(1) {
                Some(parent) => joint = parent,
                None => return false,
            }
        }
    }

    /// Index of the preshape motor, if there is one.
    #[must_use]
    pub fn preshape_motor(&self) -> Option<usize> {
        self.motors.iter().position(|m| m.kind == crate::model::MotorKind::Preshape)
    }
}
