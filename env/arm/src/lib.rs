//! What an arm reaches: inverse kinematics within limits, and collisions with itself, its hand and a scene. No paths, no dynamics.
//!
//! | module | purpose |
//! |---|---|
//! | [`chain`] | kinematics of the axes, without allocation: frames, Jacobian, singular values, the farthest that a flange can be |
//! | `descent` | from one posture to a pose: damped least squares within the limits |
//! | `postures` | a table of postures, of which the nearest to a pose are where descents begin |
//! | [`inverse`] | all solutions of a pose that the descents find |
//! | [`bodies`] | collision shapes of the arm and the open hand that it carries; pairs that touch by design |
//! | [`scene`] | what the arm must not touch: the table, measured points, objects |
//! | [`reach`] | poses of a hand: which are reached, by which postures, and why others are not |
//! | [`error`] | errors, one sentence each |
//!
//! Units are metres and radians. Poses of the flange are in the base's frame, those of hands and obstacles in the world's.

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::panic))]

pub mod bodies;
pub mod chain;
mod descent;
pub mod error;
pub mod inverse;
mod postures;
pub mod reach;
pub mod scene;

pub use bodies::{ArmBodies, Carried};
pub use chain::Chain;
pub use error::ArmError;
pub use inverse::{Inverse, Solution};
pub use reach::{Reach, ReachParams, Reason, reach};
pub use scene::{Scene, Touched};
