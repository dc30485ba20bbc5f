//! The environment: many of them side by side, each an [`Episode`](graspbox_episode::Episode) driven by actions at 20 Hz.
//!
//! | module | what it does |
//! |---|---|
//! | [`config`] | how the environments are controlled, ended and randomized |
//! | [`objects`] | objects that are prepared at their first use and shared by every environment |
//! | [`random_stream`] | the random stream of one environment |
//! | [`initial_state`] | how an episode begins: sampled, or as asked |
//! | [`action`] | what the numbers of an action mean |
//! | [`arm_controller`] | moves the hand within its limits |
//! | [`guard`] | keeps the hand off the table and stops it where it presses too hard |
//! | [`observation_spec`] | the tables of observations: names, bounds, units |
//! | [`observe`] | fills observations |
//! | [`grasp_quality`] | force closure of the present contacts: epsilon |
//! | [`reward`] | named reward terms |
//! | [`env_spec`] | what every environment of a pool shares |
//! | [`agent_episode`] | one episode under an agent |
//! | [`env`] | one environment: its stream, its episode, its state as bytes |
//! | [`batch`] | results of a step of many environments, as flat arrays |
//! | [`env_pool`] | all environments in one call |
//! | `error` | every way an input can be wrong, one sentence each |
//!
//! Every random number depends on the environment's own stream alone, so results depend neither on the number of environments
//! nor on the number of threads.

pub mod action;
pub mod agent_episode;
pub mod arm_controller;
pub mod batch;
pub mod config;
pub mod env;
pub mod env_pool;
pub mod env_spec;
mod error;
pub mod grasp_quality;
pub mod guard;
pub mod initial_state;
pub mod objects;
pub mod observation_spec;
pub mod observe;
pub mod random_stream;
pub mod reward;

pub use action::Control;
pub use agent_episode::Info;
pub use batch::Batch;
pub use config::{AgentConfig, Autoreset, Randomization};
pub use env::{Env, Outcome};
pub use env_pool::{EnvPool, panic_text};
pub use env_spec::EnvSpec;
pub use error::AgentError;
pub use initial_state::ResetOptions;
pub use objects::{Objects, Source};
pub use observation_spec::{Field, Observation};
