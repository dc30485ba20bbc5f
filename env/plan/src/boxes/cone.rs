//! The points of a core set that matter for boxes about nearly the same axis.
//!
//! Points move little in the projection along an axis that turns a little: one well inside the outline stays inside, and one well below the top stays
//! below it. A search with small steps needs only the others, which keep the order in which they were sorted last.

use super::calipers::{Calipers, Rectangle};
use super::minimum::plane_basis;
use nalgebra::Vector3;

/// Greatest angle between axes that share a cone, radians.
pub(super) const ANGLE: f64 = 0.02;
/// Distance from the outline, or from either end, that no point passes within [`ANGLE`], as a share of the cloud's size: two points are at most two
/// sizes apart.
const MARGIN: f64 = 2.2 * ANGLE;
/// Most corners of the polygon inside the outline from which the distances are measured.
const CORNERS: usize = 16;

/// The points that matter near an axis.
pub(super) struct Cone {
    axis: Vector3<f64>,
    /// Points near the outline, and those near either end of the axis.
    sides: Vec<Vector3<f64>>,
    ends: Vec<Vector3<f64>>,
}

/// Buffers for one query after the other.
#[derive(Default)]
pub(super) struct Buffers {
    points: Vec<[f64; 2]>,
    numbers: Vec<u32>,
    sorted: Vec<Vector3<f64>>,
}

impl Cone {
    /// The cone of the points of `core` about `axis`, a unit vector.
    pub fn new(core: &[Vector3<f64>], axis: &Vector3<f64>, calipers: &mut Calipers) -> Self {
        let (u, v) = plane_basis(axis);
        let flat: Vec<[f64; 2]> = core.iter().map(|p| [p.dot(&u), p.dot(&v)]).collect();
        let mut sorted = flat.clone();
        sorted.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        let hull = calipers.hull(&sorted);
        let corners: Vec<[f64; 2]> = hull.iter().copied().step_by(hull.len().div_ceil(CORNERS).max(1)).collect();
        // Inward unit normals of the polygon's edges, and where the edges are along them.
        let edge = |(a, b): (&[f64; 2], &[f64; 2])| {
            let length = (b[0] - a[0]).hypot(b[1] - a[1]);
            let normal = [(a[1] - b[1]) / length, (b[0] - a[0]) / length];
            (normal, normal[0] * a[0] + normal[1] * a[1])
        };
        let edges: Vec<_> = corners.iter().zip(corners.iter().cycle().skip(1)).map(edge).collect();
        let inside =
            |p: &[f64; 2]| corners.len() > 2 && edges.iter().all(|(n, at)| n[0] * p[0] + n[1] * p[1] - at > MARGIN);
        let sides = core.iter().zip(&flat).filter(|(_, p)| !inside(p)).map(|(p, _)| *p).collect();
        let along = core.iter().map(|p| p.dot(axis));
        let (low, high) = along.clone().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        let near = |x: f64| x < low + MARGIN || x > high - MARGIN;
        let ends = core.iter().zip(along).filter(|(_, x)| near(*x)).map(|(p, _)| *p).collect();
        Self { axis: *axis, sides, ends }
    }

    /// True if all points that matter for `axis`, a unit vector, are in the cone.
    pub fn holds(&self, axis: &Vector3<f64>) -> bool {
        (axis - self.axis).norm_squared() < ANGLE * ANGLE
    }

    /// Length of the cloud along `axis`, and the least rectangle around its projection on `u` and `v`; see [`Calipers::least_rectangle`].
    pub fn measure(
        &mut self,
        [axis, u, v]: [&Vector3<f64>; 3],
        pad: f64,
        calipers: &mut Calipers,
        buffers: &mut Buffers,
    ) -> (f64, Rectangle) {
        let along = self.ends.iter().map(|p| p.dot(axis));
        let (low, high) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
        let Buffers { points, numbers, sorted } = buffers;
        points.clear();
        points.extend(self.sides.iter().map(|p| [p.dot(u), p.dot(v)]));
        numbers.clear();
        numbers.extend(0..self.sides.len() as u32);
        let rectangle = calipers.least_rectangle_nearly_sorted(points, numbers, pad);
        sorted.clear();
        sorted.extend(numbers.iter().map(|number| self.sides[*number as usize]));
        std::mem::swap(&mut self.sides, sorted);
        (high - low, rectangle)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::boxes::half_sphere;

    /// A bug here: a point left out that is on the outline, or at an end, of a nearby axis.
    #[test]
    fn a_cone_measures_as_all_points_do() {
        // A dented ellipsoid of unit size.
        let point =
            |p: Vector3<f64>| Vector3::new(0.9 * p.x, 0.5 * p.y, 0.3 * p.z) * (1.0 - 0.2 * (5.0 * p.x).sin().abs());
        let core: Vec<Vector3<f64>> = half_sphere(150).chain(half_sphere(150).map(|p| -p)).map(point).collect();
        let (mut calipers, mut buffers) = (Calipers::default(), Buffers::default());
        for axis in half_sphere(40) {
            let mut cone = Cone::new(&core, &axis, &mut calipers);
            assert!(cone.sides.len() < core.len() && cone.ends.len() < core.len() / 2);
            let (u, v) = plane_basis(&axis);
            for k in 0..12 {
                let (sin, cos) = f64::from(k).sin_cos();
                let axis = (axis + (u * cos + v * sin) * (0.95 * ANGLE * f64::from(k) / 12.0)).normalize();
                assert!(cone.holds(&axis));
                let (u, v) = plane_basis(&axis);
                let measured = cone.measure([&axis, &u, &v], 1e-6, &mut calipers, &mut buffers);
                let along = core.iter().map(|p| p.dot(&axis));
                let (low, high) = along.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(x), h.max(x)));
                let mut flat: Vec<[f64; 2]> = core.iter().map(|p| [p.dot(&u), p.dot(&v)]).collect();
                assert_eq!(measured, (high - low, calipers.least_rectangle(&mut flat, 1e-6)));
            }
        }
    }
}
