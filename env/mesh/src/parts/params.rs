//! Parameters, parts and how well they fit.

use crate::error::{MeshError, require};
use crate::trimesh::TriMesh;
use serde::{Deserialize, Serialize};

/// How finely an object is cut into convex parts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PartsParams {
    /// All but 2 % of the surface of a part stays within this distance of the mesh, metres; more parts are made until it does.
    pub max_error: f64,
    /// Most parts, even if `max_error` is not reached.
    pub max_parts: usize,
    /// Most corners of a part.
    pub max_points: usize,
    /// Most nodes of the grid on which parts are measured: memory (17 bytes each) and time (about 0.15 us each) follow.
    pub max_nodes: usize,
}

impl Default for PartsParams {
    /// 1.5 mm, which keeps a can at 26 parts and a bottle at 10 (1 mm: 42 and 23); 48 parts of 64 corners, which the physics engine still
    /// runs fast.
    fn default() -> Self {
        Self { max_error: 1.5e-3, max_parts: 48, max_points: 64, max_nodes: 600_000 }
    }
}

impl PartsParams {
    pub(super) fn check(&self) -> Result<(), MeshError> {
        let Self { max_error, max_parts, max_points, max_nodes } = *self;
        let rule = "it must be a positive number of metres";
        require(max_error.is_finite() && max_error > 0.0, "max_error", max_error, rule)?;
        require(max_parts > 0, "max_parts", 0.0, "at least 1 part is needed")?;
        require(max_points >= 8, "max_points", max_points as f64, "a part needs at least 8 corners")?;
        require(max_nodes >= 1000, "max_nodes", max_nodes as f64, "a grid needs at least 1000 nodes")
    }
}

/// How well the parts fill the mesh.
#[derive(Clone, Debug, PartialEq)]
pub struct PartsReport {
    pub parts: usize,
    /// Corners of all parts.
    pub points: usize,
    /// Sum of the volumes of the parts (an overlap counts twice), m3.
    pub volume: f64,
    /// Farthest that a part stands out of the mesh, metres.
    pub overfill_max: f64,
    /// The same, mean over the surface of the parts (where they are inside the mesh it is 0), metres.
    pub overfill_mean: f64,
    /// Farthest that the mesh stands out of the parts, metres.
    pub underfill_max: f64,
    /// The same, mean over the surface of the mesh, metres.
    pub underfill_mean: f64,
}

#[derive(Clone, Debug, PartialEq)]
pub struct ConvexParts {
    /// Closed convex meshes with outward faces, in the frame of the mesh, metres.
    pub parts: Vec<TriMesh>,
    /// Read from the cache.
    pub cached: bool,
}
