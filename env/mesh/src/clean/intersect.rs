//! Whether two triangles meet.

use crate::mass::face_tree::Triangle;
use nalgebra::{Point3, Unit, Vector3};

/// Whether an edge of one triangle comes within about `tolerance` (metres) of the other one.
///
/// Triangles in one plane whose edges cross are not found: their neighbours out of that plane are. Nor are slivers without a normal.
pub(super) fn triangles_meet(a: &Triangle, b: &Triangle, tolerance: f64) -> bool {
    pierces(a, b, tolerance) || pierces(b, a, tolerance)
}

/// Whether an edge of `a` meets the inside or the border of `b`.
fn pierces(a: &Triangle, [x, y, z]: &Triangle, tolerance: f64) -> bool {
    let Some(normal) = Unit::try_new((y - x).cross(&(z - x)), 0.0) else {
        return false;
    };
    let inside = |p: &Point3<f64>| {
        [(x, y), (y, z), (z, x)].iter().all(|(from, to)| {
            let inward = normal.cross(&(*to - *from));
            inward.dot(&(p - *from)) >= -tolerance * inward.norm()
        })
    };
    let height = a.map(|p| normal.dot(&(p - x)));
    [(0, 1), (1, 2), (2, 0)].into_iter().any(|(from, to)| {
        let (low, high) = (height[from].min(height[to]), height[from].max(height[to]));
        if low > tolerance || high < -tolerance {
            return false;
        }
        // Where the edge crosses the plane; an end that only touches it is taken itself.
        let share =
            if height[from] == height[to] { 0.0 } else { (height[from] / (height[from] - height[to])).clamp(0.0, 1.0) };
        let edge: Vector3<f64> = a[to] - a[from];
        let touches = |end: usize| height[end].abs() <= tolerance && inside(&a[end]);
        inside(&(a[from] + edge * share)) || touches(from) || touches(to)
    })
}

#[cfg(test)]
mod tests {
    use super::triangles_meet;
    use nalgebra::{Point3, Vector3};

    /// Through, touching with a corner, next to it, above, and in one plane with a corner inside.
    #[test]
    fn triangles_meet_where_they_do() {
        let flat = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(Point3::from);
        let upright = [[0.2, 0.2, -0.5], [0.3, 0.2, 0.5], [0.2, 0.3, 0.5]].map(Point3::from);
        for (shift, expected) in [
            ([0.0, 0.0, 0.0], true),
            ([0.0, 0.0, 0.5], true),
            ([0.0, 0.0, 0.5 + 2e-6], false),
            ([0.6, 0.6, 0.0], false),
            ([-0.2 - 2e-6 - 0.1, 0.0, 0.0], false),
        ] {
            let moved = upright.map(|p| p + Vector3::from(shift));
            assert_eq!(triangles_meet(&flat, &moved, 1e-6), expected, "{shift:?}");
            assert_eq!(triangles_meet(&moved, &flat, 1e-6), expected, "{shift:?}");
        }
        let beside = flat.map(|p| p + Vector3::new(0.2, 0.2, 0.0));
        assert!(triangles_meet(&flat, &beside, 1e-6));
    }
}
