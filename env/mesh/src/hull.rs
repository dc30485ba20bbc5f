//! Convex hulls in f64.
//!
//! parry's quickhull in f32 leaves out points of many coplanar inputs (cut faces, modelled objects), so this crate has its own.
//! Flat input is an error, never a panic. Corners are always points that were given, with their bits; nearly coplanar faces may
//! fold by a ten-millionth of the size.

mod quickhull;

use crate::error::MeshError;
use crate::trimesh::TriMesh;
use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};
use quickhull::quickhull;

/// Least thickness of a hull over its size: below it the f32 of the physics engine cannot tell a solid from a plane.
const MIN_RELATIVE_THICKNESS: f64 = 1e-5;

/// The convex hull of `points` as a closed mesh with outward faces.
///
/// * `points`: any frame, metres; duplicates and inner points are allowed.
///
/// # Errors
/// [`MeshError::NotFinite`]; [`MeshError::Flat`] for fewer than 4 points and for points within 1e-5 of their size of one
/// plane; [`MeshError::Hull`] should rounding defeat quickhull.
pub fn convex_hull(points: &[Point3<f64>]) -> Result<TriMesh, MeshError> {
    if let Some(vertex) = points.iter().position(|p| !p.coords.iter().all(|x| x.is_finite())) {
        return Err(MeshError::NotFinite { vertex });
    }
    let count = points.len();
    let (centre, size) = centre_and_size(points).ok_or(MeshError::Flat { count })?;
    if thickness(points, &centre) < MIN_RELATIVE_THICKNESS * size {
        return Err(MeshError::Flat { count });
    }
    let (vertices, faces) =
        hull_indexed(points).ok_or_else(|| MeshError::Hull { count, detail: "rounding tears its surface".into() })?;
    TriMesh::new(vertices, faces)
}

/// Corners, and faces that name them.
pub(crate) type Indexed = (Vec<Point3<f64>>, Vec<[u32; 3]>);

/// Corners and outward faces of the hull; `None` when the points are flat.
pub(crate) fn hull_indexed(points: &[Point3<f64>]) -> Option<Indexed> {
    let mut faces = quickhull(points)?;
    let mut corners: Vec<u32> = faces.iter().flatten().copied().collect();
    corners.sort_unstable();
    corners.dedup();
    for v in faces.iter_mut().flatten() {
        *v = corners.partition_point(|c| c < v) as u32;
    }
    Some((corners.iter().map(|&c| points[c as usize]).collect(), faces))
}

/// Outward unit normals and offsets of the faces of a convex mesh: inside, `normal . x <= offset` for each.
///
/// Slivers are left out: three corners in a line have no normal, and their neighbours bound the same edge.
pub(crate) fn planes(convex: &TriMesh) -> Vec<(Vector3<f64>, f64)> {
    (0..convex.faces().len())
        .filter_map(|f| {
            let [a, b, c] = convex.triangle(f);
            let longest = (b - a).norm_squared().max((c - b).norm_squared()).max((a - c).norm_squared());
            let normal = (b - a).cross(&(c - a));
            let wide = normal.norm() > 1e-4 * longest;
            wide.then(|| normal.normalize()).map(|n| (n, n.dot(&a.coords)))
        })
        .collect()
}

/// Centre and longest side of the bounds; `None` for no points or a single place.
fn centre_and_size(points: &[Point3<f64>]) -> Option<(Point3<f64>, f64)> {
    let first = *points.first()?;
    let (min, max) = points.iter().fold((first, first), |(min, max), p| (min.inf(p), max.sup(p)));
    let size = (max - min).amax();
    (size > 0.0).then(|| (nalgebra::center(&min, &max), size))
}

/// Extent along the direction of least variance.
fn thickness(points: &[Point3<f64>], centre: &Point3<f64>) -> f64 {
    let mean = points.iter().map(|p| p - centre).sum::<Vector3<f64>>() / points.len() as f64;
    let covariance: Matrix3<f64> = points.iter().map(|p| p - centre - mean).map(|d| d * d.transpose()).sum();
    let eigen = SymmetricEigen::new(covariance);
    let normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    let heights = points.iter().map(|p| (p - centre).dot(&normal));
    let (least, greatest) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), h| (a.min(h), b.max(h)));
    greatest - least
}
