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
}

impl CoreSet {
    /// Starts with the extreme points of the cloud along evenly spread axes.
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

    /// The first pass keeps eight independent minima and maxima, which the compiler vectorizes; a second pass finds the indices.
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
        // For the maximum, value and limit change sign.
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
