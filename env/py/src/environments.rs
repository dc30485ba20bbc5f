//! Environments, their objects and results; servers and clients.

pub mod client;
pub mod env_arrays;
pub mod env_pool;
pub mod frames;
pub mod listener;
pub mod objects;
pub mod policy_server;
pub mod server;
