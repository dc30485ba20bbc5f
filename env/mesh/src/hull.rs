//! Convex hulls in f64, on parry's quickhull in f32.
//!
//! Points are moved to their centre and scaled to unit size before they become f32, so the relative error is about 1e-7
//! wherever the object lies. Flat input is an error, never a panic.

use crate::{MeshError, TriMesh};
use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};
use parry3d::math::Vector;
use parry3d::transformation::try_convex_hull;
use std::panic::AssertUnwindSafe;

/// Least thickness of a hull over its size. Below it f32 cannot tell a solid from a plane.
const MIN_RELATIVE_THICKNESS: f64 = 1e-5;

/// The convex hull of `points` as a closed mesh with outward faces.
///
/// * `points`: any frame, metres; duplicates and inner points are allowed.
///
/// # Errors
/// [`MeshError::NotFinite`]; [`MeshError::Flat`] for fewer than 4 points and for points within 1e-5 of their size of one
/// plane; [`MeshError::Hull`] should quickhull fail on anything else.
pub fn convex_hull(points: &[Point3<f64>]) -> Result<TriMesh, MeshError> {
    if let Some(vertex) = points.iter().position(|p| !p.coords.iter().all(|x| x.is_finite())) {
        return Err(MeshError::NotFinite { vertex });
    }
    let count = points.len();
    let (centre, size) = centre_and_size(points).ok_or(MeshError::Flat { count })?;
    if thickness(points, &centre) < MIN_RELATIVE_THICKNESS * size {
        return Err(MeshError::Flat { count });
    }
    let unit: Vec<Vector> = points.iter().map(|p| to_glam(&((p - centre) / size))).collect();
    let (vertices, faces) = hull_f32(&unit).map_err(|detail| MeshError::Hull { count, detail })?;
    let vertices = vertices.iter().map(|v| centre + from_glam(*v) * size).collect();
    TriMesh::new(vertices, faces)
}

/// Quickhull; its panics (it asserts on some inputs) and its errors become one sentence.
pub(crate) fn hull_f32(points: &[Vector]) -> Result<(Vec<Vector>, Vec<[u32; 3]>), String> {
    match std::panic::catch_unwind(AssertUnwindSafe(|| try_convex_hull(points))) {
        Ok(Ok((vertices, faces))) if !faces.is_empty() => Ok((vertices, faces)),
        Ok(Ok(_)) => Err("it has no faces".into()),
        Ok(Err(e)) => Err(e.to_string()),
        Err(_) => Err("quickhull failed an assertion".into()),
    }
}

pub(crate) fn to_glam(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x as f32, v.y as f32, v.z as f32)
}

pub(crate) fn from_glam(v: Vector) -> Vector3<f64> {
    Vector3::new(f64::from(v.x), f64::from(v.y), f64::from(v.z))
}

/// Centre and longest side of the bounds; `None` for no points or a single place.
fn centre_and_size(points: &[Point3<f64>]) -> Option<(Point3<f64>, f64)> {
    let first = *points.first()?;
    let (min, max) = points
        .iter()
        .fold((first, first), |(min, max), p| (min.inf(p), max.sup(p)));
    let size = (max - min).amax();
    (size > 0.0).then(|| (nalgebra::center(&min, &max), size))
}

/// Extent along the direction of least variance.
fn thickness(points: &[Point3<f64>], centre: &Point3<f64>) -> f64 {
    let mean = points.iter().map(|p| p - centre).sum::<Vector3<f64>>() / points.len() as f64;
    let covariance: Matrix3<f64> = points
        .iter()
        .map(|p| p - centre - mean)
        .map(|d| d * d.transpose())
        .sum();
    let eigen = SymmetricEigen::new(covariance);
    let normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
    let heights = points.iter().map(|p| (p - centre).dot(&normal));
    let (least, greatest) = heights.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), h| (a.min(h), b.max(h)));
    greatest - least
}
