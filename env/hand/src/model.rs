//! The description of a hand in the words of URDF and MuJoCo, as read from a URDF (links, joints, shapes) and a `hand.toml` (the rest).
//!
//! The independent joints (those that move and follow no other) are the coordinates of the hand. Springs and losses act on them, tendons
//! pull them, actuators wind tendons or drive joints. How the hand is used to grasp is in [`crate::grasp`].

use crate::arm::carrier::Carrier;
use crate::grasp::Grasp;
use crate::urdf::assumption::Assumption;
use nalgebra::{Isometry3, Matrix3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use std::sync::Arc;

/// Material of a surface of the hand; it determines the friction factor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Material {
    /// Rubber of the finger and palm pads.
    Pad,
    /// Bare plastic of links and base.
    Bare,
}

/// A collision primitive; all lengths in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// A box by its half extents.
    Cuboid(Vector3<f64>),
    /// A cylinder about its z axis.
    Cylinder {
        /// Radius, metres.
        radius: f64,
        /// Half the length along z.
        half_length: f64,
    },
    /// A ball.
    Sphere {
        /// Radius, metres.
        radius: f64,
    },
}

impl Shape {
    /// Half extents of the bounding box of the shape, rotated by `rotation`, along the axes of the outer frame, metres. A cylinder
    /// is replaced by its bounding box.
    #[must_use]
    pub fn half_extents(&self, rotation: &UnitQuaternion<f64>) -> Vector3<f64> {
        let half = match *self {
            Self::Cuboid(half) => half,
            Self::Cylinder { radius, half_length } => Vector3::new(radius, radius, half_length),
            Self::Sphere { radius } => return Vector3::repeat(radius),
        };
        rotation.to_rotation_matrix().matrix().abs() * half
    }
}

/// Friction factors of the hand's surfaces: the coefficient of Coulomb friction of a pair is the product of its two factors.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Friction {
    /// Factor of [`Material::Pad`].
    pub pad: f64,
    /// Factor of [`Material::Bare`].
    pub bare: f64,
}

impl Friction {
    #[must_use]
    pub fn of(&self, material: Material) -> f64 {
        match material {
            Material::Pad => self.pad,
            Material::Bare => self.bare,
        }
    }
}

/// One collision shape of a link.
#[derive(Clone, Debug, PartialEq)]
pub struct Collider {
    /// Name, unique in the hand.
    pub name: String,
    /// The primitive.
    pub shape: Shape,
    /// Its pose in the frame of the link.
    pub link_from_shape: Isometry3<f64>,
    /// Its surface.
    pub material: Material,
}

/// A rigid part of the hand.
#[derive(Clone, Debug, PartialEq)]
pub struct Link {
    /// Name in the URDF.
    pub name: String,
    /// Mass, kg; 0 for a frame that is fixed to others, which have mass.
    pub mass: f64,
    /// Centre of mass in the link's frame, metres.
    pub center_of_mass: Point3<f64>,
    /// Inertia about the centre of mass, axes of the link, kg m2.
    pub inertia: Matrix3<f64>,
    /// Its collision shapes.
    pub colliders: Vec<Collider>,
}

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Not at all.
    Fixed,
    /// About its axis; positions are radians.
    Revolute,
    /// Along its axis; positions are metres.
    Prismatic,
}

impl JointKind {
    /// Unit of a position: `rad` or `m`.
    #[must_use]
    pub fn unit(self) -> &'static str {
        match self {
            Self::Fixed | Self::Revolute => "rad",
            Self::Prismatic => "m",
        }
    }

    /// Unit of the force along a coordinate: `N m` or `N`.
    #[must_use]
    pub fn force_unit(self) -> &'static str {
        match self {
            Self::Fixed | Self::Revolute => "N m",
            Self::Prismatic => "N",
        }
    }
}

/// A joint that follows another one: its position is `ratio * position of joint + offset` (`<mimic>` in URDF).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mimic {
    /// Index of the joint that it follows, which is an independent one of the same kind.
    pub joint: usize,
    /// Its position per position of that joint.
    pub ratio: f64,
    /// Its position where that joint is at 0, rad or m.
    pub offset: f64,
}

