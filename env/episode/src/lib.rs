//! One state machine for all drivers: scripted trials that label data, and agents.
//!
//! | module | purpose |
//! |---|---|
//! | [`body`] | from a mesh to convex parts, mass and inertia |
//! | [`scene`] | an object at rest on the table, from which episodes are cloned |
//! | [`layout`] | several objects at rest: packed, in a pile, in a bin |
//! | [`episode`] | the state machine: reset, advance, verdict |
//! | [`judge`] | the one definition of success, and the quantities that describe a grasp |
//! | [`trial`] | the scripted driver: close, lift, hold, shake |
//! | [`sample`] | the trace of a trial: one sample every 10 ms |
//! | [`shake`] | the shake of a grasped object along and about the hand's axes |
//! | [`forces`] | a grasp under a force along six axes, and lifted off the table, by the protocol of DexGraspBench |
//! | [`observer`] | additional measurements of a trial |
//! | [`study`] | an observer: the measures of the reference study |
//! | [`batch`] | trials with their feasibility check: many on rayon with progress and cancellation, or one with its trace |
//!
//! Grasps of a block are planned and tried:
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

pub mod approach;
pub mod batch;
pub mod body;
pub mod episode;
mod error;
pub mod forces;
pub mod judge;
pub mod layout;
mod layout_cache;
pub mod observer;
pub mod sample;
pub mod scene;
pub mod shake;
pub mod study;
pub mod trial;

/// Hash of the code that prepares and moves objects, for the keys of caches: another build may do either differently.
pub const BUILD: &str = env!("GRASPBOX_SIMULATION");

pub use approach::{Approach, approach};
pub use batch::{Progress, run_loaded_trials, run_observed_trials, run_trials, trace_trial};
pub use body::{Body, DEFAULT_DENSITY, ObjectSpec};
pub use episode::Episode;
pub use error::EpisodeError;
pub use forces::{ForceConfig, ForceOutcome, Motion, PullOutcome, run_forces};
pub use judge::{FailureKind, Judge, SuccessCriterion, Verdict};
pub use layout::{Arrangement, Draw, Layout, SPREADS};
pub use observer::Observer;
pub use sample::Sample;
pub use scene::Scene;
pub use shake::ShakeConfig;
pub use study::Study;
pub use trial::{Finished, Trial, TrialConfig, TrialOutcome};
