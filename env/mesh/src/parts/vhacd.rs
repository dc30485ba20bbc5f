//! Approximate convex decomposition by parry's VHACD.

use super::PartsParams;
use crate::hull::{convex_hull, to_glam};
use crate::{MeshError, TriMesh};
use nalgebra::Point3;
use parry3d::transformation::vhacd::{VHACD, VHACDParameters};

pub(super) fn decompose(mesh: &TriMesh, params: &PartsParams) -> Result<Vec<TriMesh>, MeshError> {
    let points: Vec<_> = mesh.vertices().iter().map(|p| to_glam(&p.coords)).collect();
    let settings = VHACDParameters {
        concavity: 0.01,
        resolution: params.resolution,
        max_convex_hulls: params.max_parts as u32,
        ..Default::default()
    };
    let vhacd = VHACD::decompose(&settings, &points, mesh.faces(), true);
    let inputs = vhacd.compute_primitive_intersections(&points, mesh.faces());
    let parts: Vec<TriMesh> = inputs
        .iter()
        .filter_map(|cell| {
            let points: Vec<_> = cell.iter().map(|p| Point3::from(crate::hull::from_glam(*p))).collect();
            convex_hull(&points).ok().map(|hull| reduce(hull, params.max_points))
        })
        .collect();
    if parts.is_empty() {
        return Err(MeshError::Flat {
            count: mesh.vertices().len(),
        });
    }
    Ok(parts)
}

/// Keeps the corners that matter most: the extremes first, then always the one farthest outside.
fn reduce(hull: TriMesh, max_points: usize) -> TriMesh {
    super::reduce::reduce(&hull, max_points)
}
