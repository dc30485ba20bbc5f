//! Memory shared by server and client on one machine: a file of the system's memory file system.
//!
//! Arrays are written and read with system calls, which copy once on each side, so that neither needs mappings and `unsafe`.

use std::fs::{File, OpenOptions, remove_file};
use std::io;
use std::os::unix::fs::{FileExt, OpenOptionsExt};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

/// Directory of the memory file system.
const FOLDER: &str = "/dev/shm";
/// Smaller arrays are sent in the frame, which is faster for them.
pub const LEAST: usize = 4096;

/// A server's segment of shared memory.
pub struct Segment {
    file: File,
    name: String,
    capacity: u64,
    removed: AtomicBool,
}

fn path(name: &str) -> PathBuf {
    PathBuf::from(FOLDER).join(name)
}

impl Segment {
    /// A new segment of at most `capacity` bytes that only this user may open.
    ///
    /// # Errors
    /// A system without such memory, or without room.
    pub fn create(number: u64, capacity: usize) -> io::Result<Self> {
        let name = format!("graspbox-{number:016x}");
        let mut options = OpenOptions::new();
        let file = options.read(true).write(true).create_new(true).mode(0o600).open(path(&name))?;
        Ok(Self { file, name, capacity: capacity as u64, removed: AtomicBool::new(false) })
    }

    /// Its name, by which a client opens it.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Unlinks the name once the client has opened it, so that nothing is left if either side dies.
    pub fn opened(&self) {
        if !self.removed.swap(true, Ordering::AcqRel) {
            drop(remove_file(path(&self.name)));
        }
    }

    /// Writes bytes at an offset.
    ///
    /// # Errors
    /// Data beyond its capacity, or a system without free memory.
    pub fn write(&self, bytes: &[u8], offset: u64) -> io::Result<()> {
        if offset + bytes.len() as u64 > self.capacity {
            return Err(io::ErrorKind::FileTooLarge.into());
        }
        self.file.write_all_at(bytes, offset)
    }
}

impl Drop for Segment {
    fn drop(&mut self) {
        self.opened();
    }
}

/// Opens the segment named by a server.
///
/// # Errors
/// An invalid name, or a server on another machine or of another user.
pub fn open(name: &str) -> io::Result<File> {
    if !name.starts_with("graspbox-") || name.contains(['/', '.']) {
        return Err(io::ErrorKind::InvalidInput.into());
    }
    File::open(path(name))
}

/// Reads bytes of a segment.
///
/// # Errors
/// A range beyond its end.
pub fn read(file: &File, bytes: &mut [u8], offset: u64) -> io::Result<()> {
    file.read_exact_at(bytes, offset)
}
