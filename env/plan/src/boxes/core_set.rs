//! A few extreme points that stand for a whole cloud.
//!
//! A box around the core set is never larger than the box around the cloud with the same axes, so a search on the core set gives lower
//! bounds; the points that stick out of a box found there join the core set until bound and truth agree.

use graspbox_mesh::fibonacci_zone;
use nalgebra::{Matrix3, Vector3};

/// Axes along which the first extreme points are taken: two points each, about 16 degrees apart.
const FIRST_AXES: usize = 64;
/// Points this close in height (clouds have unit size) are equally extreme, and the first is taken: rounding must not choose.
const TIE: f64 = 1e-10;

/// `count` directions spread evenly over half the unit sphere.
pub(crate) fn half_sphere(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    fibonacci_zone(count, [0.0, 1.0])
}

/// A cloud, with the core set that stands for it.
pub(crate) struct CoreSet {
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
    inside: Vec<bool>,
    core: Vec<Vector3<f64>>,
}

impl CoreSet {
    /// Takes the cloud and picks its extreme points along evenly spread axes.
    pub fn new(points: impl Iterator<Item = Vector3<f64>> + Clone) -> Self {
        let x: Vec<f64> = points.clone().map(|p| p.x).collect();
        let y: Vec<f64> = points.clone().map(|p| p.y).collect();
        let z: Vec<f64> = points.map(|p| p.z).collect();
        let inside = vec![false; x.len()];
        let mut set = Self { x, y, z, inside, core: Vec::with_capacity(2 * FIRST_AXES) };
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

    /// Side lengths of the box with these axes around the whole cloud; its extreme points join the core set.
    /// The second value tells whether any of them was new.
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

    /// Eight independent running minima and maxima let the compiler keep the pass in vector registers; a second pass finds the indices.
    fn extremes(&self, axis: &Vector3<f64>) -> Extremes {
        const LANES: usize = 8;
        let value = |i: usize| axis.x * self.x[i] + axis.y * self.y[i] + axis.z * self.z[i];
        let mut low = [f64::INFINITY; LANES];
        let mut high = [f64::NEG_INFINITY; LANES];
        let rows = self.x.chunks_exact(LANES).zip(self.y.chunks_exact(LANES)).zip(self.z.chunks_exact(LANES));
        for ((x, y), z) in rows {
            for k in 0..LANES {
                let v = axis.x * x[k] + axis.y * y[k] + axis.z * z[k];
                low[k] = if v < low[k] { v } else { low[k] };
                high[k] = if v > high[k] { v } else { high[k] };
            }
        }
        let tail = self.x.len() / LANES * LANES..self.x.len();
        let least = tail.clone().map(value).chain(low).fold(f64::INFINITY, f64::min);
        let greatest = tail.map(value).chain(high).fold(f64::NEG_INFINITY, f64::max);
        // For the greatest, value and limit change their signs.
        let first = |sign: f64, limit: f64| {
            let hit = |i: usize| sign * value(i) <= limit;
            let rows = 0..self.x.len() / LANES;
            let row = rows.clone().find(|row| (row * LANES..(row + 1) * LANES).fold(false, |any, i| any | hit(i)));
            (row.unwrap_or(rows.end) * LANES..self.x.len()).find(|&i| hit(i)).unwrap_or(0)
        };
        Extremes { least: (least, first(1.0, least + TIE)), greatest: (greatest, first(-1.0, TIE - greatest)) }
    }
}

struct Extremes {
    least: (f64, usize),
    greatest: (f64, usize),
}
