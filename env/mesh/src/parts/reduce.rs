//! Hulls with few corners.
//!
//! A hull of a few extreme corners is grown by the corner that stands out farthest, until none stands out or the cap is
//! reached. The result lies inside the full hull, and its greatest error is known.

use crate::{TriMesh, convex_hull};
use nalgebra::Point3;

/// Corners added before the hull is rebuilt.
const BATCH: usize = 6;
/// Corners that stand out by less than this share of the size are not worth having.
const TOLERANCE: f64 = 2e-4;

/// The hull of at most `max_points` of the corners of `hull`.
pub(super) fn reduce(hull: &TriMesh, max_points: usize) -> TriMesh {
    let corners = hull.vertices();
    let tolerance = TOLERANCE * hull.extent();
    let mut chosen = extremes(corners);
    loop {
        let points: Vec<_> = chosen.iter().map(|&i| corners[i]).collect();
        // The extremes of a solid span it; should rounding say otherwise, the full hull is still right.
        let Ok(inner) = convex_hull(&points) else {
            return hull.clone();
        };
        if chosen.len() >= max_points {
            return inner;
        }
        let mut outside: Vec<(usize, f64)> = corners
            .iter()
            .enumerate()
            .map(|(i, p)| (i, stands_out(&inner, p)))
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
        let apart = chosen[first..]
            .iter()
            .all(|&j| (corners[i] - corners[j]).norm() > 4.0 * distance);
        if apart {
            chosen.push(i);
        }
        if chosen.len() - first == room {
            break;
        }
    }
}

/// Greatest distance of `p` above a face of the convex mesh.
fn stands_out(inner: &TriMesh, p: &Point3<f64>) -> f64 {
    (0..inner.faces().len())
        .filter_map(|f| {
            let normal = inner.face_area_vector(f).try_normalize(0.0)?;
            Some(normal.dot(&(p - inner.triangle(f)[0])))
        })
        .fold(f64::NEG_INFINITY, f64::max)
}

/// The corners that are farthest along the axes and the space diagonals, each once.
fn extremes(corners: &[Point3<f64>]) -> Vec<usize> {
    let mut chosen = Vec::new();
    for x in [-1.0, 0.0, 1.0_f64] {
        for y in [-1.0, 0.0, 1.0_f64] {
            for z in [-1.0, 0.0, 1.0_f64] {
                if x.abs() + y.abs() + z.abs() == 2.0 {
                    continue; // 6 axes and 8 diagonals are enough to begin with
                }
                let direction = nalgebra::Vector3::new(x, y, z);
                let along = |i: &usize| corners[*i].coords.dot(&direction);
                let best = (0..corners.len()).max_by(|a, b| along(a).total_cmp(&along(b)));
                chosen.extend(best.filter(|i| !chosen.contains(i)));
            }
        }
    }
    chosen
}
