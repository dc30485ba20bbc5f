//! Points in compact blocks: which of them lie farthest along many directions, on either side of many planes.
//!
//! A block whose bounds do not reach as far as a point that is known is skipped, so a query costs little more than one comparison
//! per block. The answers are those of a search through all points in the order in which the plane meets them.

use super::extremes::key;
use nalgebra::{Point3, Vector3};

/// Points of a block.
const BLOCK: usize = 16;
/// Blocks of a group.
const GROUP: usize = 16;
/// Cells along each side of the bounds that separate neighbours from others: a power of two.
const CELLS: f64 = 1024.0;
/// Rounding of a height, as a share of the greatest coordinate: far above that of f64.
const ROUNDING: f64 = 1e-12;

/// The numbers of points in an order in which neighbours follow each other: along a Z-order curve (Morton, 1966).
pub(super) fn spatial_order(points: &[Point3<f64>]) -> Vec<u32> {
    let Some(first) = points.first() else { return Vec::new() };
    let (min, max) = points.iter().fold((*first, *first), |(min, max), p| (min.inf(p), max.sup(p)));
    let scale = (CELLS - 1.0) / (max - min).amax().max(f64::MIN_POSITIVE);
    // Every third bit of 10.
    let spread = |x: f64| (0..10).fold(0_u64, |all, bit| all | ((x * scale) as u64 >> bit & 1) << (3 * bit));
    let code = |p: &Point3<f64>| spread(p.x - min.x) | spread(p.y - min.y) << 1 | spread(p.z - min.z) << 2;
    let mut codes: Vec<u64> = points.iter().zip(0..).map(|(p, i): (_, u64)| code(p) << 32 | i).collect();
    codes.sort_unstable();
    codes.into_iter().map(|code| code as u32).collect()
}

/// Points in blocks, and how far the blocks reach along each direction.
pub(super) struct Cloud<'a> {
    points: &'a [Point3<f64>],
    directions: &'a [Vector3<f64>],
    /// Numbers of the points, block by block.
    order: Vec<u32>,
    /// For each direction and block, a height that no point of the block exceeds.
    reach: Vec<f64>,
    /// The same for each direction and group of blocks.
    reach_of_groups: Vec<f64>,
    blocks: usize,
}

impl<'a> Cloud<'a> {
    /// * `order`: as [`spatial_order`] returns it.
    pub fn new(points: &'a [Point3<f64>], order: Vec<u32>, directions: &'a [Vector3<f64>]) -> Self {
        let bounds = order.chunks(BLOCK).map(|block| {
            let first = points[block[0] as usize];
            let fold = |(min, max): (Point3<f64>, Point3<f64>), i: &u32| {
                (min.inf(&points[*i as usize]), max.sup(&points[*i as usize]))
            };
            let (min, max) = block.iter().fold((first, first), fold);
            (
                nalgebra::center(&min, &max).coords,
                (max - min) / 2.0,
                ROUNDING * (min.coords.amax().max(max.coords.amax())),
            )
        });
        let bounds: Vec<_> = bounds.collect();
        let reach = directions
            .iter()
            .flat_map(|d| bounds.iter().map(move |(center, half, slack)| center.dot(d) + half.dot(&d.abs()) + slack));
        let reach: Vec<f64> = reach.collect();
        let most = |group: &[f64]| group.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let reach_of_groups = reach.chunks(bounds.len().max(1)).flat_map(|row| row.chunks(GROUP).map(most)).collect();
        Self { points, directions, reach, reach_of_groups, blocks: bounds.len(), order }
    }

    /// For each direction the first of the points that lie farthest along it; each once, ascending.
    pub fn supports(&self) -> Vec<u32> {
        if self.points.is_empty() {
            return Vec::new();
        }
        let whole = |_: u32| 0;
        self.farthest_where(&vec![true; self.blocks], |_| true, whole)
    }

