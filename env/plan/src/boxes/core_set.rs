//! A core set: a few extreme points of a cloud.
//!
//! A box around the core set is never larger than the box with the same axes around the cloud, so a search on the core set gives lower bounds. Points
//! outside a box found there join the core set until the bound equals the volume around the cloud.

use super::coarse::Coarse;
use graspbox_mesh::fibonacci_zone;
use nalgebra::{Matrix3, Vector3};

/// Number of axes along which the first extreme points are taken, two per axis; the axes are about 16 degrees apart.
const FIRST_AXES: usize = 64;
/// Points this close along an axis (clouds have unit size) are equally extreme, and the first is taken, so rounding does not choose.
const TIE: f64 = 1e-10;
/// Margin for the rounding of bounds in f32; far above it.
const ROUNDING: f32 = 2e-6;

/// Points of a block: those of neighbouring cells.
const BLOCK: usize = 64;
/// Points compared at once.
const LANES: usize = 4;
/// Bits of the number of a cell along one axis of the cloud, which spans [-1, 1].
const CELL_BITS: u32 = 4;

/// `count` directions spread evenly over half the unit sphere.
pub(crate) fn half_sphere(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    fibonacci_zone(count, [0.0, 1.0])
}

/// A cloud and its core set.
pub(crate) struct CoreSet {
    /// The points, cell by cell, and the places at which they were given.
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
    numbers: Vec<u32>,
    inside: Vec<bool>,
    core: Vec<Vector3<f64>>,
    coarse: Coarse,
    /// Of each block, the middle and the half sides of its bounds, in f32.
    bounds: [Vec<f32>; 6],
    /// Of each block, a bound of its values along the last axis: from below and from above.
    ranges: [Vec<f32>; 2],
}

impl CoreSet {
    /// Starts with the extreme points of the cloud along evenly spread axes.
    ///
    /// * `points`: at most a unit from the origin.
    pub fn new(points: &[Vector3<f64>]) -> Self {
        let numbers = cell_by_cell(points);
        let [x, y, z] = [0, 1, 2].map(|axis| numbers.iter().map(|&i| points[i as usize][axis]).collect::<Vec<f64>>());
        let blocks = x.chunks(BLOCK).zip(y.chunks(BLOCK)).zip(z.chunks(BLOCK)).map(|((x, y), z)| [x, y, z]);
        let mut bounds = [const { Vec::new() }; 6];
        for block in blocks {
            for (axis, values) in block.into_iter().enumerate() {
                let (low, high) = range(values.iter().copied());
                bounds[axis].push((0.5 * (low + high)) as f32);
                bounds[axis + 3].push((0.5 * (high - low)) as f32);
            }
        }
        let (inside, core) = (vec![false; x.len()], Vec::with_capacity(2 * FIRST_AXES));
        let (coarse, ranges) = Default::default();
        let mut set = Self { x, y, z, numbers, inside, core, coarse, bounds, ranges };
        for axis in half_sphere(FIRST_AXES) {
            let extremes = set.extremes(&axis);
            set.add(extremes.least.1);
            set.add(extremes.greatest.1);
        }
        set
    }

    /// The core set.
    pub fn core(&self) -> &[Vector3<f64>] {
        &self.core
    }

    /// Appends the projections on `u` and `v` of all points of the core set that may be on their outline; returns the length along `axis`.
    pub fn project(&mut self, [axis, u, v]: [&Vector3<f64>; 3], flat: &mut Vec<[f64; 2]>) -> f64 {
        self.coarse.project([axis, u, v]);
        let core = &self.core;
        self.coarse.visit_outer(|number| flat.push([core[number].dot(u), core[number].dot(v)]));
        self.length(axis)
    }

    /// As [`CoreSet::project`], of a few points on the outline, counter-clockwise.
    pub fn project_outline(&mut self, [axis, u, v]: [&Vector3<f64>; 3], flat: &mut Vec<[f64; 2]>) -> f64 {
        self.coarse.project([axis, u, v]);
        let outline = self.coarse.outline();
        let mut last = outline[outline.len() - 1];
        for number in outline {
            // Several directions may have one farthest point.
            if number != last {
                flat.push([self.core[number].dot(u), self.core[number].dot(v)]);
            }
            last = number;
        }
        self.length(axis)
    }

    /// Length along the axis of the last projection.
    fn length(&self, axis: &Vector3<f64>) -> f64 {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        self.coarse.visit_ends(|number| {
            let along = self.core[number].dot(axis);
            (low, high) = (low.min(along), high.max(along));
        });
        high - low
    }

    /// Adds the extreme points of the cloud along these axes to the core set. Returns the side lengths of the box around the cloud, and whether any
    /// point was new.
    pub fn grow(&mut self, axes: &Matrix3<f64>) -> (Vector3<f64>, bool) {
        let mut grew = false;
        let lengths = Vector3::from_fn(|i, _| {
            let found = self.extremes(&axes.column(i).into_owned());
            grew |= self.add(found.least.1);
            grew |= self.add(found.greatest.1);
            found.greatest.0 - found.least.0
        });
        (lengths, grew)
    }

    fn add(&mut self, index: usize) -> bool {
        let new = !std::mem::replace(&mut self.inside[index], true);
        if new {
            let point = Vector3::new(self.x[index], self.y[index], self.z[index]);
            self.core.push(point);
            self.coarse.push(&point);
        }
        new
    }

