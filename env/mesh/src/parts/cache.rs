//! Convex parts on disk, by the BLAKE3 hash of mesh, parameters and format.
//!
//! An entry begins with that hash, so the parts of another mesh or other parameters under its name are noticed; the whole is
//! sealed with a checksum. It is written to a temporary neighbour and renamed, so readers in other processes see all of it or
//! nothing. An entry that does not read back is a warning and is made again; a folder that cannot be written is a warning and
//! costs time only.

use super::params::{ConvexParts, PartsParams, PartsReport};
use super::trim::after_write;
use crate::checksum::{open, seal};
use crate::io::{read_bounded, write_atomic};
use crate::trimesh::TriMesh;
use nalgebra::Point3;
use std::path::{Path, PathBuf};

/// Leads every entry; the number changes whenever the format or the algorithm does.
const MAGIC: &[u8; 8] = b"gbparts3";
/// Largest entry that is read, bytes: 100 times that of 48 parts of 64 corners.
const MAX_BYTES: u64 = 16 << 20;

/// Most bytes of all entries of a folder: about 5,000 objects.
const MOST_IN_ALL: u64 = 256 << 20;

/// Hash of a mesh and parameters.
type Key = [u8; 32];

/// The entry of one mesh and its parameters.
pub(super) struct Entry {
    key: Key,
    path: PathBuf,
}

impl Entry {
    pub fn new(folder: &Path, mesh: &TriMesh, params: &PartsParams) -> Self {
        let PartsParams { max_error, max_parts, max_points } = params;
        let mut hasher = blake3::Hasher::new();
        hasher.update(MAGIC);
        hasher.update(&mesh.content_hash());
        hasher.update(&max_error.to_bits().to_le_bytes());
        hasher.update(&(*max_parts as u64).to_le_bytes());
        hasher.update(&(*max_points as u64).to_le_bytes());
        let key = hasher.finalize();
        Self { key: *key.as_bytes(), path: folder.join(format!("{}.parts", key.to_hex())) }
    }

    /// The parts; `None` when there are none, or the entry is damaged or of something else.
    pub fn read(&self) -> Option<ConvexParts> {
        let path = self.path.display();
        let bytes = match read_bounded(&self.path, MAX_BYTES) {
            Ok(bytes) => bytes,
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => return None,
            Err(e) => {
                tracing::warn!("cannot read the cached parts {path}: {e}; they are made again");
                return None;
            }
        };
        let Ok(body) = open(MAGIC, &bytes) else {
            tracing::warn!("the cached parts {path} are damaged; they are made again");
            return None;
        };
        let parts = body.strip_prefix(&self.key).and_then(decode);
        if parts.is_none() {
            tracing::warn!("the cached parts {path} are those of another mesh; they are made again");
        }
        parts
    }

    /// Keeps the parts; a failure is a warning.
    pub fn write(&self, parts: &ConvexParts) {
        let made = self.path.parent().map_or(Ok(()), std::fs::create_dir_all);
        if let Err(e) = made {
            tracing::warn!("cannot make the folder of {}: {e}; the parts are not cached", self.path.display());
        } else if let Err(e) = write_atomic(&self.path, &seal(MAGIC, &encode(&self.key, parts))) {
            tracing::warn!("{e}; the parts are not cached");
        } else if let Some(folder) = self.path.parent() {
            after_write(folder, MOST_IN_ALL);
        }
    }
}

fn encode(key: &Key, parts: &ConvexParts) -> Vec<u8> {
    let report = &parts.report;
    let mut body = key.to_vec();
    let mut number = |x: f64| body.extend(x.to_bits().to_le_bytes());
    [report.volume, report.overfill_max, report.overfill_mean, report.underfill_max, report.underfill_mean]
        .into_iter()
        .for_each(&mut number);
    body.extend((parts.parts.len() as u32).to_le_bytes());
    for part in &parts.parts {
        body.extend((part.vertices().len() as u32).to_le_bytes());
        body.extend((part.faces().len() as u32).to_le_bytes());
        body.extend(part.vertices().iter().flat_map(|p| p.coords.iter().flat_map(|x| x.to_bits().to_le_bytes())));
        body.extend(part.faces().iter().flatten().flat_map(|v| v.to_le_bytes()));
    }
    body
}

fn decode(body: &[u8]) -> Option<ConvexParts> {
    let mut reader = Reader(body);
    let [volume, overfill_max, overfill_mean, underfill_max, underfill_mean] =
        [reader.f64()?, reader.f64()?, reader.f64()?, reader.f64()?, reader.f64()?];
    let mut parts = Vec::new();
    for _ in 0..reader.u32()? {
        let (vertices, faces) = (reader.u32()?, reader.u32()?);
        // Collected one by one: a count that lies runs out of bytes before it runs out of memory.
        let vertices: Option<Vec<_>> =
            (0..vertices).map(|_| Some(Point3::new(reader.f64()?, reader.f64()?, reader.f64()?))).collect();
        let faces: Option<Vec<_>> = (0..faces).map(|_| Some([reader.u32()?, reader.u32()?, reader.u32()?])).collect();
        parts.push(TriMesh::new(vertices?, faces?).ok()?);
    }
    let report = PartsReport {
        parts: parts.len(),
        points: parts.iter().map(|p| p.vertices().len()).sum(),
        volume,
        overfill_max,
        overfill_mean,
        underfill_max,
        underfill_mean,
        seconds: 0.0,
        cached: true,
    };
    (reader.0.is_empty() && !parts.is_empty()).then_some(ConvexParts { parts, report })
}

struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.0.split_first_chunk::<N>()?;
        self.0 = rest;
        Some(*head)
    }

    fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    fn f64(&mut self) -> Option<f64> {
        self.take().map(|b| f64::from_bits(u64::from_le_bytes(b)))
    }
}
