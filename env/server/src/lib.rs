//! Environments and policies over WebSockets: one msgpack value in each frame, numpy arrays as openpi writes them.
//!
//! | module | contents |
//! |---|---|
//! | [`value`], [`mod@decode`], [`encode`] | the codec: values, reading within bounds, writing |
//! | [`fault`] | errors as sent to a client |
//! | [`fields`], [`command`] | commands of a client, one row each |
//! | [`answer`] | results of environments as frames |
//! | [`environment`] | the environments of a session, and the execution of commands |
//! | [`hub`] | state shared by all sessions: settings, counters, threads, free environments |
//! | [`session`], [`session_state`], `session_making`, [`sessions`] | a client's commands in order, and its answers until they are acknowledged |
//! | [`connection`] | one WebSocket: reads, writes, pings |
//! | [`segment`] | memory shared by server and client on one machine |
//! | [`gate`], [`pem`] | access control; certificates and keys |
//! | [`listener`] | accepts connections, with TLS or without |
//! | [`server`] | starts, drains, ends |
//! | [`policy_server`] | policy server: observations in, decisions out |
//! | [`client_socket`], [`client`] | the client: one WebSocket, and a session that outlives it |
//! | [`config`], [`error`], [`metrics`] | settings and bounds, errors at the start, counters |
//!
//! Frames are handled by threads of tokio, and so are short commands; all others run on a rayon pool. Python makes environments
//! ([`hub::MakeJob`]) and does nothing else. `docs/reference/protocol.md` specifies the protocol.

pub mod answer;
pub mod client;
pub mod client_socket;
pub mod command;
pub mod config;
pub mod connection;
pub mod decode;
pub mod encode;
pub mod environment;
pub mod error;
pub mod fault;
pub mod fields;
pub mod gate;
pub mod hub;
pub mod listener;
pub mod metrics;
pub mod pem;
pub mod policy_server;
pub mod segment;
pub mod server;
pub mod session;
mod session_making;
pub mod session_state;
pub mod sessions;
pub mod value;

pub use client::Client;
pub use client_socket::{ClientError, ClientOptions};
pub use config::ServerConfig;
pub use decode::decode;
pub use encode::Encoder;
pub use environment::Made;
pub use error::ServerError;
pub use fault::Fault;
pub use hub::MakeJob;
pub use policy_server::{Form, PolicyJob, PolicyServer};
pub use server::Server;
pub use value::{CodecError, Value};
