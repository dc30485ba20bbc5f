//! Certificates and keys in PEM files.

use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer};
use std::fmt::Display;
use std::io;

/// An unusable PEM file.
#[derive(Debug, thiserror::Error)]
pub enum PemError {
    /// It cannot be read.
    #[error("{path}: {source}")]
    Unreadable {
        path: String,
        /// The system's error.
        source: io::Error,
    },
    /// It has other contents.
    #[error("{path}: {why}")]
    Wrong { path: String, why: String },
}

fn read(path: &str) -> Result<Vec<u8>, PemError> {
    std::fs::read(path).map_err(|source| PemError::Unreadable { path: path.to_owned(), source })
}

/// An error about the contents of a file.
pub fn wrong(path: &str, why: impl Display) -> PemError {
    PemError::Wrong { path: path.to_owned(), why: why.to_string() }
}

/// The certificates of a file, at least one.
///
/// # Errors
/// An unreadable file, or one without a certificate.
pub fn certificates(path: &str) -> Result<Vec<CertificateDer<'static>>, PemError> {
    let found = CertificateDer::pem_slice_iter(&read(path)?).collect::<Result<Vec<_>, _>>();
    let found = found.map_err(|error| wrong(path, format!("it is no file of certificates in PEM: {error}")))?;
    if found.is_empty() { Err(wrong(path, "it holds no certificate in PEM")) } else { Ok(found) }
}

/// The first private key of a file.
///
/// # Errors
/// An unreadable file, or one without a key.
pub fn private_key(path: &str) -> Result<PrivateKeyDer<'static>, PemError> {
    PrivateKeyDer::from_pem_slice(&read(path)?)
        .map_err(|error| wrong(path, format!("it holds no private key in PEM: {error}")))
}
