//! Files: STL (binary, ASCII), PLY (ASCII, both binaries), OBJ, OFF to [`TriMesh`], and STL, OBJ back.
//!
//! | module | what it reads |
//! |---|---|
//! | `stl` | both kinds, told apart by size, not by the word "solid" |
//! | `ply` | vertices and polygons, everything else skipped |
//! | `obj` | geometry of all groups; materials, lines and points ignored |
//! | `off` | OFF, COFF, NOFF text |
//! | [`write`] | atomic writers |
//!
//! Headers lie: every count is held against the caller's limits and against the bytes that are there before anything is
//! allocated. The parsers run on a bounded copy of the file in memory; a panic inside one becomes an error.

mod obj;
mod off;
mod ply;
mod stl;
mod write;

pub(crate) use write::write_atomic;
pub use write::{write_obj, write_stl};

use crate::{MeshError, TriMesh};
use nalgebra::Point3;
use serde::{Deserialize, Serialize};
use std::io::Read;
use std::panic::AssertUnwindSafe;
use std::path::Path;

/// Farthest coordinate from the origin, metres: no graspable object is a kilometre away; millimetre files read as metres are.
const MAX_COORDINATE: f64 = 1e3;
/// Least longest side, metres: below a micrometre nothing can be grasped and f32 collision queries break down.
const MIN_EXTENT: f64 = 1e-6;

/// The formats that are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// Stereolithography, binary or ASCII.
    Stl,
    /// Polygon file format, ASCII or binary of either byte order.
    Ply,
    /// Wavefront.
    Obj,
    /// Object file format, text.
    Off,
}

impl MeshFormat {
    /// The format that the ending of `path` names, in any case.
    pub fn from_path(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "stl" => Some(Self::Stl),
            "ply" => Some(Self::Ply),
            "obj" => Some(Self::Obj),
            "off" => Some(Self::Off),
            _ => None,
        }
    }

    /// Its name, as errors spell it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Stl => "STL",
            Self::Ply => "PLY",
            Self::Obj => "OBJ",
            Self::Off => "OFF",
        }
    }
}

/// How a file is read, and how much of it at most.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LoadOptions {
    /// Metres in one unit of the file: 1 for metres, 0.001 for millimetres.
    pub scale: f64,
    /// Largest file, bytes.
    pub max_bytes: u64,
    /// Most vertices.
    pub max_vertices: u64,
    /// Most triangles, after polygons have been cut into triangles.
    pub max_faces: u64,
}

impl Default for LoadOptions {
    /// Metres; 256 MiB, 4 million vertices and triangles (a scanned object has 10^4 to 10^6).
    fn default() -> Self {
        Self { scale: 1.0, max_bytes: 256 << 20, max_vertices: 4_000_000, max_faces: 4_000_000 }
    }
}

/// Vertices and faces as a parser found them: in the file's unit, not yet checked.
#[derive(Default)]
pub(crate) struct Raw {
    pub vertices: Vec<Point3<f64>>,
    pub faces: Vec<[u32; 3]>,
}

impl Raw {
    /// Cuts a polygon into the fan of triangles around its first corner.
    pub fn push_polygon(
        &mut self,
        format: MeshFormat,
        face: usize,
        corners: &[u32],
        options: &LoadOptions,
    ) -> Result<(), MeshError> {
        if corners.len() < 3 {
            return Err(MeshError::NotTriangles { format: format.name(), face, corners: corners.len() });
        }
        check_count(format, "triangles", (self.faces.len() + corners.len() - 2) as u64, options.max_faces)?;
        self.faces.extend(corners[1..].windows(2).map(|w| [corners[0], w[0], w[1]]));
        Ok(())
    }
}

/// Reads a mesh file; its ending names the format.
///
/// Returns the mesh in metres, in the frame of the file. STL corners with the same bits become one vertex; nothing else is
/// merged or repaired (see [`crate::clean()`]). Polygons become fans of triangles.
///
/// # Errors
/// [`MeshError::Io`], [`MeshError::UnknownFormat`], and everything that [`parse`] says.
pub fn load(path: &Path, options: &LoadOptions) -> Result<TriMesh, MeshError> {
    let format = MeshFormat::from_path(path).ok_or_else(|| MeshError::UnknownFormat { path: path.to_path_buf() })?;
    let io = |source| MeshError::Io { path: path.to_path_buf(), source };
    let file = std::fs::File::open(path).map_err(io)?;
    let size = file.metadata().map_err(io)?.len();
    check_size(format, size, options)?;
    let mut bytes = Vec::new();
    // The file may grow while it is read, or be a device without a size.
    file.take(options.max_bytes.saturating_add(1)).read_to_end(&mut bytes).map_err(io)?;
    parse(&bytes, format, options)
}

/// Reads a mesh from the bytes of a file.
///
/// # Errors
/// A sentence about what is wrong: too large, truncated, malformed, empty, not finite, absurdly large or small, or with faces
/// that are no polygons.
pub fn parse(bytes: &[u8], format: MeshFormat, options: &LoadOptions) -> Result<TriMesh, MeshError> {
    if !(options.scale.is_finite() && options.scale > 0.0) {
        return Err(MeshError::BadScale { scale: options.scale });
    }
    check_size(format, bytes.len() as u64, options)?;
    if bytes.is_empty() {
        return Err(MeshError::Truncated { format: format.name(), detail: "it has no bytes".into() });
    }
    let read = || match format {
        MeshFormat::Stl => stl::parse(bytes, options),
        MeshFormat::Ply => ply::parse(bytes, options),
        MeshFormat::Obj => obj::parse(bytes, options),
        MeshFormat::Off => off::parse(bytes, options),
    };
    // The last line of defence: the parsers are not ours, and a hostile file must not take the process down.
    let raw = std::panic::catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| {
        Err(MeshError::Malformed { format: format.name(), detail: "the parser gave up on it".into() })
    })?;
    finish(raw, format, options)
}

fn finish(raw: Raw, format: MeshFormat, options: &LoadOptions) -> Result<TriMesh, MeshError> {
    check_count(format, "vertices", raw.vertices.len() as u64, options.max_vertices)?;
    check_count(format, "triangles", raw.faces.len() as u64, options.max_faces)?;
    let mesh = TriMesh::new(raw.vertices, raw.faces)?;
    let mesh = if options.scale == 1.0 { mesh } else { mesh.scaled(options.scale) };
    let aabb = mesh.aabb();
    let value = aabb.min.coords.amax().max(aabb.max.coords.amax());
    // An overflow to infinity under `scale` is caught too.
    if value.is_nan() || value > MAX_COORDINATE {
        return Err(MeshError::TooFar { value, limit: MAX_COORDINATE });
    }
    let extent = (aabb.max - aabb.min).amax();
    if extent < MIN_EXTENT {
        return Err(MeshError::TooSmall { extent, limit: MIN_EXTENT });
    }
    Ok(mesh)
}

fn check_size(format: MeshFormat, bytes: u64, options: &LoadOptions) -> Result<(), MeshError> {
    if bytes > options.max_bytes {
        return Err(MeshError::FileTooLarge { format: format.name(), bytes, limit: options.max_bytes });
    }
    Ok(())
}

/// Holds a count against its limit.
pub(crate) fn check_count(format: MeshFormat, what: &'static str, count: u64, limit: u64) -> Result<(), MeshError> {
    // Indices are u32, whatever the caller allows.
    let limit = limit.min(u64::from(u32::MAX));
    if count > limit {
        return Err(MeshError::TooMany { format: format.name(), what, count, limit });
    }
    Ok(())
}
