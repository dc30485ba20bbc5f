//! Our own solver for the one world of this project: a free object, a hand of any tree of joints on a moving base, and a table.
//!
//! | module | what it does |
//! |---|---|
//! | [`tree`] | the hand: bodies, joints, coordinates, cables |
//! | [`object`], [`scenery`] | the object; table and ground |
//! | [`config`] | settings, with the reason for each number |
//! | [`model`] | what all worlds of one template share |
//! | [`solver`] | a world's state, and a step of it |
//! | `kinematics`, `dynamics` | poses and Jacobians; mass matrix and bias forces |
//! | `search` | which points may touch |
//! | `contacts` | the contact points of the last step |
//! | `rows`, `laws`, `problem`, `newton` | the equations of a step, and Newton's method for them |
//! | `matrix`, `units` | dense matrices; parry's lengths |
//! | [`dispatch`] | faster searches for contacts |
//!
//! Everything is in f64, metres, and in the frame of the hand's base, which stands still: the table moves, and gravity carries the fictitious
//! accelerations.
//!
//! Why our own: general engines iterate over contacts one by one (rapier) or solve a world of any size (MuJoCo). This world has 6 unknowns
//! of the object and some 6 to 20 of the hand, whatever its number of contacts, so that Newton's method with a dense matrix solves all of
//! them together to rounding in some three iterations. ARCHITECTURE.md has the measurements.

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::panic))]

pub mod config;
mod contacts;
pub mod dispatch;
mod dynamics;
mod error;
mod kinematics;
mod laws;
mod matrix;
pub mod model;
mod newton;
pub mod object;
mod problem;
mod rows;
pub mod scenery;
mod search;
pub mod solver;
pub mod tree;
mod units;

pub use config::SolverConfig;
pub use contacts::{Contact, Side};
pub use dynamics::FrameMotion;
pub use error::ModelError;
pub use model::{BASE, BodyIndex, Model, OBJECT};
pub use object::{Object, ObjectPart};
pub use scenery::{Scenery, Surface};
pub use solver::{Given, Saved, Solver, State, StepInput};
pub use tree::{Body, BodyShape, Cable, Coordinate, Joint, JointKind, Primitive, Tree};
