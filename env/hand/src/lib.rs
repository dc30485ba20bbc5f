//! A hand: links, joints, tendons, motors, sensors, and its grasp pose.
//!
//! | module | what it does |
//! |---|---|
//! | [`model`] | the description, as read from a URDF and a `hand.toml` |
//! | [`pose`] | the grasp pose: where the hand goes, and its preshape |
//!
//! The hand frame is the grasp frame: the base's axes, its origin on the palm's surface (`base_from_hand`).

pub mod model;
pub mod pose;

pub use model::{
    Collider, Finger, Flexure, Hand, Joint, Link, Material, Motor, MotorKind, Shape, TactileSensor, Tendon,
};
pub use pose::GraspPose;
