//! Writers. A reader never sees half a file: bytes go to a temporary neighbour, which then takes the name.

use crate::{MeshError, TriMesh};
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

/// Writes a binary STL in metres (f32; no indices, so welding is lost).
///
/// # Errors
/// [`MeshError::Write`] when the folder is missing, full or read-only.
pub fn write_stl(path: &Path, mesh: &TriMesh) -> Result<(), MeshError> {
    let triangle = |face: usize| {
        let normal = mesh.face_area_vector(face).try_normalize(0.0).unwrap_or_default();
        stl_io::Triangle {
            normal: stl_io::Normal::new(normal.map(|x| x as f32).into()),
            vertices: mesh.triangle(face).map(|p| stl_io::Vertex::new(p.coords.map(|x| x as f32).into())),
        }
    };
    let triangles: Vec<_> = (0..mesh.faces().len()).map(triangle).collect();
    let mut bytes = Vec::with_capacity(84 + 50 * triangles.len());
    stl_io::write_stl(&mut bytes, triangles.iter())
        .map_err(|source| MeshError::Write { path: path.to_path_buf(), source })?;
    write_atomic(path, &bytes)
}

/// Writes an OBJ in metres; every coordinate reads back with the same bits.
///
/// # Errors
/// [`MeshError::Write`] when the folder is missing, full or read-only.
pub fn write_obj(path: &Path, mesh: &TriMesh) -> Result<(), MeshError> {
    let mut text = String::new();
    for p in mesh.vertices() {
        // Rust prints the shortest decimal that reads back as the same f64. Writing to a String cannot fail.
        let _ = writeln!(text, "v {} {} {}", p.x, p.y, p.z);
    }
    for [a, b, c] in mesh.faces().iter().map(|f| f.map(|v| v as u64 + 1)) {
        let _ = writeln!(text, "f {a} {b} {c}");
    }
    write_atomic(path, text.as_bytes())
}

/// Writes `bytes` to a temporary file in the same folder and renames it to `path`.
pub(crate) fn write_atomic(path: &Path, bytes: &[u8]) -> Result<(), MeshError> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let write = || {
        let mut file = tempfile::NamedTempFile::new_in(folder)?;
        file.write_all(bytes)?;
        file.persist(path).map_err(|e| e.error)?;
        Ok(())
    };
    write().map_err(|source| MeshError::Write { path: path.to_path_buf(), source })
}
