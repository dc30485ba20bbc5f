//! The grasp pose: where the hand goes, and its preshape. And the two conventions for the axes of the hand frame.
//!
//! In both, hand z is the approach: out of the palm, into the object. They differ in the axis that lies along an object's
//! long side, across which the fingers close:
//!
//! | frame | along the long side | completes it |
//! |---|---|---|
//! | [`HandFrame::ReFlex`] | y | x, from finger 3 towards fingers 1 and 2 |
//! | [`HandFrame::SoftHand`] | x | y, against the ReFlex's x |
//!
//! Everything in the project is in the ReFlex frame; the SoftHand's is for planning as its first planner did.

use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

use crate::model::Hand;

/// A hand pose to grasp from, with the preshape of its fingers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GraspPose {
    /// Hand (grasp) frame in the object's frame.
    pub object_from_hand: Isometry3<f64>,
    /// Angle of the preshape joint, radians: 0 for power, pi/2 for pinch.
    pub preshape: f64,
}

impl GraspPose {
    /// The hand frame in the world.
    #[must_use]
    pub fn world_from_hand(&self, world_from_object: &Isometry3<f64>) -> Isometry3<f64> {
        world_from_object * self.object_from_hand
    }

    /// The hand's base frame in the object's frame.
    #[must_use]
    pub fn object_from_base(&self, hand: &Hand) -> Isometry3<f64> {
        self.object_from_hand * hand.base_from_hand.inverse()
    }

    /// Direction of approach in the object's frame: hand z.
    #[must_use]
    pub fn approach(&self) -> Unit<Vector3<f64>> {
        self.object_from_hand.rotation * Vector3::z_axis()
    }

    /// The same pose moved along the approach.
    ///
    /// * `distance`: metres; negative steps back from the object.
    #[must_use]
    pub fn advanced(&self, distance: f64) -> Self {
        let step = Translation3::new(0.0, 0.0, distance);
        Self { object_from_hand: self.object_from_hand * step, ..*self }
    }

    /// The same pose turned about the approach; by pi, finger 3 takes the other side.
    ///
    /// * `angle`: radians, right-handed about hand z.
    #[must_use]
    pub fn turned(&self, angle: f64) -> Self {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
        Self { object_from_hand: self.object_from_hand * turn, ..*self }
    }
}

/// Which hand axis lies along an object's long side.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum HandFrame {
    /// Hand y along the long side.
    #[default]
    ReFlex,
    /// Hand x along the long side (legacy).
    SoftHand,
}

impl HandFrame {
    /// The hand axis that lies along the long side.
    #[must_use]
    pub fn long_axis(self) -> Unit<Vector3<f64>> {
        match self {
            Self::ReFlex => Vector3::y_axis(),
            Self::SoftHand => Vector3::x_axis(),
        }
    }

    /// Rotation `object_from_hand` of a hand of this frame.
    ///
    /// * `long`: direction of the long side, object frame.
    /// * `into`: direction of approach, object frame; hand z. What `long` has along it is taken off.
    ///
    /// `None` where the two are parallel within 1e-6 rad.
    #[must_use]
    pub fn rotation(self, long: &Unit<Vector3<f64>>, into: &Unit<Vector3<f64>>) -> Option<UnitQuaternion<f64>> {
        let z = into.into_inner();
        let long = Unit::try_new(long.into_inner() - z * long.dot(&z), 1e-6)?.into_inner();
        let columns = match self {
            Self::ReFlex => [long.cross(&z), long, z],
            Self::SoftHand => [long, z.cross(&long), z],
        };
        let matrix = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&columns));
        Some(UnitQuaternion::from_rotation_matrix(&matrix))
    }

    /// Rotation from a hand of this frame to the ReFlex frame: the SoftHand's is turned by +pi/2 about z,
    /// so that its x is the ReFlex's y.
    #[must_use]
    pub fn reflex_from_frame(self) -> UnitQuaternion<f64> {
        let angle = match self {
            Self::ReFlex => 0.0,
            Self::SoftHand => std::f64::consts::FRAC_PI_2,
        };
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle)
    }

    /// A pose of the ReFlex frame from one of this frame: the same palm, the same directions in space.
    #[must_use]
    pub fn to_reflex(self, object_from_frame: &Isometry3<f64>) -> Isometry3<f64> {
        object_from_frame * self.reflex_from_frame().inverse()
    }

    /// A pose of this frame from one of the ReFlex frame; undoes [`HandFrame::to_reflex`].
    #[must_use]
    pub fn from_reflex(self, object_from_reflex: &Isometry3<f64>) -> Isometry3<f64> {
        object_from_reflex * self.reflex_from_frame()
    }
}
