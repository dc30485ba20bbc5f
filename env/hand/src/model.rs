//! The description of a hand, as read from a URDF (links, joints, shapes) and a `hand.toml` (the rest).
//!
//! Every finger is one tendon over a proximal and a distal revolute joint, optionally on a swivel that the preshape motor turns.

use nalgebra::{Isometry3, Matrix3, Point3, Unit, UnitQuaternion, Vector3};

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
        /// Radius.
        radius: f64,
        /// Half the length along z.
        half_length: f64,
    },
    /// A ball.
    Sphere {
        /// Radius.
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
    /// Factor of a material.
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
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass in the link's frame, metres.
    pub center_of_mass: Point3<f64>,
    /// Inertia about the centre of mass, axes of the link, kg m2.
    pub inertia: Matrix3<f64>,
    /// Its collision shapes.
    pub colliders: Vec<Collider>,
}

/// A revolute joint, or a fixed one (`limits` equal to `[0, 0]` and `fixed`).
#[derive(Clone, Debug, PartialEq)]
pub struct Joint {
    /// Name in the URDF.
    pub name: String,
    /// Index of the parent link.
    pub parent: usize,
    /// Index of the child link.
    pub child: usize,
    /// The joint's frame at angle 0.
    pub parent_from_joint: Isometry3<f64>,
    /// Axis in the joint's frame.
    pub axis: Unit<Vector3<f64>>,
    /// Least and greatest angle, radians.
    pub limits: [f64; 2],
    /// True where the joint does not move.
    pub fixed: bool,
}

/// A tendon, unilateral and compliant. With the length that the joints take up, `l = r_p q_p + r_d q_d`,
/// and the stretch `e = spool_radius * spool - l`, its tension is
/// `T = clamp(stiffness e + damping de/dt, 0, max_tension)`, and 0 where it is slack (`e <= 0`).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tendon {
    /// Moment arm at the proximal joint, metres.
    pub proximal_arm: f64,
    /// Moment arm at the distal joint, metres.
    pub distal_arm: f64,
    /// Spool radius, metres: tendon length per radian of the spool.
    pub spool_radius: f64,
    /// Stiffness, N/m.
    pub stiffness: f64,
    /// Damping, N s/m.
    pub damping: f64,
    /// Tension at which the motor stops pulling, N.
    pub max_tension: f64,
}

/// The elastic distal joint, and friction losses in both joints.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Flexure {
    /// Stiffness of the distal flexure, N m/rad.
    pub stiffness: f64,
    /// Rest angle of the flexure, radians.
    pub rest: f64,
    /// Stiffness of the spring that opens the proximal joint, N m/rad.
    pub proximal_stiffness: f64,
    /// Rest angle of that spring, radians: below the joint's range, so that an idle finger stays open.
    pub proximal_rest: f64,
    /// Damping of the distal joint, N m s/rad.
    pub distal_damping: f64,
    /// Damping of the proximal joint, N m s/rad.
    pub proximal_damping: f64,
    /// Armature: rotor and transmission inertia reflected to each of the two joints, kg m2.
    pub armature: f64,
    /// Stiffness of the soft joint stops, N m/rad.
    pub stop_stiffness: f64,
}

/// One finger: indices into the hand's joints and links.
#[derive(Clone, Debug, PartialEq)]
pub struct Finger {
    /// Name.
    pub name: String,
    /// Swivel joint that the preshape turns, and its sign.
    pub swivel: Option<(usize, f64)>,
    /// Proximal joint.
    pub proximal: usize,
    /// Distal joint.
    pub distal: usize,
    /// Its tendon.
    pub tendon: Tendon,
    /// Its flexure.
    pub flexure: Flexure,
    /// Index of its motor.
    pub motor: usize,
}

/// What a motor drives.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotorKind {
    /// The tendon of this finger.
    Finger(usize),
    /// The preshape of all swivels.
    Preshape,
}

/// A motor; angles are on the joint's side of the gear.
#[derive(Clone, Debug, PartialEq)]
pub struct Motor {
    /// Name.
    pub name: String,
    /// What it drives.
    pub kind: MotorKind,
    /// Least and greatest position, radians.
    pub travel: [f64; 2],
    /// Speed of a position command, rad/s.
    pub default_speed: f64,
    /// Greatest speed, rad/s.
    pub max_speed: f64,
    /// Gear ratio: motor radians per radian on the joint's side.
    pub ratio: f64,
    /// Load at which the motor stops pulling: tendon tension in N for a finger, torque in N m for the preshape.
    pub load_limit: f64,
    /// Speed of a force command per unit of load error: rad/s per N (per N m for the preshape).
    pub force_gain: f64,
}

/// A pressure sensor on a link's surface.
#[derive(Clone, Debug, PartialEq)]
pub struct TactileSensor {
    /// Finger that it belongs to.
    pub finger: usize,
    /// Link that it sits on.
    pub link: usize,
    /// Position in the link's frame, metres.
    pub position: Point3<f64>,
    /// Outward normal in the link's frame.
    pub normal: Unit<Vector3<f64>>,
}

/// A whole hand. Link 0 is the base.
#[derive(Clone, Debug, PartialEq)]
pub struct Hand {
    /// Name.
    pub name: String,
    /// Links; the base is first, parents before children.
    pub links: Vec<Link>,
    /// Joints, in the order of their child links (joint `i` moves link `i + 1`).
    pub joints: Vec<Joint>,
    /// Fingers.
    pub fingers: Vec<Finger>,
    /// Motors.
    pub motors: Vec<Motor>,
    /// Tactile sensors, finger by finger, from the root to the tip.
    pub sensors: Vec<TactileSensor>,
    /// The grasp frame in the base's frame.
    pub base_from_hand: Isometry3<f64>,
    /// Least and greatest preshape angle, radians.
    pub preshape_limits: [f64; 2],
    /// Friction factors of its surfaces.
    pub friction: Friction,
}
