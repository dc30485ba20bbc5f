//! Environments: one episode under an agent each, many in one call.
//!
//! | module | purpose |
//! |---|---|
//! | [`env_spec`] | data shared by all environments of a pool |
//! | [`agent_episode`] | one episode under an agent |
//! | [`clearing`] | clearing a scene of several objects |
//! | [`record`] | the saved state of an episode beside world, judge and arm |
//! | [`step_result`] | the result of a step or a reset of one environment |
//! | [`mod@env`] | one environment: its stream, its episode, its results |
//! | [`saved_state`] | an environment as bytes |
//! | [`batch`] | results of many environments, as flat arrays |
//! | [`env_pool`] | all environments in one call; their pictures and cameras |

pub mod agent_episode;
pub mod batch;
pub mod clearing;
pub mod env;
pub mod env_pool;
pub mod env_spec;
pub mod record;
pub mod saved_state;
pub mod step_result;
