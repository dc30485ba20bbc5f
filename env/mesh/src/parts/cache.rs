//! Convex parts on disk.

use super::params::PartsParams;
use crate::cache::bytes::{Reader, put_mesh, put_u32};
use crate::cache::{Entry, Kind, MOST_OF_MESHES};
use crate::trimesh::TriMesh;
use std::path::Path;

/// At most 100 times the size of 48 parts of 64 corners.
static KIND: Kind =
    Kind { what: "parts", suffix: "parts", magic: b"gbparts4", max_bytes: 16 << 20, most_in_all: MOST_OF_MESHES };

pub(super) fn entry(folder: &Path, mesh: &TriMesh, params: &PartsParams) -> Entry {
    let PartsParams { max_error, max_parts, max_points, max_nodes } = *params;
    let mut settings = vec![max_error.to_bits(), max_parts as u64, max_points as u64];
    // Entries of before this setting stay valid.
    settings.extend((max_nodes != PartsParams::default().max_nodes).then_some(max_nodes as u64));
    Entry::of_mesh(folder, &KIND, mesh, &settings)
}

/// The parts that an entry holds.
pub(super) fn read(entry: &Entry) -> Option<Vec<TriMesh>> {
    entry.read(|body| {
        let mut reader = Reader(body);
        let parts: Vec<TriMesh> = (0..reader.u32()?).map(|_| reader.mesh()).collect::<Option<_>>()?;
        reader.end(parts).filter(|parts| !parts.is_empty())
    })
}

pub(super) fn encode(parts: &[TriMesh]) -> Vec<u8> {
    let mut body = Vec::new();
    put_u32(&mut body, parts.len());
    parts.iter().for_each(|part| put_mesh(&mut body, part));
    body
}
