//! Levels of detail on disk.

use super::distance::{Decimated, Hausdorff};
use crate::cache::bytes::{Reader, put_f64, put_mesh, put_u32};
use crate::cache::{Entry, Kind, MOST_OF_MESHES};
use crate::trimesh::TriMesh;
use std::path::Path;

/// At most 60 times the size of levels of 8,192 faces and fewer.
static KIND: Kind = Kind {
    what: "levels of detail",
    suffix: "levels",
    magic: b"gblevel1",
    max_bytes: 32 << 20,
    most_in_all: MOST_OF_MESHES,
};

pub(super) fn entry(folder: &Path, mesh: &TriMesh, targets: &[usize]) -> Entry {
    let targets: Vec<u64> = targets.iter().map(|target| *target as u64).collect();
    Entry::of_mesh(folder, &KIND, mesh, &targets)
}

/// The levels that an entry holds; there may be none.
pub(super) fn read(entry: &Entry) -> Option<Vec<Decimated>> {
    entry.read(|body| {
        let mut reader = Reader(body);
        let level = |reader: &mut Reader| {
            let (max, mean, samples) = (reader.f64()?, reader.f64()?, reader.u32()? as usize);
            Some(Decimated { hausdorff: Hausdorff { max, mean, samples }, mesh: reader.mesh()? })
        };
        let levels: Vec<Decimated> = (0..reader.u32()?).map(|_| level(&mut reader)).collect::<Option<_>>()?;
        reader.end(levels)
    })
}

pub(super) fn encode(levels: &[Decimated]) -> Vec<u8> {
    let mut body = Vec::new();
    put_u32(&mut body, levels.len());
    for level in levels {
        put_f64(&mut body, level.hausdorff.max);
        put_f64(&mut body, level.hausdorff.mean);
        put_u32(&mut body, level.hausdorff.samples);
        put_mesh(&mut body, &level.mesh);
    }
    body
}
