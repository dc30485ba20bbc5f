//! A core set: a few extreme points of a cloud.
//!
//! A box around the core set is never larger than the box with the same axes around the cloud, so a search on the core set gives lower bounds. Points
//! outside a box found there join the core set until the bound equals the volume around the cloud.

use graspbox_mesh::fibonacci_zone;
use nalgebra::{Matrix3, Vector3};

/// Number of axes along which the first extreme points are taken, two per axis; the axes are about 16 degrees apart.
const FIRST_AXES: usize = 64;
/// Points this close along an axis (clouds have unit size) are equally extreme, and the first is taken, so rounding does not choose.
const TIE: f64 = 1e-10;

/// Points compared at once, and those of a block.
const LANES: usize = 8;
const BLOCK: usize = 8 * LANES;

/// `count` directions spread evenly over half the unit sphere.
pub(crate) fn half_sphere(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    fibonacci_zone(count, [0.0, 1.0])
}

/// A cloud and its core set.
pub(crate) struct CoreSet {
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
    inside: Vec<bool>,
    core: Vec<Vector3<f64>>,
    /// The points in f32, block by block; the last ones are repeated.
    blocks: Vec<[[[f32; LANES]; 3]; BLOCK / LANES]>,
    /// Least and greatest value of each block along the last axis.
    ranges: Vec<[f32; 2]>,
}

impl CoreSet {
    /// Starts with the extreme points of the cloud along evenly spread axes.
    pub fn new(points: impl Iterator<Item = Vector3<f64>> + Clone) -> Self {
        let x: Vec<f64> = points.clone().map(|p| p.x).collect();
        let y: Vec<f64> = points.clone().map(|p| p.y).collect();
        let z: Vec<f64> = points.map(|p| p.z).collect();
        let inside = vec![false; x.len()];
        let lane = |list: &[f64], i: usize| list[i.min(list.len() - 1)] as f32;
        let row = |first: usize| [&x, &y, &z].map(|list| std::array::from_fn(|k| lane(list, first + k)));
        let block = |n: usize| std::array::from_fn(|r| row(n * BLOCK + r * LANES));
        let blocks = (0..x.len().div_ceil(BLOCK)).map(block).collect();
        let mut set = Self { x, y, z, inside, core: Vec::with_capacity(2 * FIRST_AXES), blocks, ranges: Vec::new() };
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
            self.core.push(Vector3::new(self.x[index], self.y[index], self.z[index]));
        }
        new
    }

    /// A first pass in f32, with independent minima and maxima that the compiler vectorizes, finds the extremes of blocks; a second one in f64 the
    /// values and indices in the blocks that may have them.
    fn extremes(&mut self, axis: &Vector3<f64>) -> Extremes {
        /// Margin for the rounding of a value in f32 (clouds have unit size); far above it.
        const ROUNDING: f32 = 2e-6;
        let (lesser, greater) =
            (|a: f32, b: f32| if a < b { a } else { b }, |a: f32, b: f32| if a > b { a } else { b });
        let [x, y, z] = [axis.x, axis.y, axis.z].map(|x| x as f32);
        self.ranges.clear();
        for block in &self.blocks {
            let (mut low, mut high) = ([f32::INFINITY; LANES], [f32::NEG_INFINITY; LANES]);
            for [xs, ys, zs] in block {
                for k in 0..LANES {
                    let v = x * xs[k] + y * ys[k] + z * zs[k];
                    low[k] = lesser(v, low[k]);
                    high[k] = greater(v, high[k]);
                }
            }
            let range =
                [low.into_iter().fold(f32::INFINITY, lesser), high.into_iter().fold(f32::NEG_INFINITY, greater)];
            self.ranges.push(range);
        }
        let least = self.ranges.iter().fold(f32::INFINITY, |least, range| lesser(range[0], least));
        let greatest = self.ranges.iter().fold(f32::NEG_INFINITY, |greatest, range| greater(range[1], greatest));
        let low = self.first(axis, 1.0, |range| range[0] <= least + ROUNDING);
        let high = self.first(axis, -1.0, |range| range[1] >= greatest - ROUNDING);
        Extremes { least: low, greatest: (-high.0, high.1) }
    }

    /// The least value along `axis`, times `sign`, in the blocks whose range may have it, and the first index within [`TIE`].
    fn first(&self, axis: &Vector3<f64>, sign: f64, may: impl Fn(&[f32; 2]) -> bool) -> (f64, usize) {
        let blocks = || self.ranges.iter().enumerate().filter(|(_, range)| may(range));
        let indices = || blocks().flat_map(|(block, _)| block * BLOCK..((block + 1) * BLOCK).min(self.x.len()));
        let value = |i: usize| sign * (axis.x * self.x[i] + axis.y * self.y[i] + axis.z * self.z[i]);
        let least = indices().map(value).fold(f64::INFINITY, f64::min);
        (least, indices().find(|&i| value(i) <= least + TIE).unwrap_or(0))
    }
}

struct Extremes {
    least: (f64, usize),
    greatest: (f64, usize),
}