    /// The same of the points below and of those above the plane that halves the width along `normal`, in the order in which it meets them;
    /// `None` when one side is empty.
    pub fn supports_of_halves(&self, normal: &Vector3<f64>) -> Option<[Vec<u32>; 2]> {
        let heights: Vec<f64> = self.points.iter().map(|p| normal.dot(&p.coords)).collect();
        let [least, greatest] =
            heights.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], h| [a.min(*h), b.max(*h)]);
        let offset = least + 0.5 * (greatest - least);
        let below = |i: u32| heights[i as usize] < offset;
        let side = |wanted: bool| {
            let with: Vec<bool> =
                self.order.chunks(BLOCK).map(|block| block.iter().any(|i| below(*i) == wanted)).collect();
            let any = with.contains(&true);
            any.then(|| self.farthest_where(&with, |i| below(i) == wanted, |i| key(heights[i as usize])))
        };
        Some([side(true)?, side(false)?])
    }

    /// For each direction the farthest of the points for which `counts`; of equals, and in the answer, the first by `rank` and number.
    ///
    /// * `with`: the blocks that hold such points; at least one does.
    fn farthest_where(&self, with: &[bool], counts: impl Fn(u32) -> bool, rank: impl Fn(u32) -> i64) -> Vec<u32> {
        let mut found: Vec<(i64, u32)> = Vec::with_capacity(self.directions.len());
        let groups = self.blocks.div_ceil(GROUP);
        let with_groups: Vec<bool> = with.chunks(GROUP).map(|group| group.contains(&true)).collect();
        for (number, direction) in self.directions.iter().enumerate() {
            let reach = &self.reach[number * self.blocks..(number + 1) * self.blocks];
            let reach_of_groups = &self.reach_of_groups[number * groups..(number + 1) * groups];
            let mut best = Farthest::default();
            best_first(reach_of_groups, &with_groups, &mut best, |group, best| {
                let blocks = group * GROUP..self.blocks.min((group + 1) * GROUP);
                best_first(&reach[blocks.clone()], &with[blocks.clone()], best, |block, best| {
                    let first = (blocks.start + block) * BLOCK;
                    for &i in &self.order[first..self.order.len().min(first + BLOCK)] {
                        let p = &self.points[i as usize];
                        let height = p.x * direction.x + p.y * direction.y + p.z * direction.z;
                        if height >= best.height && counts(i) {
                            best.offer(height, (rank(i), i));
                        }
                    }
                });
            });
            found.push(best.place);
        }
        found.sort_unstable();
        found.dedup();
        found.into_iter().map(|(_, i)| i).collect()
    }
}

/// The farthest point found so far.
struct Farthest {
    height: f64,
    /// Its rank and number.
    place: (i64, u32),
}

impl Default for Farthest {
    fn default() -> Self {
        Self { height: f64::NEG_INFINITY, place: (i64::MAX, u32::MAX) }
    }
}

impl Farthest {
    /// * `height`: not below the present one.
    fn offer(&mut self, height: f64, place: (i64, u32)) {
        if height > self.height || place < self.place {
            *self = Self { height, place };
        }
    }
}

/// Searches the entry of `with` that reaches farthest, and then those that reach as far as the best so far.
fn best_first(reach: &[f64], with: &[bool], best: &mut Farthest, mut look: impl FnMut(usize, &mut Farthest)) {
    let mut first = None;
    for (i, (reach, with)) in reach.iter().zip(with).enumerate() {
        if *with && *reach >= best.height && first.is_none_or(|(_, most)| *reach > most) {
            first = Some((i, *reach));
        }
    }
    let Some((first, _)) = first else { return };
    look(first, best);
    for i in (0..reach.len()).filter(|i| *i != first) {
        if with[i] && reach[i] >= best.height {
            look(i, best);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::fibonacci_sphere;

    /// Points of a bumpy ball, many of them twice.
    fn points() -> Vec<Point3<f64>> {
        let place = |(i, d): (usize, &Vector3<f64>)| Point3::from(d * (0.1 + 0.03 * ((i % 7) as f64)));
        let once: Vec<_> = fibonacci_sphere(700).iter().enumerate().map(place).collect();
        once.iter().chain(once.iter().step_by(3)).copied().collect()
    }

    #[test]
    fn blocks_give_the_answers_of_a_search_through_all_points() {
        let (points, directions) = (points(), fibonacci_sphere(40));
        let cloud = Cloud::new(&points, spatial_order(&points), &directions);
        let height = |i: u32, d: &Vector3<f64>| d.dot(&points[i as usize].coords);
        let search = |order: &[u32]| {
            let first = |d: &Vector3<f64>| {
                (0..order.len()).reduce(|a, b| if height(order[b], d) > height(order[a], d) { b } else { a })
            };
            let mut found: Vec<usize> = directions.iter().filter_map(first).collect();
            found.sort_unstable();
            found.dedup();
            found.into_iter().map(|place| order[place]).collect::<Vec<u32>>()
        };
        let all: Vec<u32> = (0..points.len() as u32).collect();
        assert_eq!(cloud.supports(), search(&all));
        for normal in [Vector3::x(), Vector3::new(0.36, -0.48, 0.8)] {
            let mut sorted = all.clone();
            sorted.sort_by_key(|i| (key(height(*i, &normal)), *i));
            let [low, high] = [sorted[0], sorted[sorted.len() - 1]].map(|i| height(i, &normal));
            let at = sorted.partition_point(|i| height(*i, &normal) < low + 0.5 * (high - low));
            let halves = [search(&sorted[..at]), search(&sorted[at..])];
            assert_eq!(cloud.supports_of_halves(&normal), Some(halves));
        }
        let flat = vec![Point3::new(0.1, 0.2, 0.3); 20];
        assert_eq!(Cloud::new(&flat, spatial_order(&flat), &directions).supports_of_halves(&Vector3::x()), None);
    }
}
