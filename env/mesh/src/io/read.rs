//! Bounded reads of regular files.

use std::fs::{File, Metadata};
use std::io::{Error, ErrorKind, Read, Result};
use std::path::Path;

/// Reads at most `max_bytes + 1` bytes of a regular file, so that a caller can detect a file that exceeds its limit.
///
/// Devices, pipes and sockets are refused before they are opened: opening a pipe or reading a device may never return.
/// Symbolic links are followed.
///
/// # Errors
/// Those of the system, and [`ErrorKind::InvalidInput`] for anything but a regular file.
pub fn read_bounded(path: &Path, max_bytes: u64) -> Result<Vec<u8>> {
    check_regular(&std::fs::metadata(path)?)?;
    let file = File::open(path)?;
    let metadata = file.metadata()?;
    // Another file may have taken the name since.
    check_regular(&metadata)?;
    let size = metadata.len().min(max_bytes);
    let mut bytes = Vec::new();
    bytes.try_reserve_exact(usize::try_from(size).unwrap_or(usize::MAX).saturating_add(1))?;
    // The file may grow while it is read.
    file.take(max_bytes.saturating_add(1)).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Refuses devices, pipes and sockets. A folder passes: opening or reading it gives the system's own error.
pub(super) fn check_regular(metadata: &Metadata) -> Result<()> {
    if metadata.is_file() || metadata.is_dir() {
        return Ok(());
    }
    Err(Error::new(ErrorKind::InvalidInput, "it is a device, a pipe or a socket; give a regular file"))
}