    /// Blocks whose bounds cannot have the extremes are passed over.
    fn extremes(&mut self, axis: &Vector3<f64>) -> Extremes {
        let [x, y, z] = [axis.x, axis.y, axis.z].map(|x| x as f32);
        let [mx, my, mz, hx, hy, hz] = &self.bounds;
        let [lows, highs] = &mut self.ranges;
        lows.resize(mx.len(), 0.0);
        highs.resize(mx.len(), 0.0);
        let sides = mx.iter().zip(my).zip(mz).zip(hx).zip(hy).zip(hz);
        for ((((((mx, my), mz), hx), hy), hz), (low, high)) in sides.zip(lows.iter_mut().zip(highs)) {
            let middle = x * mx + y * my + z * mz;
            let half = x.abs() * hx + y.abs() * hy + z.abs() * hz + ROUNDING;
            (*low, *high) = (middle - half, half + middle);
        }
        let high = self.first(axis, -1.0, &self.ranges[1]);
        let low = self.first(axis, 1.0, &self.ranges[0]);
        Extremes { least: low, greatest: (-high.0, high.1) }
    }

    /// The least value along `axis`, times `sign`, and, of the points within [`TIE`] of it, the one that was given first.
    ///
    /// * `bounds`: of each block, a bound of its values towards the least.
    fn first(&self, axis: &Vector3<f64>, sign: f64, bounds: &[f32]) -> (f64, usize) {
        let places = |block: usize| block * BLOCK..((block + 1) * BLOCK).min(self.x.len());
        let least_of = |block: usize| {
            let [x, y, z] = [&self.x, &self.y, &self.z].map(|list| &list[places(block)]);
            let mut least = [f64::INFINITY; LANES];
            let whole = x.len() - x.len() % LANES;
            for first in (0..whole).step_by(LANES) {
                let [x, y, z] = [x, y, z].map(|list| &list[first..first + LANES]);
                for k in 0..LANES {
                    let value = sign * (axis.x * x[k] + axis.y * y[k] + axis.z * z[k]);
                    least[k] = if value < least[k] { value } else { least[k] };
                }
            }
            for k in whole..x.len() {
                least[0] = least[0].min(sign * (axis.x * x[k] + axis.y * y[k] + axis.z * z[k]));
            }
            least[0].min(least[1]).min(least[2].min(least[3]))
        };
        let turned = sign as f32;
        let nearest = bounds.iter().enumerate().fold((0, f32::INFINITY), |best, (block, bound)| {
            if turned * bound < best.1 { (block, turned * bound) } else { best }
        });
        let mut least = least_of(nearest.0);
        let mut found: Vec<(usize, f64)> = vec![(nearest.0, least)];
        for (block, bound) in bounds.iter().enumerate() {
            if f64::from(turned * bound) <= least + TIE && block != nearest.0 {
                let value = least_of(block);
                found.push((block, value));
                least = if value < least { value } else { least };
            }
        }
        let value = |i: usize| sign * (axis.x * self.x[i] + axis.y * self.y[i] + axis.z * self.z[i]);
        let blocks = found.iter().filter(|(_, value)| *value <= least + TIE);
        let tied = blocks.flat_map(|(block, _)| places(*block)).filter(|&i| value(i) <= least + TIE);
        (least, tied.min_by_key(|&i| self.numbers[i]).unwrap_or(0))
    }
}

/// The numbers of points, those of a cell one after the other, and neighbouring cells mostly.
fn cell_by_cell(points: &[Vector3<f64>]) -> Vec<u32> {
    /// Cells along an axis.
    const SIDE: f64 = (1 << CELL_BITS) as f64;
    // The bits of a number, two places apart.
    let spread = |at: usize| (0..CELL_BITS).fold(0, |all, bit| all | (at as u32 >> bit & 1) << (3 * bit));
    let spread: [u32; 1 << CELL_BITS] = std::array::from_fn(spread);
    let part = |x: f64| spread[(0.5 * (x + 1.0) * SIDE).clamp(0.0, SIDE - 1.0) as usize];
    let cells: Vec<u32> = points.iter().map(|p| part(p.x) | part(p.y) << 1 | part(p.z) << 2).collect();
    let mut ends = vec![0_u32; (1 << (3 * CELL_BITS)) + 1];
    cells.iter().for_each(|cell| ends[*cell as usize + 1] += 1);
    (1..ends.len()).for_each(|cell| ends[cell] += ends[cell - 1]);
    let mut numbers = vec![0; points.len()];
    for (number, cell) in (0..).zip(cells) {
        let place = &mut ends[cell as usize];
        numbers[*place as usize] = number;
        *place += 1;
    }
    numbers
}

fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
}

struct Extremes {
    least: (f64, usize),
    greatest: (f64, usize),
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A bug here: a block that is passed over though it has the extreme, or another of several equally extreme points.
    #[test]
    fn extremes_are_those_of_all_points_and_the_first_of_equal_ones() {
        // A grid on a brick: many points are equally extreme.
        let place = |k: usize| [k % 13, k * 7 % 169 / 13, k * 5 % 1859 / 169].map(|x| x as f64);
        let point = |k: usize| {
            let [x, y, z] = place(k);
            Vector3::new(x / 6.0 - 1.0, y / 12.0 - 0.5, z / 50.0) * 0.7
        };
        let points: Vec<Vector3<f64>> = (0..1859).map(point).collect();
        let mut set = CoreSet::new(&points);
        for axis in half_sphere(50).chain([Vector3::x(), Vector3::y(), Vector3::z()]) {
            let found = set.extremes(&axis);
            for (sign, (value, at)) in [(1.0, found.least), (-1.0, found.greatest)] {
                let along = |p: &Vector3<f64>| sign * (axis.x * p.x + axis.y * p.y + axis.z * p.z);
                let least = points.iter().map(along).fold(f64::INFINITY, f64::min);
                let first = points.iter().position(|p| along(p) <= least + TIE);
                assert_eq!(sign * value, least);
                assert_eq!(first, Some(set.numbers[at] as usize), "{axis:?}");
            }
        }
    }
}
