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
//!
//! ```
//! use graspbox_hand::Hand;
//! use graspbox_sim::{Geometry, ObjectModel, PhysicsConfig, Template};
//! use nalgebra::Isometry3;
//! use std::sync::Arc;
//!
//! let hand = Arc::new(Hand::reflex()?.clone());
//! let ball = ObjectModel::solid(&Geometry::Ball { radius: 0.03 }, 0.1)?;
//! let template = Template::new(hand, &ball, PhysicsConfig::default())?;
//! // The hand waits high above the table; the ball falls by 1 cm.
//! let away = Isometry3::translation(0.0, 0.0, 1.5);
//! let mut world = template.spawn(&away, &Isometry3::translation(0.0, 0.0, 0.04), 0.0);
//! for _ in 0..200 {
//!     world.step(&away, &[])?;
//! }
//! assert!((world.object_center().z - 0.03).abs() < 1e-3);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

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
