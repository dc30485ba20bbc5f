//! Points in f32, four at once: which of them may be on the outline of their projection, or at an end of it.

use crate::Lanes;
use nalgebra::Vector3;
use std::f32::consts::{FRAC_1_SQRT_2, FRAC_PI_8};

/// Margin for the rounding of points of unit size in f32; far above it.
const ROUNDING: f32 = 2e-6;
/// Distance from the polygon inside the outline beyond which a point is surely inside.
const INSIDE: f32 = 1e-5;
/// Points compared at once.
const LANES: usize = 4;

/// A list of points in f32.
#[derive(Default)]
pub(super) struct Coarse {
    count: usize,
    points: Vec<[Lanes; 3]>,
    /// Their projections, and their places along the axis; the last ones repeat the last point.
    flat: Vec<[Lanes; 2]>,
    along: Vec<Lanes>,
}

impl Coarse {
    pub fn push(&mut self, p: &Vector3<f64>) {
        let k = self.count % LANES;
        let point = [p.x as f32, p.y as f32, p.z as f32];
        if k == 0 {
            self.points.push(point.map(Lanes::splat));
        } else if let Some(last) = self.points.last_mut() {
            for (lanes, x) in last.iter_mut().zip(point) {
                (k..LANES).for_each(|k| lanes[k] = x);
            }
        }
        self.count += 1;
    }

    /// Projects all points on two vectors, and on an axis across them.
    pub fn project(&mut self, vectors: [&Vector3<f64>; 3]) {
        let [axis, u, v] = vectors.map(|vector| [0, 1, 2].map(|k| Lanes::splat(vector[k] as f32)));
        let dot = |[x, y, z]: &[Lanes; 3], vector: &[Lanes; 3]| *x * vector[0] + *y * vector[1] + *z * vector[2];
        self.flat.clear();
        self.flat.extend(self.points.iter().map(|p| [dot(p, &u), dot(p, &v)]));
        self.along.clear();
        self.along.extend(self.points.iter().map(|p| dot(p, &axis)));
    }

    /// Visits the points that may be at either end of the axis.
    pub fn visit_ends(&self, visit: impl FnMut(usize)) {
        let far = |(low, high): (Lanes, Lanes), x: &Lanes| (low.min(*x), high.max(*x));
        let (low, high) = self.along.iter().fold((Lanes::INFINITY, Lanes::NEG_INFINITY), far);
        let low = Lanes::splat(low.min_element() + ROUNDING);
        let high = Lanes::splat(high.max_element() - ROUNDING);
        self.visit(self.along.iter().map(|x| (x.cmple(low) | x.cmpge(high)).bitmask()), visit);
    }

    /// Visits the points that are not surely inside the outline.
    pub fn visit_outer(&self, visit: impl FnMut(usize)) {
        const R: f32 = FRAC_1_SQRT_2;
        let mut corners = [0; 8];
        self.corners([[1.0, 0.0], [R, R], [0.0, 1.0], [-R, R]], &mut corners);
        let corners = corners.map(|number| self.flat[number / LANES].map(|lanes| lanes[number % LANES]));
        let mut edges = [[Lanes::ZERO; 3]; 8];
        let mut count = 0;
        for (k, a) in corners.iter().enumerate() {
            let b = corners[(k + 1) % corners.len()];
            let e = [b[0] - a[0], b[1] - a[1]];
            let length = (e[0] * e[0] + e[1] * e[1]).sqrt();
            // Two directions may have one farthest point.
            if length > INSIDE {
                let normal = [-e[1] / length, e[0] / length];
                let at = normal[0] * a[0] + normal[1] * a[1] + INSIDE;
                edges[count] = [normal[0], normal[1], at].map(Lanes::splat);
                count += 1;
            }
        }
        let none = Lanes::splat(if count < 3 { -1.0 } else { 1.0 });
        let outside = |[x, y]: &[Lanes; 2]| {
            let mut least = none;
            for [nx, ny, at] in &edges[..count] {
                least = least.min(*nx * *x + *ny * *y - *at);
            }
            least.cmple(Lanes::ZERO).bitmask()
        };
        self.visit(self.flat.iter().map(outside), visit);
    }

    /// Sixteen points of the outline, counter-clockwise; some may be the same.
    pub fn outline(&self) -> [usize; 16] {
        let mut corners = [0; 16];
        let direction = |k: usize| {
            let (sin, cos) = (k as f32 * FRAC_PI_8).sin_cos();
            [cos, sin]
        };
        self.corners::<8>(std::array::from_fn(direction), &mut corners);
        corners
    }

