//! The environment: pools of environments, each an [`Episode`](graspbox_episode::Episode) driven by actions at 20 Hz.
//!
//! | module | purpose |
//! |---|---|
//! | [`control`] | control modes, and the control period |
//! | [`workspace`] | boxes and distances of the workspace |
//! | [`config`] | settings: control, endings, observations, randomization |
//! | [`source`] | the source of an object: memory, file, family |
//! | [`objects`] | objects, prepared in the background or at first use, and shared by all environments |
//! | [`ahead`] | the background thread |
//! | [`random_stream`] | the random stream of one environment |
//! | [`mod@column`] | one row of a table of columns |
//! | [`action`] | the meaning of an action's entries |
//! | [`arm_controller`] | motion of the hand within limits |
//! | [`guard`] | distance from the table, and the protective stop |
//! | [`view`] | the state of an episode, from which observations and infos are read |
//! | [`observation`] | observations, from rows ([`observation_row`]) of sensed ([`sensed`]) and simulated ([`simulated`]) quantities |
//! | [`json`] | configs from JSON, with errors that name the field |
//! | [`info`] | the info of a step, from one row per entry |
//! | [`grasp_quality`] | epsilon of the present contacts |
//! | [`potentials`], [`reward`] | bounded potentials, and the named reward terms |
//! | [`env_spec`] | data shared by all environments of a pool |
//! | `row_check` | a check of every observation when environments are made |
//! | [`reset_options`] | options of a reset |
//! | [`initial_state`] | the initial state of an episode ([`initial_samples`], [`hand_placement`]) |
//! | [`record`] | the saved state of an episode beside world, judge and arm |
//! | [`decision`] | one decision per episode: the trial at a pose |
//! | [`agent_episode`] | one episode under an agent |
//! | [`step_result`] | the result of a step or a reset of one environment |
//! | [`saved_state`] | an environment as bytes |
//! | [`mod@env`] | one environment: its stream, its episode, its results |
//! | [`batch`] | results of many environments, as flat arrays |
//! | [`env_pool`] | all environments in one call; their pictures and cameras |
//! | [`tables`] | the tables of all inputs and outputs of environments |
//! | `error` | errors, one sentence each |
//!
//! Every random number depends only on the environment's own stream, so results depend neither on the number of environments nor on the number
//! of threads.

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
