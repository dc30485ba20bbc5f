//! Inputs that the comparisons share: procedural objects, and the YCB meshes of a folder.

use graspbox_mesh::{CleanOptions, LoadOptions, MeshError, TriMesh, clean, load};
use graspbox_objects::{Family, generate};
use std::path::{Path, PathBuf};

/// A named mesh.
pub type Named = (String, TriMesh);

/// The folder of STL files that the first argument names; without one, only procedural objects are compared.
pub fn folder() -> Option<PathBuf> {
    std::env::args_os().nth(1).map(PathBuf::from)
}

/// The cleaned meshes of a folder's STL files, ordered by name; `only` keeps those whose name contains one of its words.
///
/// # Errors
/// Those of [`load`], and [`MeshError::Io`] for a folder that cannot be listed.
pub fn scanned(folder: &Path, only: &[&str]) -> Result<Vec<Named>, MeshError> {
    let io = |source| MeshError::Io { path: folder.to_path_buf(), source };
    let entries: Result<Vec<_>, _> = std::fs::read_dir(folder).map_err(io)?.collect();
    let mut paths: Vec<PathBuf> = entries.map_err(io)?.into_iter().map(|e| e.path()).collect();
    paths.retain(|p| p.extension().is_some_and(|e| e == "stl"));
    paths.sort();
    let name = |p: &Path| p.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    paths.retain(|p| only.is_empty() || only.iter().any(|word| name(p).contains(word)));
    let cleaned = |p: &PathBuf| {
        let mesh = load(p, &LoadOptions::default())?;
        Ok((name(p), clean(&mesh, &CleanOptions::default())?.0))
    };
    paths.iter().map(cleaned).collect()
}

/// Objects of the families with these seeds.
///
/// # Errors
/// Those of [`generate`].
pub fn procedural(families: &[Family], seeds: std::ops::Range<u64>) -> Result<Vec<Named>, MeshError> {
    let pairs = families.iter().flat_map(|f| seeds.clone().map(move |s| (*f, s)));
    pairs.map(|(f, s)| generate(f, s).map(|o| (o.name, o.mesh))).collect()
}
