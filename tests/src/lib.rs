//! Tests that cross crates: pipeline, properties, determinism, physics truths. This library has their common parts.
//!
//! | module | purpose |
//! |---|---|
//! | [`gym`] | environments, and a driver that follows a planned grasp by actions |
//! | [`mod@bench`] | worlds with one object, posed and driven for a test |
//! | [`scenes`] | procedural objects at rest, with the poses that the planner proposes for them |
//! | [`two_link`] | closed forms of a finger as a planar double pendulum |
//!
//! ```
//! use graspbox_sim::{Geometry, PhysicsConfig};
//! use graspbox_tests::bench::{at, away, reflex, run, template};
//!
//! let ball = template(reflex(), &Geometry::Ball { radius: 0.03 }, 0.2, PhysicsConfig::default());
//! let mut world = ball.spawn(&away(), &at(0.0, 0.0, 0.03), 0.0);
//! run(&mut world, &away(), &[], 0.2);
//! assert!((world.object_center().z - 0.03).abs() < 5e-4); // it rests
//! ```
#![allow(clippy::unwrap_used, clippy::panic)]

pub mod bench;
pub mod gym;
pub mod scenes;
pub mod two_link;