    /// The farthest points along directions, counter-clockwise, then along their opposites.
    fn corners<const N: usize>(&self, directions: [[f32; 2]; N], corners: &mut [usize]) {
        let value = |[x, y]: &[Lanes; 2], [dx, dy]: [f32; 2]| *x * dx + *y * dy;
        let mut ends = [[Lanes::INFINITY, Lanes::NEG_INFINITY]; N];
        for p in &self.flat {
            for ([low, high], direction) in ends.iter_mut().zip(directions) {
                let value = value(p, direction);
                *low = low.min(value);
                *high = high.max(value);
            }
        }
        for (k, ([low, high], direction)) in ends.into_iter().zip(directions).enumerate() {
            for (corner, end) in [(k, high.max_element()), (k + N, low.min_element())] {
                let end = Lanes::splat(end);
                let found = self.flat.iter().map(|p| value(p, direction).cmpeq(end).bitmask()).enumerate();
                let found = found.into_iter().find(|(_, bits)| *bits != 0).unwrap_or((0, 1));
                corners[corner] = (found.0 * LANES + found.1.trailing_zeros() as usize).min(self.count - 1);
            }
        }
    }

    /// Visits the points of the set bits, four in each item; those that repeat the last point are left out.
    fn visit(&self, bits: impl Iterator<Item = u32>, mut visit: impl FnMut(usize)) {
        for (four, mut bits) in bits.enumerate() {
            while bits != 0 {
                let number = four * LANES + bits.trailing_zeros() as usize;
                bits &= bits - 1;
                if number < self.count {
                    visit(number);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::boxes::calipers::Calipers;
    use crate::boxes::half_sphere;
    use crate::boxes::minimum::plane_basis;

    /// A bug here: a point left out that is a corner of the outline or at an end, or a bound above the least rectangle.
    #[test]
    fn what_is_left_out_changes_no_rectangle_and_no_length() {
        let round = |p: Vector3<f64>| Vector3::new(0.9 * p.x, 0.5 * p.y, 0.3 * p.z);
        // An ellipsoid, a brick with points along its edges, and a flat disc.
        let brick = |k: u32| {
            let side = |axis: u32| f64::from(k / 5_u32.pow(axis) % 5) * 0.25 - 0.5;
            Vector3::new(1.6 * side(0), side(1), 0.4 * side(2))
        };
        let clouds: [Vec<Vector3<f64>>; 3] = [
            half_sphere(90).chain(half_sphere(91).map(|p| -p)).map(round).collect(),
            (0..125).map(brick).collect(),
            half_sphere(77).map(|p| Vector3::new(p.x, p.y, 0.0)).collect(),
        ];
        let (mut calipers, mut left_out) = (Calipers::default(), 0);
        for cloud in clouds {
            let mut coarse = Coarse::default();
            cloud.iter().for_each(|p| coarse.push(p));
            for axis in half_sphere(60) {
                let (u, v) = plane_basis(&axis);
                let flat = |number: usize| [cloud[number].dot(&u), cloud[number].dot(&v)];
                coarse.project([&axis, &u, &v]);
                let (mut outer, mut ends) = (Vec::new(), Vec::new());
                coarse.visit_outer(|number| outer.push(flat(number)));
                coarse.visit_ends(|number| ends.push(cloud[number].dot(&axis)));
                left_out += cloud.len() - outer.len();
                let mut all: Vec<[f64; 2]> = (0..cloud.len()).map(flat).collect();
                let expected = calipers.least_rectangle(&mut all, 1e-6);
                assert_eq!(calipers.least_rectangle(&mut outer, 1e-6), expected);
                let far = |values: &mut dyn Iterator<Item = f64>| {
                    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
                };
                assert_eq!(far(&mut ends.into_iter()), far(&mut cloud.iter().map(|p| p.dot(&axis))));
                let mut outline: Vec<[f64; 2]> = coarse.outline().map(flat).to_vec();
                outline.dedup();
                if calipers.take_outline(&outline) {
                    let area = (expected.length + 1e-6) * (expected.width + 1e-6);
                    assert!(calipers.least_area(1e-6) <= area * (1.0 + 1e-9));
                }
            }
        }
        assert!(left_out > 10_000, "{left_out}");
    }
}
