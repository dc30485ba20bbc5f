//! The environment: many of them side by side, each an [`Episode`](graspbox_episode::Episode) driven by actions at 20 Hz.
//!
//! | module | what it does |
//! |---|---|
//! | [`control`] | control modes, and the control period |
//! | [`workspace`] | boxes and distances of the workspace |
//! | [`config`] | settings: control, endings, observations, randomization |
//! | [`source`] | where an object comes from |
//! | [`objects`] | objects that are prepared ahead or at their first use, and shared by every environment |
//! | [`ahead`] | a thread for work ahead of its need |
//! | [`random_stream`] | the random stream of one environment |
//! | [`mod@column`] | one row of a table of numbers |
//! | [`action`] | what the numbers of an action mean |
//! | [`arm_controller`] | moves the hand within its limits |
//! | [`guard`] | keeps the hand off the table and stops it if it presses too hard |
//! | [`view`] | what observations and infos are read from |
//! | [`observation`] | observations, from rows ([`observation_row`]) of what is sensed ([`sensed`]) and simulated ([`simulated`]) |
//! | [`json`] | reads configs, and names the field that is wrong |
//! | [`info`] | the info of a step, from one row per entry |
//! | [`grasp_quality`] | force closure of the present contacts: epsilon |
//! | [`potentials`], [`reward`] | bounded potentials, and the named reward terms |
//! | [`env_spec`] | what all environments of a pool share |
//! | `row_check` | reads every observation once when environments are made |
//! | [`reset_options`] | options of a reset |
//! | [`initial_state`] | how an episode begins ([`initial_samples`], [`hand_placement`]) |
//! | [`record`] | what an episode remembers beside its world |
//! | [`decision`] | one decision per episode: the trial at a pose |
//! | [`agent_episode`] | one episode under an agent |
//! | [`step_result`] | what a step or a reset of one environment returns |
//! | [`saved_state`] | an environment as bytes |
//! | [`mod@env`] | one environment: its stream, its episode, its results |
//! | [`batch`] | results of many environments, as flat arrays |
//! | [`env_pool`] | all environments in one call |
//! | [`pool_views`] | pictures and cameras of the environments of a pool |
//! | [`tables`] | the tables of everything that environments take and return |
//! | `error` | every way an input can be wrong, one sentence each |
//!
//! Every random number depends on the environment's own stream alone, so results depend neither on the number of environments
//! nor on the number of threads.

pub mod action;
pub mod agent_episode;
pub mod ahead;
pub mod arm_controller;
pub mod batch;
pub mod column;
pub mod config;
pub mod control;
pub mod decision;
pub mod env;
pub mod env_pool;
pub mod env_spec;
mod error;
pub mod grasp_quality;
pub mod guard;
pub mod hand_placement;
pub mod info;
pub mod initial_samples;
pub mod initial_state;
pub mod json;
pub mod objects;
pub mod observation;
pub mod observation_row;
pub mod pool_views;
pub mod potentials;
pub mod random_stream;
pub mod record;
pub mod reset_options;
pub mod reward;
mod row_check;
pub mod saved_state;
pub mod sensed;
pub mod simulated;
pub mod source;
pub mod step_result;
pub mod tables;
pub mod view;
pub mod workspace;

pub use batch::Batch;
pub use column::Column;
pub use config::{AgentConfig, Autoreset, Randomization};
pub use control::Control;
pub use env::Env;
pub use env_pool::{EnvPool, panic_text};
pub use env_spec::EnvSpec;
pub use error::AgentError;
pub use objects::Objects;
pub use observation::Observation;
pub use reset_options::ResetOptions;
pub use source::{ObjectDescription, Source};
pub use step_result::StepResult;
pub use tables::Tables;