/// A joint. Positions are rad or m, forces along it N m or N, by its kind.
///
/// An independent joint that no actuator drives rigidly bears the force
/// `-stiffness (position - spring_reference) - damping speed`, and outside its limits `stop_stiffness` times the way back to them.
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Name in the URDF.
    pub name: String,
    pub kind: JointKind,
    /// Index of the parent link.
    pub parent: usize,
    /// Index of the child link.
    pub child: usize,
    /// The joint's frame at position 0.
    pub parent_from_joint: Isometry3<f64>,
    /// Axis in the joint's frame.
    pub axis: Unit<Vector3<f64>>,
    /// Least and greatest position; `[0, 0]` for a fixed joint.
    pub limits: [f64; 2],
    /// Greatest force along it, N m or N, as the URDF states it; 0 where it states none. For guesses only.
    pub effort: f64,
    /// Greatest speed, rad/s or m/s, as the URDF states it; 0 where it states none. For guesses only.
    pub velocity: f64,
    /// The joint that it follows, if it is not independent.
    pub mimic: Option<Mimic>,
    /// Stiffness of its spring, N m/rad or N/m.
    pub stiffness: f64,
    /// Position at which that spring is at rest; it may be outside of the limits.
    pub spring_reference: f64,
    /// Damping, N m s/rad or N s/m.
    pub damping: f64,
    /// Armature: inertia of rotor and transmission, reflected to the joint, kg m2 or kg.
    pub armature: f64,
    /// Stiffness of the soft stops at its limits, N m/rad or N/m.
    pub stop_stiffness: f64,
}

impl Joint {
    /// True if the joint does not move.
    #[must_use]
    pub fn is_fixed(&self) -> bool {
        self.kind == JointKind::Fixed
    }

    /// True for a joint that moves and follows no other: a coordinate of the hand.
    #[must_use]
    pub fn is_independent(&self) -> bool {
        !self.is_fixed() && self.mimic.is_none()
    }

    /// The nearest position within the limits; NaN stays NaN.
    #[must_use]
    pub fn within_limits(&self, position: f64) -> f64 {
        within(position, self.limits)
    }

    /// The motion of the child's frame at a position.
    #[must_use]
    pub fn motion(&self, position: f64) -> Isometry3<f64> {
        match self.kind {
            JointKind::Fixed => Isometry3::identity(),
            JointKind::Revolute => {
                Isometry3::from_parts(Translation3::identity(), UnitQuaternion::from_axis_angle(&self.axis, position))
            }
            JointKind::Prismatic => Isometry3::from(Translation3::from(self.axis.into_inner() * position)),
        }
    }
}

/// The number of an interval nearest to `value`; NaN stays NaN.
pub(crate) fn within(value: f64, [lower, upper]: [f64; 2]) -> f64 {
    if value.is_nan() { value } else { value.max(lower).min(upper) }
}

/// Joints with the same numbers, by their name in `hand.toml`.
#[derive(Clone, Debug, PartialEq)]
pub struct JointGroup {
    pub name: String,
    /// Independent joints of one kind, in the order of the file.
    pub joints: Vec<usize>,
    /// True if each has an encoder.
    pub encoder: bool,
}

/// A tendon, unilateral and compliant. The joints take up the length `l = sum of arm * position`; with the length `w` that a spool has
/// wound, its stretch is `e = w - l`, and its tension `T = clamp(stiffness e + damping de/dt, 0, max_tension)`, and 0 where it is slack
/// (`e <= 0`). It pulls joint `i` with `arm_i T`.
#[derive(Clone, Debug, PartialEq)]
pub struct Tendon {
    pub name: String,
    /// Joints that it spans, in the order of the joints, each with its moment arm: metres per radian, or metres per metre.
    pub arms: Vec<(usize, f64)>,
    /// Stiffness, N/m.
    pub stiffness: f64,
    /// Damping, N s/m.
    pub damping: f64,
    /// Tension at which the actuator stops pulling, N.
    pub max_tension: f64,
}

/// A joint that an actuator drives: it is led to `ratio * position of the actuator + offset`, within its limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DrivenJoint {
    /// Index of the joint, which is independent.
    pub joint: usize,
    /// Its position per position of the actuator.
    pub ratio: f64,
    /// Its position where the actuator is at 0, rad or m.
    pub offset: f64,
}

/// How an actuator leads joints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Drive {
    /// By a self-locking gear: the joints follow the actuator under any load.
    Rigid,
    /// By a spring and a damper whose force is limited to the actuator's `load_limit` in both directions.
    Servo {
        /// N m/rad or N/m.
        stiffness: f64,
        /// N m s/rad or N s/m.
        damping: f64,
    },
}

