//! A hand: links, joints, tendons, actuators, sensors, and how it grasps; and the arm that carries it.
//!
//! | module | purpose |
//! |---|---|
//! | [`model`] | the description, as read from a URDF and a `hand.toml` |
//! | [`grasp`] | how the hand grasps: closing actuators, preshapes, and the faces that these suit |
//! | `opening` | positions of actuators and joints of the open and the closed hand |
//! | [`chains`] | results of the tree of joints: coordinates, chains, drivers |
//! | [`load`] | reads the two files ([`urdf`], `table`) and checks them together (`assemble` and its parts) |
//! | [`error`] | errors in these files, with file and line |
//! | [`assets`] | the hands that come with the project, embedded |
//! | [`kinematics`] | from joint positions to the poses of links and shapes |
//! | [`tendon`] | statics of tendons and springs |
//! | [`actuator`] | position, velocity and force commands |
//! | [`arm`] | what carries a hand: an arm, read from a URDF and an `arm.toml`; its bodies in a chain from the hand |
//! | [`pose`] | the grasp pose: where the hand goes, and its preshape; rigid motions from matrices |
//!
//! The hand frame is the grasp frame: its origin is on the palm's surface, its z axis leaves the palm (`base_from_hand`).
//!
//! ```
//! use graspbox_hand::Hand;
//!
//! let hand = Hand::reflex()?;
//! let mut configuration = hand.open_configuration(0.0);
//! for (position, joint) in configuration.iter_mut().zip(hand.coordinates()) {
//!     if hand.joints[joint].name.starts_with("proximal") {
//!         *position = 1.0;
//!     }
//! }
//! let base_from_link = hand.forward_kinematics(&configuration)?;
//! let tip = hand.links.iter().position(|link| link.name == "distal_1").unwrap_or(0);
//! assert!((base_from_link[tip].translation.z - 0.134).abs() < 1e-3);
//! # Ok::<(), graspbox_hand::HandError>(())
//! ```

pub mod actuator;
pub mod arm;
mod assemble;
pub mod assets;
pub mod chains;
pub mod error;
pub mod grasp;
pub mod kinematics;
pub mod load;
pub mod model;
mod opening;
pub mod pose;
mod table;
pub mod tendon;
pub mod urdf;

pub use actuator::{ActuatorCommand, ActuatorState, Hold};
pub use arm::carrier::{Carrier, CarrierAxis, CarrierBody};
pub use arm::{Arm, Axis, Mount, Slowing};
pub use chains::Chain;
pub use error::{HandError, Problem, ProblemKind, Problems};
pub use grasp::{FaceRule, Grasp, Preshape, PreshapeCoordinate, QuarterTurn};
pub use kinematics::PlacedShape;
pub use load::{UrdfMeshes, read_urdf, read_urdf_anyway, urdf_meshes};
pub use model::{
    Actuator, Collider, Drive, DrivenJoint, Friction, Hand, Joint, JointGroup, JointKind, Link, Material, Mimic,
    NoContact, Shape, ShapeIndex, TactileSensor, Tendon, Transmission,
};
pub use pose::{GraspPose, rigid_motion};
pub use urdf::MeshShape;
pub use urdf::assumption::{Assumption, AssumptionKind};
