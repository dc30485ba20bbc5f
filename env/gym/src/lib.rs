//! The environment: pools of environments, each an [`Episode`](graspbox_episode::Episode) driven by actions.
//!
//! | module | purpose |
//! |---|---|
//! | [`config`], [`json`] | settings: control, endings, observations, randomization; from JSON, with errors that name the field |
//! | [`robot_arm`] | the arm that carries the hand, at its place |
//! | [`scenery`] | render models of walls, table and ground |
//! | [`source`] | the source of an object: memory, file, family |
//! | [`objects`], [`ahead`] | objects, prepared at first use or by a background thread, and shared by all environments |
//! | [`actions`] | control modes, actions, motion of the hand within limits |
//! | [`observations`] | columns, observations, infos |
//! | [`rewards`] | potentials and named reward terms |
//! | [`starts`] | resets and initial states |
//! | [`state`] | the state of an episode besides its world, judge and arm |
//! | [`pool`] | environments, and pools of them |
//! | `error` | errors, one sentence each |
//!
//! Every random number depends only on the environment's own stream, so results depend neither on the number of environments nor on the number
//! of threads.

pub mod actions;
pub mod ahead;
pub mod config;
mod error;
pub mod json;
pub mod objects;
pub mod observations;
pub mod pool;
pub mod rewards;
pub mod robot_arm;
pub mod scenery;
pub mod source;
pub mod starts;
pub mod state;

pub use actions::control::{ActionSpec, Control, Fingers};
pub use config::{Autoreset, ClutterConfig, EnvConfig, Randomization};
pub use error::EnvError;
pub use graspbox_episode::Layout;
pub use objects::Objects;
pub use observations::column::Column;
pub use observations::observation::Observation;
pub use observations::tables::Tables;
pub use pool::batch::Batch;
pub use pool::env::Env;
pub use pool::env_pool::{EnvPool, caught};
pub use pool::env_spec::EnvSpec;
pub use pool::step_result::StepResult;
pub use robot_arm::RobotArm;
pub use source::{ObjectDescription, Source};
pub use starts::reset_options::ResetOptions;
pub use state::{GoalConfig, GoalTask};
