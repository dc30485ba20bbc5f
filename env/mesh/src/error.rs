//! Every way a mesh or object set can be wrong; each variant is a sentence about the input.

use std::path::PathBuf;

/// What is wrong with a mesh or an object set.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// The file could not be opened or read.
    #[error("cannot read {path}: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} is not finite; repair the mesh or drop that vertex")]
    NotFinite {
        /// Index of the vertex.
        vertex: usize,
    },
    /// A face names a vertex that does not exist.
    #[error("face {face} names vertex {vertex}, but the mesh has only {count} vertices")]
    BadIndex {
        /// Index of the face.
        face: usize,
        /// The vertex it names.
        vertex: u32,
        /// How many vertices there are.
        count: usize,
    },
    /// No triangle is left to work with.
    #[error("the mesh has no triangles")]
    Empty,
}
