//! Environments: one episode each, many in one call.
//!
//! | module | purpose |
//! |---|---|
//! | [`env_spec`] | data shared by all environments of a pool |
//! | [`env_episode`] | one episode: actions in, reward terms and endings out |
//! | `episode_body` | the parts of an episode that every mode has |
//! | `grasp`, `grasp_pose`, `clearing` | a step in each mode |
//! | [`step_result`] | the result of a step or a reset of one environment |
//! | [`mod@env`] | one environment: its stream, its episode, its results |
//! | [`saved_state`] | an environment as bytes |
//! | [`batch`] | results of many environments, as flat arrays |
//! | [`env_pool`] | all environments in one call; their pictures and cameras |

pub mod batch;
mod clearing;
pub mod env;
pub mod env_episode;
pub mod env_pool;
pub mod env_spec;
pub(crate) mod episode_body;
mod grasp;
mod grasp_pose;
pub mod saved_state;
pub mod step_result;
