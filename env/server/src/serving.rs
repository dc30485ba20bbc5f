//! Sessions: the commands of a client in order, and its answers until they are acknowledged.
//!
//! | module | contents |
//! |---|---|
//! | [`hub`] | state shared by all sessions: settings, counters, threads, free environments |
//! | [`environment`] | the environments of a session, and the execution of commands |
//! | [`session`], [`session_state`], `session_making`, [`sessions`] | the sessions |
//! | [`connection`] | one WebSocket: reads, writes, pings |

pub mod connection;
pub mod environment;
pub mod hub;
pub mod session;
mod session_making;
pub mod session_state;
pub mod sessions;
