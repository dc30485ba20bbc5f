//! Files: STL (binary, ASCII), PLY (ASCII, both binaries), OBJ, OFF, glTF (GLB, JSON) to [`TriMesh`], and STL, OBJ back.
//!
//! | module | purpose |
//! |---|---|
//! | `format` | formats, limits, and the output of a parser |
//! | `read` | bounded reads of regular files |
//! | `stl` | both kinds, distinguished by size, not by the word "solid" |
//! | `ply` | vertices and polygons, everything else skipped |
//! | `obj` | geometry of all groups; materials, lines and points ignored |
//! | `off` | OFF, COFF, NOFF text |
//! | `gltf` | the triangles of a scene, in their places |
//! | `text` | lines of numbers, and errors that name the line |
//! | `sniff` | the apparent format of a file with the wrong ending |
//! | [`write`] | atomic writers |
//!
//! Headers may be wrong: every count is compared with the caller's limits and with the size of the file before anything is
//! allocated. The parsers run on a bounded copy of the file in memory; a panic inside one becomes an error. Several solids,
//! objects or meshes of a file become one mesh; data that belongs to none of them is an error.

mod format;
mod gltf;
mod obj;
mod off;
mod ply;
mod read;
mod sniff;
mod stl;
mod text;
mod write;

pub use format::{LoadOptions, MeshFormat};
pub use read::read_bounded;
pub use write::{write_atomic, write_obj, write_stl};

use crate::error::MeshError;
use crate::trimesh::TriMesh;
use format::{Raw, check_count, check_size};
use std::panic::AssertUnwindSafe;
use std::path::Path;

/// Reads a mesh file; its ending names the format.
///
/// Returns the mesh in metres, in the frame of the file. STL corners with the same bits become one vertex; nothing else is
/// merged or repaired (see [`crate::clean()`]). Polygons become fans of triangles.
///
/// # Errors
/// [`MeshError::Io`], [`MeshError::UnknownFormat`], and those of [`parse`].
pub fn load(path: &Path, options: &LoadOptions) -> Result<TriMesh, MeshError> {
    let format = MeshFormat::from_path(path).ok_or_else(|| MeshError::UnknownFormat { path: path.to_path_buf() })?;
    let io = |source| MeshError::Io { path: path.to_path_buf(), source };
    check_size(format, std::fs::metadata(path).map_err(io)?.len(), options)?;
    parse_in(Some(path), &read_bounded(path, options.max_bytes).map_err(io)?, format, options)
}

/// Reads a mesh from the bytes of a file; a glTF file must hold all of its buffers.
///
/// # Errors
/// A sentence about the problem: too large, truncated, malformed, of another format, empty, not finite, absurdly large or
/// small, or with faces that are no polygons.
pub fn parse(bytes: &[u8], format: MeshFormat, options: &LoadOptions) -> Result<TriMesh, MeshError> {
    parse_in(None, bytes, format, options)
}

fn parse_in(
    path: Option<&Path>,
    bytes: &[u8],
    format: MeshFormat,
    options: &LoadOptions,
) -> Result<TriMesh, MeshError> {
    if !(options.scale.is_finite() && options.scale > 0.0) {
        return Err(MeshError::BadScale { scale: options.scale });
    }
    check_size(format, bytes.len() as u64, options)?;
    if bytes.is_empty() {
        return Err(MeshError::Truncated { format: format.name(), detail: "it has no bytes".into() });
    }
    // A byte-order mark (of UTF-8) would be taken for part of the first word.
    let content = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let read = || match format {
        MeshFormat::Stl => stl::parse(content, options),
        MeshFormat::Ply => ply::parse(content, options),
        MeshFormat::Obj => obj::parse(content, options),
        MeshFormat::Off => off::parse(content, options),
        MeshFormat::Gltf => gltf::parse(content, path.and_then(Path::parent), options),
    };
    // The parsers are not ours, and a hostile file must not end the process.
    let raw = std::panic::catch_unwind(AssertUnwindSafe(read)).unwrap_or_else(|_| {
        Err(MeshError::Malformed { format: format.name(), detail: "the parser gave up on it".into() })
    });
    raw.and_then(|raw| finish(raw, path, format, options)).map_err(|error| match sniff::looks_like(content, format) {
        Some(found) if is_about_format(&error) => MeshError::WrongFormat { format: format.name(), found },
        _ => error,
    })
}

fn finish(mut raw: Raw, path: Option<&Path>, format: MeshFormat, options: &LoadOptions) -> Result<TriMesh, MeshError> {
    if raw.edges > 0 {
        raw.notes.push(format!("faces with fewer than 3 corners are left out: {}", raw.edges));
    }
    for note in &raw.notes {
        tracing::warn!("{}: {note}", path.map_or_else(|| format.name().into(), |path| format!("`{}`", path.display())));
    }
    check_count(format, "vertices", raw.vertices.len() as u64, options.max_vertices)?;
    check_count(format, "triangles", raw.faces.len() as u64, options.max_faces)?;
    let mesh = TriMesh::new(raw.vertices, raw.faces)?;
    let mesh = if options.scale == 1.0 { mesh } else { mesh.scaled(options.scale) };
    mesh.check_extent()?;
    Ok(mesh)
}

/// Whether a file of another format may be behind the error.
fn is_about_format(error: &MeshError) -> bool {
    use MeshError::{Empty, Malformed, TooMany, Truncated};
    matches!(error, Empty | Malformed { .. } | TooMany { .. } | Truncated { .. })
}
