//! A hand: links, joints, tendons, motors, sensors, and its grasp pose.
//!
//! | module | what it does |
//! |---|---|
//! | [`model`] | the description, as read from a URDF and a `hand.toml` |
//! | [`load`] | reads the two files (`scan` and `urdf`, `table`) and checks them together (`assemble`) |
//! | [`error`] | errors in these files, with file and line |
//! | [`reflex`] | the ReFlex hand, embedded |
//! | [`kinematics`] | from joint angles to the poses of links and shapes |
//! | [`tendon`] | tendon statics: tension and joint torques |
//! | [`motor`] | position, velocity and force commands |
//! | [`pose`] | the grasp pose: where the hand goes, and its preshape; rigid motions from matrices |
//!
//! The hand frame is the grasp frame: the base's axes, its origin on the palm's surface (`base_from_hand`).
//!
//! ```
//! use graspbox_hand::Hand;
//!
//! let hand = Hand::reflex()?;
//! let mut configuration = hand.open_configuration(0.0);
//! configuration.proximal = vec![1.0; 3];
//! let base_from_link = hand.forward_kinematics(&configuration)?;
//! let tip = hand.joints[hand.fingers[0].distal].child;
//! assert!((base_from_link[tip].translation.z - 0.134).abs() < 1e-3);
//! # Ok::<(), graspbox_hand::HandError>(())
//! ```

mod assemble;
pub mod error;
pub mod kinematics;
pub mod load;
pub mod model;
pub mod motor;
pub mod pose;
pub mod reflex;
mod scan;
mod table;
pub mod tendon;
mod urdf;

pub use error::{HandError, Problem, ProblemKind, Problems};
pub use kinematics::{HandConfiguration, PlacedShape};
pub use model::{
    Collider, Finger, Flexure, Friction, Hand, Joint, Link, Material, Motor, MotorKind, Shape, TactileSensor, Tendon,
};
pub use motor::{Hold, MotorCommand, MotorState};
pub use pose::{GraspPose, rigid_motion};