/// Joints or tendon that an actuator moves.
#[derive(Clone, Debug, PartialEq)]
pub enum Transmission {
    /// A spool that winds a tendon; positions are radians of the spool.
    Spool {
        tendon: usize,
        /// Radius, metres: length wound per radian.
        radius: f64,
    },
    /// Joints of one kind; positions are theirs at a ratio of 1, rad or m.
    Joints {
        /// The joints; at least one.
        joints: Vec<DrivenJoint>,
        /// How they are led.
        drive: Drive,
    },
}

/// An actuator. Its position is on the joint's side of the gear, and grows where the hand closes.
#[derive(Clone, Debug, PartialEq)]
pub struct Actuator {
    pub name: String,
    /// Its joints or tendon.
    pub transmission: Transmission,
    /// Least and greatest position, rad or m; an open hand is at the least.
    pub travel: [f64; 2],
    /// Speed of a position command, rad/s or m/s.
    pub default_speed: f64,
    /// Greatest speed, rad/s or m/s.
    pub max_speed: f64,
    /// Gear ratio: radians of the motor per rad or m on the joint's side.
    pub ratio: f64,
    /// Load at which it stops closing: tension of its tendon in N, or force on its joints in N m or N.
    pub load_limit: f64,
    /// Speed of a force command per unit of load error.
    pub force_gain: f64,
}

/// A pressure sensor on a link's surface.
#[derive(Clone, Debug, PartialEq)]
pub struct TactileSensor {
    /// Link that it sits on.
    pub link: usize,
    /// Position in the link's frame, metres.
    pub position: Point3<f64>,
    /// Outward normal in the link's frame.
    pub normal: Unit<Vector3<f64>>,
}

/// A collision shape of the hand: its link, and its index within the link.
pub type ShapeIndex = (usize, usize);

/// Shapes that pass through each other although [`Hand::meeting_bodies`] has their links.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct NoContact {
    /// Pairs of shapes, sorted; in each pair the lesser index is first.
    pub shapes: Vec<[ShapeIndex; 2]>,
    /// Pairs of rigid bodies, by their first links, that overlap in the open hand; `shapes` has all pairs of their shapes.
    pub overlapping: Vec<[usize; 2]>,
}

/// A whole hand. Link 0 is the base.
#[derive(Clone, Debug, PartialEq)]
pub struct Hand {
    pub name: String,
    /// Links; the base is first, parents before children.
    pub links: Vec<Link>,
    /// Joints, in the order of their child links (joint `i` moves link `i + 1`).
    pub joints: Vec<Joint>,
    /// Groups of independent joints, by name.
    pub groups: Vec<JointGroup>,
    /// Tendons, by name.
    pub tendons: Vec<Tendon>,
    /// Actuators, in the order of the file.
    pub actuators: Vec<Actuator>,
    /// Tactile sensors, in the order of their links: chain by chain, from the root to the tip.
    pub sensors: Vec<TactileSensor>,
    /// The grasp frame in the base's frame.
    pub base_from_hand: Isometry3<f64>,
    pub grasp: Grasp,
    /// Friction factors of its surfaces.
    pub friction: Friction,
    /// What its URDF does not say and was assumed.
    pub assumptions: Vec<Assumption>,
    pub no_contact: NoContact,
    /// The frame that lies on the flange of an arm, in the base's frame; `None` for the base's own.
    pub mount: Option<Isometry3<f64>>,
    /// The arm that carries it; `None` for a hand alone.
    pub carrier: Option<Arc<Carrier>>,
}

impl Hand {
    /// Every name and number of the hand that a simulation depends on, as text, the same wherever its files are.
    pub fn content(&self) -> String {
        // Without the mount, and the arm of a hand alone, as before hands had them: what was stored stays valid.
        format!("{:?}", Self { assumptions: Vec::new(), mount: None, ..self.clone() })
            .replacen(", mount: None", "", 1)
            .replacen(", carrier: None", "", 1)
    }

    /// The frame that lies on the flange of an arm, z out of the flange, in the base's frame.
    #[must_use]
    pub fn base_from_mount(&self) -> Isometry3<f64> {
        self.mount.unwrap_or_else(Isometry3::identity)
    }
}
