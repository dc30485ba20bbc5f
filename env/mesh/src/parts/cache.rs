//! Convex parts on disk, by the BLAKE3 of mesh, parameters and format.
//!
//! An entry is its checksum and then its body; it is written to a temporary neighbour and renamed, so readers in other processes
//! see all of it or nothing. An entry that does not read back is worth a warning and is made again; a folder that cannot be
//! written is worth a warning and costs time only.

use super::{ConvexParts, PartsParams, PartsReport};
use crate::TriMesh;
use crate::io::write_atomic;
use nalgebra::Point3;
use std::path::{Path, PathBuf};

/// Changes whenever the format or the algorithm does, so that old entries are not found any more.
const VERSION: u32 = 2;
/// Bytes of the checksum.
const CHECKSUM: usize = 32;

/// Where the entry of this mesh and these parameters lies.
pub(super) fn entry(folder: &Path, mesh: &TriMesh, params: &PartsParams) -> PathBuf {
    let PartsParams { max_error, max_parts, max_points } = params;
    let mut hasher = blake3::Hasher::new();
    hasher.update(&VERSION.to_le_bytes());
    hasher.update(&mesh.content_hash());
    hasher.update(&max_error.to_bits().to_le_bytes());
    hasher.update(&(*max_parts as u64).to_le_bytes());
    hasher.update(&(*max_points as u64).to_le_bytes());
    folder.join(format!("{}.parts", hasher.finalize().to_hex()))
}

/// The entry at `path`; `None` when there is none or it is damaged.
pub(super) fn read(path: &Path) -> Option<ConvexParts> {
    let bytes = match std::fs::read(path) {
        Ok(bytes) => bytes,
        Err(e) if e.kind() == std::io::ErrorKind::NotFound => return None,
        Err(e) => {
            tracing::warn!("cannot read the cached parts {}: {e}; they are made again", path.display());
            return None;
        }
    };
    let parts = decode(&bytes);
    if parts.is_none() {
        tracing::warn!("the cached parts {} are damaged; they are made again", path.display());
    }
    parts
}

/// Keeps the parts; a failure is a warning.
pub(super) fn write(path: &Path, parts: &ConvexParts) {
    let made = path.parent().map_or(Ok(()), std::fs::create_dir_all);
    if let Err(e) = made {
        tracing::warn!("cannot make the folder of {}: {e}; the parts are not cached", path.display());
    } else if let Err(e) = write_atomic(path, &encode(parts)) {
        tracing::warn!("{e}; the parts are not cached");
    }
}

fn encode(parts: &ConvexParts) -> Vec<u8> {
    let report = &parts.report;
    let mut body = Vec::new();
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
    let mut bytes = blake3::hash(&body).as_bytes().to_vec();
    bytes.append(&mut body);
    bytes
}

fn decode(bytes: &[u8]) -> Option<ConvexParts> {
    let (checksum, body) = bytes.split_at_checked(CHECKSUM)?;
    if blake3::hash(body).as_bytes() != checksum {
        return None;
    }
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
