//! One world: a table, one object or several, and one hand, simulated by a physics engine.
//!
//! | module | purpose |
//! |---|---|
//! | [`config`] | physics settings, friction of table and object, with the reason for each number |
//! | [`object`] | an object: collision geometry, mass, inertia |
//! | [`world`] | the world itself: step, observe, clone, snapshot |
//! | [`contacts`] | contacts of the object and of the hand's links; tactile forces |
//! | [`scenery`] | dimensions of table and ground; walls, bins |
//! | [`load`] | contact forces on the hand, and their sum |
//! | `engine` | the interface between a world and its engine |
//! | `implicit` | the engine `implicit` ([`graspbox_solver`]), the default |
//! | `rapier` | the engine `rapier`; no other module uses that library |
//! | `motion` | the moving frame |
//! | `snapshot`, `identity` | worlds as bytes, and the templates that can restore them |
//!
//! A world is simulated in the frame of the hand's base: the hand's root is fixed, the table moves, and gravity includes the fictitious
//! accelerations. This halves the cost of a step and avoids the errors of a driven root. The public interface uses the world's frame (z up,
//! table top at z = 0) unless a name states another frame.
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
//!     world.step(&hand, &[])?; // the hand does not move, its actuators are off
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
mod implicit;
pub mod load;
mod motion;
pub mod object;
mod rapier;
pub mod scenery;
mod snapshot;
pub mod world;

pub use config::{EngineKind, Friction, ImplicitConfig, PhysicsConfig, RapierConfig};
pub use contacts::{Contacts, LinkContact, Tactile};
pub use error::SimError;
pub use load::{HandContact, HandLoad};
pub use object::{Geometry, ObjectModel};
pub use scenery::{Wall, bin};
pub use world::carrier::{ARM_IS_FAR, ArmContact};
pub use world::{JointState, Template, World};
