//! Access control: tokens and origins.

use axum::http::HeaderMap;
use axum::http::header::{AUTHORIZATION, HOST, ORIGIN, SEC_WEBSOCKET_PROTOCOL};

/// Browsers cannot set the header `Authorization`; a page sends the token as a subprotocol with this prefix.
const TOKEN_PROTOCOL: &str = "graspbox.token.";

/// Access control.
pub struct Gate {
    token: Option<blake3::Hash>,
    origins: Vec<String>,
}

impl Gate {
    /// Admits clients with the token (all clients if there is none), and browser pages of the origins or of the server's own host.
    pub fn new(token: Option<&str>, origins: &[String]) -> Self {
        Self { token: token.map(|token| blake3::hash(token.as_bytes())), origins: origins.to_vec() }
    }

    /// Checks the headers of a request.
    ///
    /// # Errors
    /// The reason, for the metrics: `token` or `origin`.
    pub fn admits(&self, headers: &HeaderMap) -> Result<(), &'static str> {
        if let Some(origin) = headers.get(ORIGIN) {
            let origin = origin.to_str().unwrap_or_default();
            let own = headers.get(HOST).and_then(|host| host.to_str().ok()).unwrap_or_default();
            let same = origin.split_once("://").is_some_and(|(_, host)| host == own && is_local(host));
            if !same && !self.origins.iter().any(|known| known == origin) {
                return Err("origin");
            }
        }
        let Some(token) = &self.token else {
            return Ok(());
        };
        // Hashes are compared in constant time.
        if given(headers).iter().any(|given| blake3::hash(given.as_bytes()) == *token) { Ok(()) } else { Err("token") }
    }
}

/// A host that no foreign name can resolve to.
fn is_local(host: &str) -> bool {
    let name = host.rsplit_once(':').map_or(host, |(name, _)| name);
    matches!(name, "localhost" | "127.0.0.1" | "[::1]")
}

/// The tokens sent by a client.
fn given(headers: &HeaderMap) -> Vec<&str> {
    let header = headers.get(AUTHORIZATION).and_then(|value| value.to_str().ok()).unwrap_or_default();
    let schemes = ["Api-Key ", "Bearer "];
    let mut found: Vec<&str> = schemes.iter().filter_map(|scheme| header.strip_prefix(scheme)).collect();
    let protocols = headers.get_all(SEC_WEBSOCKET_PROTOCOL).iter().filter_map(|value| value.to_str().ok());
    let named = protocols.flat_map(|value| value.split(',')).map(str::trim);
    found.extend(named.filter_map(|protocol| protocol.strip_prefix(TOKEN_PROTOCOL)));
    found
}
