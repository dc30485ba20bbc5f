//! Ways in which a server cannot start.

use crate::pem::PemError;

/// A server that cannot start.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ServerError {
    /// The address cannot be used.
    #[error("cannot listen at {address}: {source}; choose another host or port")]
    Listen {
        /// Host and port.
        address: String,
        /// The system's error.
        source: std::io::Error,
    },
    /// A file of TLS cannot be used.
    #[error(transparent)]
    Pem(#[from] PemError),
    /// Certificate without key, or key without certificate.
    #[error("TLS needs both a certificate and its key; give both tls_cert and tls_key (--tls-cert, --tls-key)")]
    HalfTls,
    /// A setting out of its range.
    #[error(transparent)]
    OutOfRange(#[from] graspbox_mesh::OutOfRange),
    /// Threads cannot be started.
    #[error("cannot start threads: {0}")]
    Threads(String),
}
