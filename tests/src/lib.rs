//! Tests that cross crates: pipeline, properties, determinism, physics truths. What they share is here.
//!
//! | module | what it does |
//! |---|---|
//! | [`agent`] | environments, and a driver that follows a planned grasp by actions |
//! | [`mod@bench`] | worlds with one object, posed and driven for a test |
//! | [`scenes`] | procedural objects at rest, with the poses that the planner proposes for them |
//! | [`two_link`] | closed forms of a finger as a planar double pendulum |
#![allow(clippy::unwrap_used)]

pub mod agent;
pub mod bench;
pub mod scenes;
pub mod two_link;
