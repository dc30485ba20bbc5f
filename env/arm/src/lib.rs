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
//! | [`mod@path`] | from a posture to a grasp, and on to a place |
//! | [`follow`] | an arm in motion: rates for a wanted motion within all limits |
//! | [`room`] | how much room a posture leaves |
//! | [`mod@carrier`] | arm and hand as bodies in the frame of the hand |
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
pub mod carrier;
pub mod chain;
mod descent;
pub mod error;
pub mod follow;
pub mod inverse;
pub mod mask;
pub mod path;
mod postures;
pub mod reach;
pub mod room;
pub mod scene;

pub use bodies::{ArmBodies, Carried, check_payload};
pub use carrier::carrier;
pub use chain::Chain;
pub use error::ArmError;
pub use follow::{AxesState, Follower};
pub use inverse::{Inverse, Solution};
pub use mask::{Mounted, on_arm};
pub use path::{Contact, Mover, Path, PathParams, Robot, Task, Thing, With, path};
pub use reach::{Reach, ReachParams, Reason, reach};
pub use room::Room;
pub use scene::{Scene, Touched};
