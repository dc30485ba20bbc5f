//! Approximation of a convex shape by the hull of few points.

use crate::lathe::PART_POINTS;
use crate::surface::P3;
use graspbox_mesh::{MeshError, convex_hull, fibonacci_sphere};
use nalgebra::{Point3, Vector3};
use std::sync::LazyLock;

/// Number of directions of the first points; the others are added where the hull is deepest below the shape.
const FIRST_POINTS: usize = 46;

/// Even directions: the Fibonacci sphere, relaxed by mutual repulsion.
static DIRECTIONS: LazyLock<Vec<Vector3<f64>>> = LazyLock::new(|| {
    let mut points = fibonacci_sphere(FIRST_POINTS);
    for _ in 0..80 {
        let push = |p: &Vector3<f64>| {
            let away = |q: &Vector3<f64>| (p - q) / (p - q).norm().max(1e-9).powi(4);
            (p + points.iter().map(away).sum::<Vector3<f64>>() * 4e-4).normalize()
        };
        points = points.iter().map(push).collect();
    }
    points
});

/// At most 64 points whose hull stays close to the convex hull of `vertices`, half inside and half outside of it.
///
/// # Errors
/// Those of [`convex_hull`], when the vertices are coplanar.
pub(crate) fn convex_cloud(vertices: &[P3]) -> Result<Vec<P3>, MeshError> {
    let center = Point3::from(vertices.iter().map(|p| p.coords).sum::<Vector3<f64>>() / vertices.len() as f64);
    let mut chosen: Vec<usize> = Vec::with_capacity(PART_POINTS);
    for d in DIRECTIONS.iter() {
        let height = |i: usize| vertices[i].coords.dot(d);
        let best = (0..vertices.len()).max_by(|&i, &j| height(i).total_cmp(&height(j)));
        chosen.extend(best.filter(|b| !chosen.contains(b)));
    }
    let mut gap;
    loop {
        let planes = hull_planes(&chosen.iter().map(|&i| vertices[i]).collect::<Vec<_>>())?;
        let outside = |p: &P3| planes.iter().map(|(n, offset)| n.dot(&p.coords) - offset).fold(0.0, f64::max);
        let depths: Vec<f64> = vertices.iter().map(outside).collect();
        let deepest = (0..vertices.len()).max_by(|&i, &j| depths[i].total_cmp(&depths[j])).unwrap_or(0);
        gap = depths[deepest];
        // A tenth of a millimetre is finer than any contact.
        if gap < 1e-4 || chosen.len() == PART_POINTS || chosen.contains(&deepest) {
            break;
        }
        chosen.push(deepest);
    }
    let swell = |&i: &usize| vertices[i] + (vertices[i] - center).normalize() * (gap / 2.0);
    Ok(chosen.iter().map(swell).collect())
}

/// Outward planes (unit normal, offset) of the hull of `cloud`.
fn hull_planes(cloud: &[P3]) -> Result<Vec<(Vector3<f64>, f64)>, MeshError> {
    let hull = convex_hull(cloud)?;
    let plane = |f: usize| {
        let normal = hull.face_area_vector(f).normalize();
        (normal, normal.dot(&hull.triangle(f)[0].coords))
    };
    Ok((0..hull.faces().len()).map(plane).filter(|(n, _)| n.x.is_finite()).collect())
}
