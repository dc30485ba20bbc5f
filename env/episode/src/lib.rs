//! One state machine for every driver: a scripted trial labels data with it, an agent acts in it.
//!
//! | module | what it does |
//! |---|---|
//! | [`body`] | from a mesh to convex parts, mass and inertia |
//! | [`scene`] | an object at rest on the table, ready to be cloned into episodes |
//! | [`episode`] | the state machine: reset, advance, observe, verdict |
//! | [`judge`] | the one definition of success, and the numbers that describe a grasp |
//! | [`study`] | the reference study's own measures, for trials that are asked for them |
//! | [`sample`] | what a trial records of itself, every 10 ms |
//! | [`shake`] | how a hand shakes what it holds, along and about its axes |
//! | [`trial`] | the scripted driver: close, lift, hold, shake |
//! | [`batch`] | trials with their feasibility check: many on rayon with progress and cancellation, or one traced |
//!
//! A block, planned for and grasped:
//!
//! ```
//! use graspbox_episode::{Body, ObjectSpec, Progress, Scene, TrialConfig, run_trials};
//! use graspbox_hand::Hand;
//! use graspbox_mesh::convex_hull;
//! use graspbox_plan::PlanParams;
//! use graspbox_sim::PhysicsConfig;
//! use nalgebra::Point3;
//! use std::sync::Arc;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let corner = |i: usize| Point3::new([-0.03, 0.03][i & 1], [-0.03, 0.03][i >> 1 & 1], [0.0, 0.1][i >> 2]);
//! let mesh = convex_hull(&(0..8).map(corner).collect::<Vec<_>>())?;
//! let block = Body::prepare(&ObjectSpec { name: "block".into(), mesh, mass: Some(0.2), parts: None }, None)?;
//! let scene = Scene::new(&block, Arc::new(Hand::reflex()?.clone()), PhysicsConfig::default(), None)?;
//! let plan = scene.plan(&block, &PlanParams::default())?;
//! let poses: Vec<_> = plan.ranked().iter().take(4).map(|candidate| candidate.grasp).collect();
//! let outcomes = run_trials(&Arc::new(scene), &poses, TrialConfig::default(), &Progress::default())?;
//! assert!(outcomes.iter().any(|outcome| outcome.success));
//! # Ok(())
//! # }
//! ```

pub mod batch;
pub mod body;
pub mod episode;
mod error;
pub mod judge;
pub mod sample;
pub mod scene;
pub mod shake;
pub mod study;
pub mod trial;

pub use batch::{Progress, run_scaled_trials, run_trials, trace_trial};
pub use body::{Body, DEFAULT_DENSITY, ObjectSpec};
pub use episode::Episode;
pub use error::EpisodeError;
pub use judge::{FailureKind, Judge, SuccessCriterion, Verdict};
pub use sample::Sample;
pub use scene::Scene;
pub use shake::ShakeConfig;
pub use trial::{Trial, TrialConfig, TrialOutcome};
