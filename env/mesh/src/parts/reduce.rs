//! Hulls with few corners.
//!
//! A hull of a few extreme corners is grown by the corner that stands out farthest, until none stands out or the cap is
//! reached. The result lies inside the full hull and is then scaled to its volume.

use super::extremes::supports;
use crate::hull::convex_hull;
use crate::hull::planes;
use crate::sample::fibonacci_sphere;
use crate::trimesh::TriMesh;
use nalgebra::{Point3, Translation3, Vector3};

/// Directions whose extremes come first.
const FIRST: usize = 16;
/// Corners added before the hull is rebuilt.
const BATCH: usize = 6;
/// Corners that stand out by less than this share of the size are left out.
const TOLERANCE: f64 = 2e-4;

/// A hull of at most `max_points` corners, with the volume of `hull`: a ball of few corners stands out of the real one by as much as
/// it falls short of it.
pub(super) fn reduce(hull: &TriMesh, max_points: usize) -> TriMesh {
    let grown = grow(hull, max_points);
    let pruned = prune(grown.vertices().to_vec(), 0.5 * TOLERANCE * hull.extent());
    let inner = convex_hull(&pruned).unwrap_or(grown);
    let ratio = hull.signed_volume() / inner.signed_volume();
    // The least volume worth giving back, and the most that dropped corners can have taken.
    if !(1.005..1.5).contains(&ratio) {
        return inner;
    }
    let aabb = inner.aabb();
    let center = nalgebra::center(&aabb.min, &aabb.max).coords;
    let scaled = inner.transformed(&Translation3::from(-center).into()).scaled(ratio.cbrt());
    scaled.transformed(&Translation3::from(center).into())
}

/// The hull of at most `max_points` corners, inside `hull`.
fn grow(hull: &TriMesh, max_points: usize) -> TriMesh {
    let corners = hull.vertices();
    let tolerance = TOLERANCE * hull.extent();
    let mut chosen = extremes(corners);
    loop {
        let points: Vec<_> = chosen.iter().map(|&i| corners[i]).collect();
        // The extremes of a solid span it; if rounding contradicts this, the full hull is still correct.
        let Ok(inner) = convex_hull(&points) else {
            return hull.clone();
        };
        if chosen.len() >= max_points {
            return inner;
        }
        let sides = planes(&inner);
        let mut outside: Vec<(usize, f64)> = corners
            .iter()
            .enumerate()
            .map(|(i, p)| (i, greatest_height(&sides, p)))
            .filter(|&(i, d)| d > tolerance && !chosen.contains(&i))
            .collect();
        if outside.is_empty() {
            return inner;
        }
        outside.sort_by(|a, b| b.1.total_cmp(&a.1).then(a.0.cmp(&b.0)));
        let room = BATCH.min(max_points - chosen.len());
        spread(corners, &outside, room, &mut chosen);
    }
}

/// The `room` farthest corners that are not neighbours of one another (neighbours stand out for the same reason).
fn spread(corners: &[Point3<f64>], outside: &[(usize, f64)], room: usize, chosen: &mut Vec<usize>) {
    let first = chosen.len();
    for &(i, distance) in outside {
        let apart = chosen[first..].iter().all(|&j| (corners[i] - corners[j]).norm() > 4.0 * distance);
        if apart {
            chosen.push(i);
        }
        if chosen.len() - first == room {
            break;
        }
    }
}

/// Greatest distance of `p` above a plane.
fn greatest_height(planes: &[(Vector3<f64>, f64)], p: &Point3<f64>) -> f64 {
    planes.iter().map(|(n, d)| n.dot(&p.coords) - d).fold(f64::NEG_INFINITY, f64::max)
}

/// Drops redundant corners, which would only add slivers to the hull.
fn prune(mut points: Vec<Point3<f64>>, tolerance: f64) -> Vec<Point3<f64>> {
    let mut i = 0;
    while i < points.len() && points.len() > 4 {
        let corner = points.remove(i);
        let needed = convex_hull(&points).map_or(true, |others| greatest_height(&planes(&others), &corner) > tolerance);
        if needed {
            points.insert(i, corner);
            i += 1;
        }
    }
    points
}

/// A few corners that span the hull. The directions are in general position, so that they never meet a whole edge or face.
fn extremes(corners: &[Point3<f64>]) -> Vec<usize> {
    supports(corners, &fibonacci_sphere(FIRST))
}
