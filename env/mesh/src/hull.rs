//! Convex hulls in f64.
//!
//! Flat input is an error, never a panic. Corners are always points that were given, with their bits; nearly coplanar faces may
//! fold by a ten-millionth of the size.
//!
//! Own code, because parry's quickhull loses corners of pieces with cut faces, which the convex decomposition makes all the
//! time. Hulls that are missing, open, or wrong by more than 2 ten-thousandths of the size, the greatest distance between hull
//! and points as a share of the size, and milliseconds per hull:
//!
//! | input | own | parry, f64 | parry, f32 |
//! |---|---|---|---|
//! | 88 procedural meshes | 0; 1.4e-6; 2.0 ms | 0; 2e-15; 1.7 ms | 1; 1.2e-6; 1.6 ms |
//! | 78 YCB meshes | 0; 1.7e-6; 5.6 ms | 0; 0; 4.9 ms | 0; 1.1e-6; 4.2 ms |
//! | 996 pieces with two cut faces | 2; 4.4e-6; 1.6 ms | 33; 1.3e-2; 1.7 ms | 51; 2.6e-2; 1.5 ms |
//! | 23 lattices, prisms, domes | 0; 2.1e-6; 5.5 ms | 0; 2e-16; 272 ms | 2; 6.3e-5; 68 ms |
//!
//! `cargo run --release -p graspbox-objects --features compare --example compare_hulls -- FOLDER_OF_YCB_STL_FILES`

mod quickhull;

use crate::error::MeshError;
use crate::trimesh::TriMesh;
use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};
use quickhull::quickhull;

/// Least thickness of a hull over its size: below it the f32 of the physics engine cannot distinguish a solid from a plane.
const MIN_RELATIVE_THICKNESS: f64 = 1e-5;

/// The convex hull of `points` as a closed mesh with outward faces.
///
/// * `points`: any frame, metres; duplicates and inner points are allowed.
///
/// # Errors
/// [`MeshError::NotFinite`]; [`MeshError::Flat`] for fewer than 4 points and for points within 1e-5 of their size of one
/// plane; [`MeshError::Hull`] if quickhull fails by rounding.
pub fn convex_hull(points: &[Point3<f64>]) -> Result<TriMesh, MeshError> {
    if let Some(vertex) = points.iter().position(|p| !p.coords.iter().all(|x| x.is_finite())) {
        return Err(MeshError::NotFinite { vertex });
    }
    let count = points.len();
    let (center, size) = center_and_size(points).ok_or(MeshError::Flat { count })?;
    if thickness(points, &center) < MIN_RELATIVE_THICKNESS * size {
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
    // Which points are corners, and then their places among the corners.
    let mut places = vec![0_u32; points.len()];
    faces.iter().flatten().for_each(|&v| places[v as usize] = 1);
    let mut corners = Vec::with_capacity(faces.len() / 2 + 2);
    for (place, point) in places.iter_mut().zip(points) {
        if *place == 1 {
            *place = corners.len() as u32;
            corners.push(*point);
        }
    }
    faces.iter_mut().flatten().for_each(|v| *v = places[*v as usize]);
    Some((corners, faces))
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
fn center_and_size(points: &[Point3<f64>]) -> Option<(Point3<f64>, f64)> {
    let first = *points.first()?;
    let (min, max) = points.iter().fold((first, first), |(min, max), p| (min.inf(p), max.sup(p)));
    let size = (max - min).amax();
    (size > 0.0).then(|| (nalgebra::center(&min, &max), size))
}

/// Extent along the direction of least variance.
fn thickness(points: &[Point3<f64>], center: &Point3<f64>) -> f64 {
    let mean = points.iter().map(|p| p - center).sum::<Vector3<f64>>() / points.len() as f64;
    let covariance: Matrix3<f64> = points.iter().map(|p| p - center - mean).map(|d| d * d.transpose()).sum();
    let eigen = SymmetricEigen::new(covariance);
    let normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    let heights = points.iter().map(|p| (p - center).dot(&normal));
    let (least, greatest) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), h| (a.min(h), b.max(h)));
    greatest - least
}
