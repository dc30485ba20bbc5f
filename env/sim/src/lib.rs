//! One world on rapier: a table, one object, one hand.
//!
//! | module | what it does |
//! |---|---|
//! | [`config`] | physics settings, friction of table and object, with the reason for each number |
//! | [`object`] | the object: convex parts, mass, inertia |
//! | [`world`] | the world itself: step, observe, clone, snapshot |
//! | [`contacts`] | who touches whom, how deep and how hard; tactile pressures |
//! | [`scenery`] | how large table and ground are |
//! | [`load`] | what presses on the hand: contact points, and their sum |
//! | `build`, `finger`, `motion`, `frames` | assembly, tendon law, the moving frame, conversions |
//! | `snapshot`, `identity` | worlds as bytes, and what they can be restored into |
//! | `dispatch` | faster searches for contacts |
//!
//! The world is simulated in the hand's base frame: the hand's root stands still, the table moves, and gravity carries the
//! fictitious accelerations. That halves the cost of a step and removes every error of a driven root. Everything that this crate
//! hands out is in the world's frame (z up, table top at z = 0) unless its name says otherwise.

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::panic))]

mod build;
pub mod config;
pub mod contacts;
mod dispatch;
mod error;
mod finger;
mod frames;
mod identity;
pub mod load;
mod motion;
pub mod object;
pub mod scenery;
mod snapshot;
pub mod world;

pub use config::{Friction, PhysicsConfig};
pub use contacts::{Contacts, LinkContact, Tactile};
pub use error::SimError;
pub use load::{HandContact, HandLoad};
pub use object::{Geometry, ObjectModel};
pub use world::{FingerState, Template, World};
