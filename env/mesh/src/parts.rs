//! Convex parts: the collision geometry of an object.
//!
//! | module | purpose |
//! |---|---|
//! | `params` | parameters, parts and how well they fit |
//! | `cell` | a piece of the solid, clipped by planes |
//! | `extremes` | the points of a cloud that lie farthest along given directions |
//! | `cloud` | the same, on either side of many planes |
//! | `cut` | top down: cut the piece that stands out most |
//! | `merge` | bottom up: join neighbours that are convex together |
//! | `reduce` | few corners |
//! | `fit` | how far hulls and mesh stand out of each other |
//! | `cache` | parts as bytes, on disk |
//!
//! Own code, because approximate decompositions thicken thin walls or need more parts: the engine's time grows with their number,
//! and cavities that are too narrow make grasps impossible. On 16 mugs, cups, bowls, plates, glasses and a pitcher:
//!
//! | | parts | overfill: mean, median of max, max | volume over the object's | s |
//! |---|---|---|---|---|
//! | own, at most 48 parts | 44 | 0.42, 2.6, 11 mm | 1.6 | 1.6 |
//! | VHACD of parry, its defaults | 25 | 2.1, 11, 21 mm | 3.2 | 0.4 |
//! | VHACD of parry, 256 voxels, 48 parts requested | 61 | 1.5, 3.1, 39 mm | 2.2 | 13 |
//!
//! CoACD with its defaults fits as well, but takes minutes: two bowls in 40 and 55 parts with a mean overfill of 0.49 and 0.74 mm
//! (own: 48 parts each, 0.45 and 0.75 mm), in 624 and 304 s of a busy core (own: 1.1 and 1.8 s).
//!
//! `cargo run --release -p graspbox-objects --features compare --example compare_parts -- FOLDER_OF_YCB_STL_FILES`

mod cache;
mod cell;
mod cloud;
mod cut;
mod decompose;
mod extremes;
mod fit;
mod merge;
mod params;
mod reduce;

pub use params::{ConvexParts, PartsParams, PartsReport};

use crate::decimate::cluster;
use crate::error::MeshError;
use crate::trimesh::TriMesh;
use decompose::decompose;
use fit::Fit;
use std::path::Path;

/// Meshes of more faces are made coarser first: 0.5 mm of an object of 20 cm need no more, and time follows their number.
const MOST_FACES: usize = 120_000;

/// Cuts a mesh into convex parts.
///
/// The solid is cut by planes until every piece is nearly convex, and pieces that are convex together are merged again; every
/// hull is built from the clipped surface itself, so walls keep their thickness and cups stay open. Works best on a watertight
/// mesh (see [`crate::clean`](fn@crate::clean)); inside is a vote of scan lines otherwise. Of a mesh with more than 120,000 faces, vertices
/// that lie in a common cell are merged first. [`measure_parts`] measures the fit of the parts.
///
/// * `cache`: a folder where results are kept by mesh and parameters; `None` keeps nothing: see [`crate::cache`].
///
/// # Errors
/// [`MeshError::BadParameter`] for a parameter outside its range; [`MeshError::Flat`] when the mesh spans no volume.
pub fn convex_parts(mesh: &TriMesh, params: &PartsParams, cache: Option<&Path>) -> Result<ConvexParts, MeshError> {
    params.check()?;
    let entry = cache.map(|folder| cache::entry(folder, mesh, params));
    if let Some(parts) = entry.as_ref().and_then(cache::read) {
        return Ok(ConvexParts { parts, cached: true });
    }
    let coarse = cluster::at_most(mesh, MOST_FACES);
    let center = middle(&coarse);
    let fit = Fit::new(&coarse, center, params.max_error, params.max_nodes);
    let parts = decompose(&coarse, center, &fit, params)?;
    if let Some(entry) = &entry {
        entry.write(&cache::encode(&parts));
    }
    Ok(ConvexParts { parts, cached: false })
}

/// Measures how well parts fit a mesh.
///
/// Of a mesh with more than 120,000 faces, vertices that lie in a common cell are merged first.
///
/// * `parts`: closed convex meshes with outward faces, in the frame of the mesh, metres.
/// * `max_error`: as [`PartsParams::max_error`]; it sets how densely the parts are sampled.
pub fn measure_parts(mesh: &TriMesh, parts: &[TriMesh], max_error: f64) -> PartsReport {
    let coarse = cluster::at_most(mesh, MOST_FACES);
    report(&coarse, parts, &Fit::new(&coarse, middle(&coarse), max_error, PartsParams::default().max_nodes))
}

/// Middle of the bounds.
fn middle(mesh: &TriMesh) -> nalgebra::Vector3<f64> {
    let aabb = mesh.aabb();
    nalgebra::center(&aabb.min, &aabb.max).coords
}

fn report(mesh: &TriMesh, parts: &[TriMesh], fit: &Fit) -> PartsReport {
    let (over, under) = (fit.overfill(parts), Fit::underfill(mesh, parts));
    PartsReport {
        parts: parts.len(),
        points: parts.iter().map(|p| p.vertices().len()).sum(),
        volume: parts.iter().map(TriMesh::signed_volume).sum(),
        overfill_max: over.greatest,
        overfill_mean: over.mean,
        underfill_max: under.greatest,
        underfill_mean: under.mean,
    }
}
