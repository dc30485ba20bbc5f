//! Which points of a cloud lie farthest along given directions.

use nalgebra::{Point3, Vector3};
use std::ops::Range;

/// Points in columns, so that the compiler compares several at once.
pub(super) struct Columns {
    x: Vec<f64>,
    y: Vec<f64>,
    z: Vec<f64>,
}

impl Columns {
    pub fn new<'a>(points: impl Iterator<Item = &'a Point3<f64>> + Clone) -> Self {
        let column = |k: usize| points.clone().map(|p| p[k]).collect();
        Self { x: column(0), y: column(1), z: column(2) }
    }

    /// Greatest height along `direction` of the points in `range`, and the first point that has it.
    pub fn farthest(&self, range: Range<usize>, direction: &Vector3<f64>) -> (f64, usize) {
        /// Points of a block.
        const BLOCK: usize = 32;
        /// Running maxima, so that one need not wait for the other.
        const LANES: usize = 8;
        let height = |x: f64, y: f64, z: f64| x * direction.x + y * direction.y + z * direction.z;
        let (mut best, mut place) = (f64::NEG_INFINITY, range.start);
        let [x, y, z] = [&self.x, &self.y, &self.z].map(|column| &column[range.clone()]);
        for (block, ((x, y), z)) in x.chunks(BLOCK).zip(y.chunks(BLOCK)).zip(z.chunks(BLOCK)).enumerate() {
            let mut high = [f64::NEG_INFINITY; LANES];
            for ((x, y), z) in x.chunks_exact(LANES).zip(y.chunks_exact(LANES)).zip(z.chunks_exact(LANES)) {
                for k in 0..LANES {
                    let v = height(x[k], y[k], z[k]);
                    high[k] = if v > high[k] { v } else { high[k] };
                }
            }
            let rest = (x.len() / LANES * LANES..x.len()).map(|k| height(x[k], y[k], z[k]));
            let most = rest.chain(high).fold(f64::NEG_INFINITY, |a, b| if b > a { b } else { a });
            if most > best {
                (best, place) = (most, range.start + block * BLOCK);
            }
        }
        // The blocks give the height and the rough place; the point itself is looked up once.
        let first = (place..range.end).find(|&i| height(self.x[i], self.y[i], self.z[i]) >= best);
        (best, first.unwrap_or(range.start))
    }
}

/// A number that sorts as [`f64::total_cmp`] does, but faster.
pub(super) fn key(x: f64) -> i64 {
    let bits = x.to_bits() as i64;
    bits ^ (((bits >> 63) as u64) >> 1) as i64
}

/// For each direction the point that lies farthest along it; each point once, ascending.
pub(super) fn supports(points: &[Point3<f64>], directions: &[Vector3<f64>]) -> Vec<usize> {
    let columns = Columns::new(points.iter());
    unique(directions.iter().map(|d| columns.farthest(0..points.len(), d).1))
}

/// Ascending, each once.
pub(super) fn unique(indices: impl Iterator<Item = usize>) -> Vec<usize> {
    let mut chosen: Vec<usize> = indices.collect();
    chosen.sort_unstable();
    chosen.dedup();
    chosen
}
