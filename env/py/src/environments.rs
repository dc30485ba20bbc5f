//! Environments, their objects and results; servers and clients.
//!
//! | module | purpose |
//! |---|---|
//! | [`mod@client`] | a session on a server |
//! | [`frames`] | values of frames as Python objects, and back |
//! | [`mod@policy_server`] | a server of a policy |
//! | [`objects`] | objects by family and seed |
//! | [`env_arrays`] | results of environments as arrays by name |
//! | [`env_pool`] | many environments in one call |
//! | [`mod@server`] | a server of environments |

pub mod client;
pub mod env_arrays;
pub mod env_pool;
pub mod frames;
pub mod objects;
pub mod policy_server;
pub mod server;
