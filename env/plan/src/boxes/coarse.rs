//! Points in f32, four at once: which of them may be on the outline of their projection, or at an end of it.

use crate::Lanes;
use nalgebra::Vector3;

/// Margin for the rounding of points of unit size in f32; far above it.
const ROUNDING: f32 = 2e-6;
/// Distance from the polygon inside the outline beyond which a point is surely inside.
const INSIDE: f32 = 1e-5;
/// Points compared at once.
const LANES: usize = 4;
/// Directions along which the polygon's corners are the farthest points, counter-clockwise, in turn with their opposites.
const DIRECTIONS: [[f32; 2]; 4] = [[1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [-1.0, 1.0]];

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

    /// The points that may be at either end of the axis; some twice.
    pub fn ends(&self) -> impl Iterator<Item = usize> {
        let far = |(low, high): (Lanes, Lanes), x: &Lanes| (low.min(*x), high.max(*x));
        let (low, high) = self.along.iter().fold((Lanes::splat(f32::INFINITY), Lanes::splat(f32::NEG_INFINITY)), far);
        let low = Lanes::splat(low.min_element() + ROUNDING);
        let high = Lanes::splat(high.max_element() - ROUNDING);
        numbers(self.along.iter().map(move |x| (x.cmple(low) | x.cmpge(high)).bitmask()), self.count)
    }

    /// The points that are not surely inside the outline.
    pub fn outer(&self) -> impl Iterator<Item = usize> {
        let corners = self.corners();
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
        let outside = move |[x, y]: &[Lanes; 2]| {
            let least = edges[..count].iter().map(|[nx, ny, at]| *nx * *x + *ny * *y - *at);
            let least = least.fold(Lanes::splat(if count < 3 { -1.0 } else { 1.0 }), Lanes::min);
            least.cmple(Lanes::ZERO).bitmask()
        };
        numbers(self.flat.iter().map(outside), self.count)
    }

    /// The farthest points along [`DIRECTIONS`], then along their opposites: a polygon inside the outline, counter-clockwise.
    fn corners(&self) -> [[f32; 2]; 8] {
        let mut corners = [[0.0; 2]; 8];
        for (k, [dx, dy]) in DIRECTIONS.into_iter().enumerate() {
            let value = |[x, y]: &[Lanes; 2]| *x * dx + *y * dy;
            let far = |(low, high): (Lanes, Lanes), p: &[Lanes; 2]| (low.min(value(p)), high.max(value(p)));
            let none = (Lanes::splat(f32::INFINITY), Lanes::splat(f32::NEG_INFINITY));
            let (low, high) = self.flat.iter().fold(none, far);
            for (corner, end) in [(k, high.max_element()), (k + 4, low.min_element())] {
                let end = Lanes::splat(end);
                let found = self.flat.iter().map(|p| (p, value(p).cmpeq(end).bitmask())).find(|(_, bits)| *bits != 0);
                if let Some(([x, y], bits)) = found {
                    let lane = bits.trailing_zeros() as usize;
                    corners[corner] = [x[lane], y[lane]];
                }
            }
        }
        corners
    }
}

/// The numbers of the set bits, four in each item; those from `count` on repeat the last point.
fn numbers(bits: impl Iterator<Item = u32>, count: usize) -> impl Iterator<Item = usize> {
    let lanes = |(four, bits): (usize, u32)| (0..LANES).filter(move |k| bits >> k & 1 == 1).map(move |k| four * LANES + k);
    bits.enumerate().flat_map(lanes).take_while(move |number| *number < count)
}
