//! Environments and policies over WebSockets: one msgpack value in each frame, numpy arrays as openpi writes them.
//!
//! | module | contents |
//! |---|---|
//! | [`wire`] | the codec, commands, answers, errors as sent to a client |
//! | [`serving`] | sessions, their environments, their connections |
//! | [`segment`] | memory shared by server and client on one machine |
//! | [`gate`], [`pem`] | access control; certificates and keys |
//! | [`listener`] | accepts connections, with TLS or without |
//! | [`server`] | starts, drains, ends |
//! | [`policy_server`] | policy server: observations in, decisions out |
//! | [`client_socket`], [`client`] | the client: one WebSocket, and a session that outlives it |
//! | [`config`], [`error`], [`metrics`] | settings and bounds, errors at the start, counters |
//!
//! Frames are handled by threads of tokio, and so are short commands; all others run on a rayon pool. Python makes environments
//! ([`MakeJob`]) and does nothing else. `docs/reference/protocol.md` specifies the protocol.

pub mod client;
pub mod client_socket;
pub mod config;
pub mod error;
pub mod gate;
pub mod listener;
pub mod metrics;
pub mod pem;
pub mod policy_server;
pub mod segment;
pub mod server;
pub mod serving;
pub mod wire;

pub use client::Client;
pub use client_socket::{ClientError, ClientOptions};
pub use config::ServerConfig;
pub use error::ServerError;
pub use policy_server::{PolicyJob, PolicyServer, Transport};
pub use server::{RunningServer, Server};
pub use serving::environment::MadeEnvironments;
pub use serving::hub::MakeJob;
pub use wire::decode::decode;
pub use wire::encode::Encoder;
pub use wire::fault::Fault;
pub use wire::value::{CodecError, Value};
