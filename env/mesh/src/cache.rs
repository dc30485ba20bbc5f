//! Expensive results on disk: by the BLAKE3 hash of input, parameters and format.
//!
//! | module | purpose |
//! |---|---|
//! | `bytes` | meshes as bytes |
//! | `trim` | a bound on the size of a folder |
//!
//! An entry begins with that hash, so the result of another input under its name is noticed; the whole is sealed with a checksum. It is
//! written to a temporary neighbour and renamed, so readers in other processes see all of it or nothing. An entry that does not read back is
//! a warning and is made again; a folder that cannot be written, or a full disk, is a warning and costs only time. Beyond the bound of its
//! kind ([`Kind::most_in_all`]) the oldest entries of a folder are removed.

pub mod bytes;
mod trim;

use crate::checksum::{open, seal};
use crate::io::{read_bounded, write_atomic};
use crate::trimesh::TriMesh;
use std::path::{Path, PathBuf};
use trim::after_write;

/// [`Kind::most_in_all`] of meshes: about 1,200 YCB objects with levels of detail, twice as many without.
pub const MOST_OF_MESHES: u64 = 1 << 30;

/// Bytes that stand for all of `bytes` in an input.
pub fn digest(bytes: &[u8]) -> [u8; 32] {
    *blake3::hash(bytes).as_bytes()
}

/// A kind of result.
pub struct Kind {
    /// Its name in warnings, a plural.
    pub what: &'static str,
    /// A suffix that no other kind has; one of `trim::SUFFIXES`.
    pub suffix: &'static str,
    /// Leads every entry; its number changes whenever the format or the algorithm does.
    pub magic: &'static [u8; 8],
    /// Largest entry that is read, bytes.
    pub max_bytes: u64,
    /// Most bytes of all entries of a folder, of every kind.
    pub most_in_all: u64,
}

/// The entry of one input.
pub struct Entry {
    kind: &'static Kind,
    key: [u8; 32],
    path: PathBuf,
}

impl Entry {
    /// * `input`: everything that the result depends on, as bytes.
    pub fn new(folder: &Path, kind: &'static Kind, input: &[u8]) -> Self {
        let key = blake3::Hasher::new().update(kind.magic).update(input).finalize();
        Self { kind, key: *key.as_bytes(), path: folder.join(format!("{}.{}", key.to_hex(), kind.suffix)) }
    }

    /// * `parameters`: the bits of everything else that the result depends on.
    pub(crate) fn of_mesh(folder: &Path, kind: &'static Kind, mesh: &TriMesh, parameters: &[u64]) -> Self {
        let parameters = parameters.iter().flat_map(|bits| bits.to_le_bytes());
        Self::new(folder, kind, &mesh.content_hash().into_iter().chain(parameters).collect::<Vec<_>>())
    }

    /// Whether there is an entry, which may be damaged.
    pub fn exists(&self) -> bool {
        self.path.is_file()
    }

    /// The stored value; `None` if there is none, the entry is damaged or of another input, or `decode` cannot read it.
    pub fn read<T>(&self, decode: impl FnOnce(&[u8]) -> Option<T>) -> Option<T> {
        let (path, what) = (self.path.display(), self.kind.what);
        let bytes = match read_bounded(&self.path, self.kind.max_bytes) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return None,
            Err(e) => {
                tracing::warn!("cannot read the cached {what} {path}: {e}; they are made again");
                return None;
            }
        };
        let Ok(body) = open(self.kind.magic, &bytes) else {
            tracing::warn!("the cached {what} {path} are damaged; they are made again");
            return None;
        };
        let found = body.strip_prefix(&self.key).and_then(decode);
        if found.is_none() {
            tracing::warn!("the cached {what} {path} are those of another input; they are made again");
        }
        found
    }

    /// Stores a result; a failure is a warning.
    pub fn write(&self, body: &[u8]) {
        let what = self.kind.what;
        let made = self.path.parent().map_or(Ok(()), std::fs::create_dir_all);
        if let Err(e) = made {
            tracing::warn!("cannot make the folder of {}: {e}; the {what} are not cached", self.path.display());
        } else if let Err(e) = write_atomic(&self.path, &seal(self.kind.magic, &[&self.key, body].concat())) {
            tracing::warn!("{e}; the {what} are not cached");
        } else if let Some(folder) = self.path.parent() {
            after_write(folder, self.kind.most_in_all);
        }
    }
}
