//! Settings and bounds of a server. Every bound is checked before memory is allocated.

use serde::{Deserialize, Serialize};

/// Longest pause of a client between two attempts, and timeout of a TLS handshake or the headers of a request, seconds.
pub const HANDSHAKE: u64 = 10;
/// Seconds within which a client must read part of the data sent to it.
pub const WRITE_TIMEOUT: u64 = 30;
/// Seconds between two pings to a client, which keep tunnels open.
pub const PING: u64 = 20;
/// Pings to a client that has no environments; after that its connection ends.
pub const MAX_UNUSED: usize = 3;
/// Close code of a WebSocket whose session is over; after any other the client may resume its session.
pub const SESSION_OVER: u16 = 4000;
/// Close code of a WebSocket whose client sent too large a frame (RFC 6455).
pub const TOO_LARGE: u16 = 1009;
/// Pings to a client of a policy without a request so far (five minutes); after that its connection ends.
pub const MAX_UNUSED_POLICY: u64 = 15;
/// Most waiting commands of a session; beyond that its connection is not read until one is done.
pub const MAX_WAITING: usize = 64;
/// Most unacknowledged answers of a session; a resuming client has sent at most the allowed number of waiting commands.
pub const MAX_KEPT: usize = 1024;
/// Bytes of unwritten or unacknowledged answers beyond which no further command of the session begins.
pub const MAX_UNSENT: usize = 64 << 20;
/// Connections without a session: health checks, metrics, and clients before their first command.
pub const SPARE_CONNECTIONS: usize = 256;

/// Settings of a server.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ServerConfig {
    /// Address to listen at.
    pub host: String,
    /// Port; 0: any free port.
    pub port: u16,
    /// Certificate chain of TLS, a PEM file; none: no TLS.
    pub tls_cert: Option<String>,
    /// Its private key, a PEM file.
    pub tls_key: Option<String>,
    /// Token of clients; none: any client may connect.
    pub token: Option<String>,
    /// Origins of browser pages that may connect, such as `http://localhost:8080`.
    pub origins: Vec<String>,
    /// Most environments in all sessions.
    pub max_envs: usize,
    /// Most sessions.
    pub max_sessions: usize,
    /// Largest message in either direction, bytes.
    pub max_message: usize,
    /// Seconds without a command after which a session ends.
    pub idle_timeout: f64,
    /// Longest time for which a session waits for a client whose connection was lost, seconds.
    pub max_grace: f64,
    /// Threads that step environments.
    pub threads: usize,
}

impl Default for ServerConfig {
    fn default() -> Self {
        Self {
            host: "127.0.0.1".to_owned(),
            port: 5055,
            tls_cert: None,
            tls_key: None,
            token: None,
            origins: Vec::new(),
            max_envs: 1024,
            max_sessions: 256,
            max_message: 64 << 20,
            idle_timeout: 3600.0,
            max_grace: 300.0,
            threads: 1,
        }
    }
}
