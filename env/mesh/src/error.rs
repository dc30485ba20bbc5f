//! Errors of meshes and object sets; each variant is a sentence about the input.

use crate::io::MeshFormat;
use crate::range::OutOfRange;
use std::path::PathBuf;

/// A problem of a mesh or an object set.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// The file could not be opened or read.
    #[error("cannot read {path}: {source}")]
    Io {
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// The file could not be written.
    #[error("cannot write {path}: {source}")]
    Write {
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} is not finite; repair the mesh or drop that vertex")]
    NotFinite { vertex: usize },
    /// A face names a vertex that does not exist.
    #[error("face {face} names vertex {vertex}, but the mesh has only {count} vertices")]
    BadIndex {
        face: usize,
        /// The vertex it names.
        vertex: u32,
        /// Number of vertices of the mesh.
        count: usize,
    },
    /// No triangle is left to work with.
    #[error("the mesh has no triangles")]
    Empty,
    /// The ending names no format that we read.
    #[error(
        "{path} does not end in {}; convert it, for example by `python -c \"import trimesh; \
         trimesh.load_mesh('{path}').export('mesh.glb')\"` (pip install trimesh, and pycollada for .dae)",
        MeshFormat::endings().join(", ")
    )]
    UnknownFormat { path: PathBuf },
    /// The file is larger than the caller allows.
    #[error("the {format} file has {bytes} bytes, more than the limit of {limit}; raise max_bytes or decimate it")]
    FileTooLarge {
        format: &'static str,
        /// Its size (or, for a stream, the size at which reading stopped).
        bytes: u64,
        limit: u64,
    },
    /// The file holds, or claims to hold, more items than the caller allows.
    #[error("the {format} file names {count} {what}, more than the limit of {limit}; raise the limit or decimate it")]
    TooMany {
        format: &'static str,
        /// The counted items: vertices, faces, ...
        what: &'static str,
        count: u64,
        limit: u64,
    },
    /// The file is shorter than its header states.
    #[error("the {format} file is truncated: {detail}; copy or download it again")]
    Truncated {
        format: &'static str,
        /// The missing part.
        detail: String,
    },
    /// The file breaks the rules of its format.
    #[error("the {format} file cannot be understood: {detail}")]
    Malformed {
        format: &'static str,
        /// Place and kind of the damage.
        detail: String,
    },
    /// The format of the content differs from the ending.
    #[error("it is named as {format}, but looks like {found}; give it the ending of its format, or convert it")]
    WrongFormat {
        /// The format that the ending names.
        format: &'static str,
        /// The apparent format of the content.
        found: &'static str,
    },
    /// Memory for a result could not be allocated.
    #[error("{bytes} bytes for {what} could not be allocated; choose a lower resolution or free memory")]
    OutOfMemory {
        /// Purpose of the memory.
        what: &'static str,
        /// The requested size.
        bytes: u64,
    },
    /// `scale` is zero, negative or not finite.
    #[error("scale is {scale}; give the positive number of metres in one unit of the file")]
    BadScale { scale: f64 },
    /// The mesh is absurdly large or far away: probably not in metres.
    #[error("a coordinate is {value} m from the origin, more than {limit} m; if it is not in metres, give scale=")]
    TooFar {
        /// The greatest coordinate, metres.
        value: f64,
        /// The greatest one allowed, metres.
        limit: f64,
    },
    /// The mesh is absurdly small: probably not in metres.
    #[error("the mesh measures only {extent} m, less than {limit} m; if it is not in metres, give scale=")]
    TooSmall {
        /// Its longest side, metres.
        extent: f64,
        /// The least one allowed, metres.
        limit: f64,
    },
    /// The points lie in a plane, on a line or in a point, so they bound no solid.
    #[error("the {count} points lie (nearly) in one plane, so they span no volume; give a mesh with thickness")]
    Flat {
        /// Number of points.
        count: usize,
    },
    /// The hull algorithm failed.
    #[error("no convex hull of {count} points could be built ({detail}); clean the mesh first")]
    Hull {
        /// Number of points.
        count: usize,
        /// The message of the algorithm.
        detail: String,
    },
    /// A parameter lies outside its range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// A parameter breaks a rule.
    #[error("{name} is {value}; {rule}")]
    BadParameter {
        /// Name of the parameter.
        name: &'static str,
        value: f64,
        /// The rule, as a sentence.
        rule: &'static str,
    },
    /// There is no such way to choose voxels.
    #[error("mode is {name:?}; choose solid or surface")]
    UnknownMode { name: String },
    /// A procedural solid whose iso-surface is no manifold on any grid tried.
    #[error("no manifold surface of the procedural object in {tries} grids; take another seed and report this one")]
    NoManifoldSurface {
        /// Grids tried.
        tries: usize,
    },
}

/// Refuses a parameter that is not `valid`; `rule` is a sentence.
///
/// # Errors
/// [`MeshError::BadParameter`].
pub(crate) fn require(valid: bool, name: &'static str, value: f64, rule: &'static str) -> Result<(), MeshError> {
    if valid { Ok(()) } else { Err(MeshError::BadParameter { name, value, rule }) }
}
