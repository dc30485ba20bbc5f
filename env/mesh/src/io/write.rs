//! Atomic writers.

use super::read::check_regular;
use crate::error::MeshError;
use crate::trimesh::TriMesh;
use std::fmt::Write as _;
use std::io::{Error, ErrorKind, Result, Write as _};
use std::path::{Path, PathBuf};

/// Writes a binary STL in metres (f32; no indices, so welding is lost).
///
/// # Errors
/// [`MeshError::Write`] when the folder is missing, full or read-only.
pub fn write_stl(path: &Path, mesh: &TriMesh) -> std::result::Result<(), MeshError> {
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
pub fn write_obj(path: &Path, mesh: &TriMesh) -> std::result::Result<(), MeshError> {
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

/// Writes `bytes` to a temporary file in the same folder, which then takes the name of `path`: a reader sees the old file or the
/// new one, never a part of it.
///
/// A symbolic link stays, and the file that it names is written. A file that exists keeps its mode; a new one gets the mode
/// that the process's umask leaves of 0666.
///
/// # Errors
/// [`MeshError::Write`] when the folder is missing, full or read-only, or when `path` names a folder, a device, a pipe or a
/// socket.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> std::result::Result<(), MeshError> {
    replace(path, bytes).map_err(|source| MeshError::Write { path: path.to_path_buf(), source })
}

fn replace(path: &Path, bytes: &[u8]) -> Result<()> {
    let target = follow(path)?;
    let mode = match std::fs::metadata(&target) {
        Ok(metadata) if metadata.is_dir() => return Err(ErrorKind::IsADirectory.into()),
        Ok(metadata) => check_regular(&metadata).map(|()| Some(metadata.permissions()))?,
        Err(error) if error.kind() == ErrorKind::NotFound => None,
        Err(error) => return Err(error),
    };
    let folder = target.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file = temporary(folder)?;
    if let Some(mode) = mode {
        file.as_file().set_permissions(mode)?;
    }
    file.write_all(bytes)?;
    file.persist(&target).map_err(|e| e.error)?;
    Ok(())
}

/// The path at the end of a chain of symbolic links; the last one need not exist.
fn follow(path: &Path) -> Result<PathBuf> {
    /// As many links as Linux follows.
    const MOST: usize = 40;
    let mut target = path.to_path_buf();
    for _ in 0..MOST {
        if !std::fs::symlink_metadata(&target).is_ok_and(|m| m.is_symlink()) {
            return Ok(target);
        }
        let link = std::fs::read_link(&target)?;
        target = target.parent().map_or_else(|| link.clone(), |folder| folder.join(&link));
    }
    Err(Error::other("too many symbolic links"))
}

#[cfg(unix)]
fn temporary(folder: &Path) -> Result<tempfile::NamedTempFile> {
    use std::os::unix::fs::PermissionsExt;
    // The system takes the umask off; the default of `tempfile` is 0600.
    tempfile::Builder::new().permissions(std::fs::Permissions::from_mode(0o666)).tempfile_in(folder)
}

#[cfg(not(unix))]
fn temporary(folder: &Path) -> Result<tempfile::NamedTempFile> {
    tempfile::NamedTempFile::new_in(folder)
}
