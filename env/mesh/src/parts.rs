//! Convex parts: the collision geometry of an object.
//!
//! | module | what it does |
//! |---|---|
//! | `cell` | a piece of the solid, clipped by planes |
//! | `cut` | top down: cut the piece that stands out most |
//! | `merge` | bottom up: join neighbours that are convex together |
//! | `reduce` | few corners |
//! | `fit` | how far hulls and mesh stand out of each other |
//! | `cache` | results on disk |

mod cache;
mod cell;
mod cut;
mod decompose;
mod fit;
mod merge;
mod reduce;

use crate::{MeshError, TriMesh};
use decompose::decompose;
use fit::Fit;
use serde::{Deserialize, Serialize};
use std::path::Path;

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
}

impl Default for PartsParams {
    /// 1.5 mm, which keeps a can at 26 parts and a bottle at 10 (1 mm: 42 and 23); 48 parts of 64 corners, which the physics engine still
    /// runs fast.
    fn default() -> Self {
        Self { max_error: 1.5e-3, max_parts: 48, max_points: 64 }
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
    /// Farthest that a part stands out of the mesh, metres.
    pub overfill_max: f64,
    /// The same, mean over the surface of the parts (where they are inside the mesh it is 0), metres.
    pub overfill_mean: f64,
    /// Farthest that the mesh stands out of the parts, metres.
    pub underfill_max: f64,
    /// The same, mean over the surface of the mesh, metres.
    pub underfill_mean: f64,
    /// Time that was spent, seconds; 0 when read from the cache.
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
/// The solid is cut by planes until every piece is nearly convex, and pieces that are convex together are merged again; every
/// hull is built from the clipped surface itself, so walls keep their thickness and cups stay open. Works best on a watertight
/// mesh (see [`crate::clean`](fn@crate::clean)); inside is a vote of scan lines otherwise.
///
/// * `cache`: a folder where results are kept by mesh and parameters; `None` keeps nothing. Damaged entries are made again, and
///   a folder that cannot be written is a warning.
///
/// # Errors
/// [`MeshError::BadParameter`] for a parameter outside its range; [`MeshError::Flat`] when the mesh spans no volume.
pub fn convex_parts(mesh: &TriMesh, params: &PartsParams, cache: Option<&Path>) -> Result<ConvexParts, MeshError> {
    check(params)?;
    let entry = cache.map(|folder| cache::entry(folder, mesh, params));
    if let Some(parts) = entry.as_deref().and_then(cache::read) {
        return Ok(parts);
    }
    let parts = build(mesh, params)?;
    if let Some(path) = &entry {
        cache::write(path, &parts);
    }
    Ok(parts)
}

fn check(params: &PartsParams) -> Result<(), MeshError> {
    let bad = |name, value, rule| Err(MeshError::BadParameter { name, value, rule });
    if !(params.max_error.is_finite() && params.max_error > 0.0) {
        return bad("max_error", params.max_error, "it must be a positive number of metres");
    }
    if params.max_parts == 0 {
        return bad("max_parts", 0.0, "at least 1 part is needed");
    }
    if params.max_points < 8 {
        return bad("max_points", params.max_points as f64, "a part needs at least 8 corners");
    }
    Ok(())
}

fn build(mesh: &TriMesh, params: &PartsParams) -> Result<ConvexParts, MeshError> {
    let begin = std::time::Instant::now();
    let aabb = mesh.aabb();
    let centre = nalgebra::center(&aabb.min, &aabb.max).coords;
    let fit = Fit::new(mesh, centre, params.max_error);
    let parts = decompose(mesh, centre, &fit, params)?;
    let (over, under) = (fit.overfill(&parts), Fit::underfill(mesh, &parts));
    let report = PartsReport {
        parts: parts.len(),
        points: parts.iter().map(|p| p.vertices().len()).sum(),
        volume: parts.iter().map(TriMesh::signed_volume).sum(),
        overfill_max: over.greatest,
        overfill_mean: over.mean,
        underfill_max: under.greatest,
        underfill_mean: under.mean,
        seconds: begin.elapsed().as_secs_f64(),
        cached: false,
    };
    Ok(ConvexParts { parts, report })
}
