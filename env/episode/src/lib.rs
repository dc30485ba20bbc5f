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
