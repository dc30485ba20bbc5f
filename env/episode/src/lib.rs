//! One state machine for every driver: a scripted trial labels data with it, an agent acts in it.
//!
//! | module | what it does |
//! |---|---|
//! | [`body`] | from a mesh to convex parts, mass and inertia |
//! | [`scene`] | an object at rest on the table, ready to be cloned into episodes |
//! | [`episode`] | the state machine: reset, advance, observe, verdict |
//! | [`judge`] | the one definition of success, and the numbers that describe a grasp |
//! | [`study`] | the reference study's own measures, for trials that are asked for them |
//! | [`trial`] | the scripted driver: close, lift, hold |
//! | [`batch`] | trials with their feasibility check: many on rayon with progress and cancellation, or one traced |
//!
//! ```
//! use graspbox_episode::{Body, ObjectSpec, Progress, Scene, TrialConfig, run_trials};
//! use graspbox_hand::{GraspPose, Hand};
//! use graspbox_mesh::convex_hull;
//! use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
//! use std::sync::Arc;
//!
//! let corner = |i: i32| Point3::new(0.03 * f64::from(2 * (i & 1) - 1), 0.03 * f64::from((i & 2) - 1), 0.05 * f64::from((i & 4) / 2 - 1));
//! let mesh = convex_hull(&(0..8).map(corner).collect::<Vec<_>>())?;
//! let body = Body::prepare(&ObjectSpec { name: "block".into(), mesh, mass: Some(0.2), parts: None }, None)?;
//! let hand = Arc::new(Hand::reflex()?.clone());
//! let scene = Arc::new(Scene::new(&body, hand, Default::default(), None)?);
//! // The palm faces down, 2 cm above the block.
//! let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
//! let object_from_hand = Isometry3::from_parts(Translation3::new(0.0, 0.0, 0.07), down);
//! let poses = [GraspPose { object_from_hand, preshape: 0.0 }];
//! let outcomes = run_trials(&scene, &poses, TrialConfig::default(), &Progress::default())?;
//! assert!(outcomes[0].success);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod batch;
pub mod body;
pub mod episode;
mod error;
pub mod judge;
pub mod scene;
pub mod study;
pub mod trial;

pub use batch::{Progress, run_trials, trace_trial};
pub use body::{Body, DEFAULT_DENSITY, ObjectSpec};
pub use episode::Episode;
pub use error::EpisodeError;
pub use judge::{FailureKind, Judge, SuccessCriterion, Verdict};
pub use scene::Scene;
pub use trial::{Sample, Trial, TrialConfig, TrialOutcome};
