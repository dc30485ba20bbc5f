//! Bytes with a magic number and a checksum: cache entries, snapshots, saved states.
//!
//! The layout is 8 bytes that name kind and version, the BLAKE3 hash of the body, the body.
//!
//! ```
//! use graspbox_mesh::checksum::{open, seal};
//!
//! let bytes = seal(b"example1", b"body");
//! assert_eq!(open(b"example1", &bytes).unwrap(), b"body");
//! assert!(open(b"example2", &bytes).is_err());
//! assert!(open(b"example1", &bytes[..bytes.len() - 1]).is_err());
//! ```

/// Bytes of the hash.
const HASH: usize = 32;

/// Why sealed bytes cannot be opened.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ChecksumError {
    /// Another magic number.
    #[error("it is of another kind or version")]
    Version,
    /// Fewer bytes than a header has.
    #[error("it is too short")]
    Short,
    /// The hash is not that of the body.
    #[error("its checksum does not match; it was cut off or changed")]
    Mismatch,
}

/// The body behind `magic` and its checksum.
pub fn seal(magic: &[u8; 8], body: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(magic.len() + HASH + body.len());
    bytes.extend_from_slice(magic);
    bytes.extend_from_slice(blake3::hash(body).as_bytes());
    bytes.extend_from_slice(body);
    bytes
}

/// The body of bytes that [`seal`] made.
///
/// # Errors
/// [`ChecksumError`] for another magic number, too few bytes, or a body that does not match its checksum.
pub fn open<'a>(magic: &[u8; 8], bytes: &'a [u8]) -> Result<&'a [u8], ChecksumError> {
    let rest = bytes.strip_prefix(magic).ok_or(ChecksumError::Version)?;
    let (sum, body) = rest.split_at_checked(HASH).ok_or(ChecksumError::Short)?;
    (blake3::hash(body).as_bytes() == sum).then_some(body).ok_or(ChecksumError::Mismatch)
}
