//! What an arm reaches, and by which paths: inverse kinematics within limits, collisions with itself, its hand and a scene. No dynamics.
//!
//! | module | purpose |
//! |---|---|
//! | [`chain`] | kinematics of the axes, without allocation: frames, Jacobian, singular values, the farthest that a flange can be |
//! | `descent` | from one posture to a pose: damped least squares within the limits |
//! | `postures` | a table of postures, of which the nearest to a pose are where descents begin |
//! | [`inverse`] | all solutions of a pose that the descents find |
//! | [`bodies`] | collision shapes of the arm and the open hand that it carries; pairs that touch by design |
//! | [`scene`] | what the arm must not touch: the table, measured points, objects |
//! | [`mask`] | measured points that show the arm itself or its hand |
//! | [`mod@reach`] | poses of a hand: which are reached, by which postures, and why others are not |
//! | `motion` | a straight motion between two postures, checked by the distance that bodies move |
//! | [`line`] | straight lines of the hand, from posture to posture |
//! | `roadmap` | ways between postures: RRT-Connect, shortcuts |
//! | [`mod@path`] | from a posture to a grasp, and on to a place |
//! | [`error`] | errors, one sentence each |
//!
//! ```
//! use graspbox_arm::Inverse;
//! use graspbox_hand::arm::assets::arm_asset;
//! use std::ops::ControlFlow;
//!
//! let arm = arm_asset("ur5e")?.read()?;
//! let base_from_flange = arm.forward_kinematics(&arm.home())?[arm.flange];
//! let mut postures = 0;
//! let solved = Inverse::new(&arm).solve(&base_from_flange, 32, 0.0, |_| {
//!     postures += 1;
//!     ControlFlow::Continue(())
//! });
//! assert!(solved.is_ok() && postures >= 4);
//! # Ok::<(), graspbox_hand::HandError>(())
//! ```
//!
//! Units are metres and radians. Poses of the flange are in the base's frame, those of hands and obstacles in the world's.

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::panic))]

pub mod bodies;
pub mod chain;
mod descent;
pub mod error;
pub mod inverse;
pub mod line;
mod motion;
pub mod path;
pub mod mask;
mod postures;
pub mod reach;
mod roadmap;
pub mod scene;

pub use bodies::{ArmBodies, Carried};
pub use chain::Chain;
pub use error::ArmError;
pub use inverse::{Inverse, Solution};
pub use motion::{Contact, Mover, With};
pub use path::{Path, PathParams, Robot, Task, Thing, path};
pub use mask::{Mounted, on_arm};
pub use reach::{Reach, ReachParams, Reason, reach};
pub use scene::{Scene, Touched};
