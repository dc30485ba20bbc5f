//! One world: a table, one object, one hand, moved by a physics engine.
//!
//! | module | what it does |
//! |---|---|
//! | [`config`] | physics settings, friction of table and object, with the reason for each number |
//! | [`object`] | the object: collision geometry, mass, inertia |
//! | [`world`] | the world itself: step, observe, clone, snapshot |
//! | [`contacts`] | who touches whom, how deep and how hard; tactile pressures |
//! | [`scenery`] | how large table and ground are |
//! | [`load`] | what presses on the hand: contact points, and their sum |
//! | `engine` | the seam: what a world asks of an engine |
//! | `rapier` | the engine on rapier; nothing else knows that library |
//! | `motion` | the moving frame |
//! | `snapshot`, `identity` | worlds as bytes, and what they can be restored into |
//!
//! The world is simulated in the hand's base frame: the hand's root stands still, the table moves, and gravity carries the
//! fictitious accelerations. That halves the cost of a step and removes every error of a driven root. Everything that this crate
//! hands out is in the world's frame (z up, table top at z = 0) unless its name says otherwise.
//!
//! A ball falls from 0.5 m and comes to rest on the table:
//!
//! ```
//! use graspbox_hand::Hand;
//! use graspbox_sim::{Geometry, ObjectModel, PhysicsConfig, Template};
//! use nalgebra::Isometry3;
//! use std::sync::Arc;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let ball = ObjectModel::solid(&Geometry::Ball { radius: 0.03 }, 0.2)?;
//! let template = Template::new(Arc::new(Hand::reflex()?.clone()), &ball, PhysicsConfig::default())?;
//! let hand = Isometry3::translation(0.0, 0.0, 1.5);
//! let mut world = template.spawn(&hand, &Isometry3::translation(0.0, 0.0, 0.5), 0.0);
//! while world.time() < 1.5 {
//!     world.step(&hand, &[])?; // the hand stays, its actuators are off
//! }
//! assert!((world.object_center().z - 0.03).abs() < 5e-4);
//! # Ok(())
//! # }
//! ```

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::panic))]

pub mod config;
pub mod contacts;
mod engine;
mod error;
mod identity;
pub mod load;
mod motion;
mod native;
pub mod object;
mod rapier;
pub mod scenery;
mod snapshot;
pub mod world;

pub use config::{EngineKind, Friction, PhysicsConfig, RapierConfig};
pub use contacts::{Contacts, LinkContact, Tactile};
pub use error::SimError;
pub use load::{HandContact, HandLoad};
pub use object::{Geometry, ObjectModel};
pub use world::{JointState, Template, World};
