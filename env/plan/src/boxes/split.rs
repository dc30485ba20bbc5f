//! The best cut of a box (algorithm 5 of the reference study), by three sorts and prefix extents instead of a scan over all pairs.

use super::obb::OrientedBox;
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// The cost that the best cut minimizes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SplitCost {
    /// Area of the two rectangles as a share of their face.
    #[default]
    Share,
    /// Area of the two rectangles in m2, compared across faces: the rule of the reference study.
    Area,
}

/// A cut of a box by a plane across one of its axes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Split {
    /// Axis of the box that the plane cuts across (0 to 2).
    pub axis: usize,
    /// The other axis of the face on which the areas were measured.
    pub across: usize,
    /// Position of the plane along `axis` from the box's centre, metres.
    pub position: f64,
    /// Area of the two rectangles around the projected halves, m2.
    pub area: f64,
    /// `area` over the area of the rectangle around all projected points.
    pub share: f64,
}

impl Split {
    /// Signed distance of `point` from the cutting plane, positive on the far side along the axis, metres.
    pub fn side(&self, bounds: &OrientedBox, point: &Point3<f64>) -> f64 {
        bounds.axes.column(self.axis).dot(&(point - bounds.center)) - self.position
    }
}

/// The best cut of `bounds` for the `points` inside it (both in one frame, metres).
///
/// Each of three faces is cut across either of its axes, between every two neighbouring points. The cost is the total area of the two rectangles
/// around the projections of the halves on the face. A cut lies midway between two points with different coordinates. Ties go to the lower
/// axis, then the lower `across`, then the lower position. `None` if no cut separates points or every face is flat.
///
/// Time: three sorts, O(n log n).
pub fn best_split(points: &[Point3<f64>], bounds: &OrientedBox, cost: SplitCost) -> Option<Split> {
    let local: Vec<Vector3<f64>> = points.iter().map(|p| bounds.local(p)).collect();
    let mut best: Option<Split> = None;
    let mut sweep = Sweep::default();
    for axis in 0..3 {
        sweep.sort(&local, axis);
        let others = [[1, 2], [0, 2], [0, 1]][axis];
        sweep.measure_tail(&local, others);
        sweep.cut(&local, axis, others, |split| {
            let better = best.is_none_or(|b| match cost {
                SplitCost::Share => split.share < b.share * BETTER,
                SplitCost::Area => split.area < b.area * BETTER,
            });
            if better {
                best = Some(split);
            }
        });
    }
    best
}

/// A cost must be lower by this factor to be better, so rounding does not choose.
const BETTER: f64 = 1.0 - 1e-12;

/// Buffers of one sweep along an axis.
#[derive(Default)]
struct Sweep {
    order: Vec<(f64, u32)>,
    /// Extents of `order[i..]` along the two other axes.
    tail: Vec<[Span; 2]>,
}

#[derive(Clone, Copy)]
struct Span {
    low: f64,
    high: f64,
}

impl Span {
    const EMPTY: Self = Self { low: f64::INFINITY, high: f64::NEG_INFINITY };

    fn add(&mut self, x: f64) {
        self.low = if x < self.low { x } else { self.low };
        self.high = if x > self.high { x } else { self.high };
    }

    fn length(&self) -> f64 {
        self.high - self.low
    }
}

impl Sweep {
    fn sort(&mut self, local: &[Vector3<f64>], axis: usize) {
        self.order.clear();
        self.order.extend(local.iter().zip(0u32..).map(|(p, i)| (p[axis], i)));
        self.order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    }

    fn measure_tail(&mut self, local: &[Vector3<f64>], others: [usize; 2]) {
        self.tail.clear();
        self.tail.resize(self.order.len(), [Span::EMPTY; 2]);
        let mut spans = [Span::EMPTY; 2];
        for (slot, &(_, i)) in self.tail.iter_mut().zip(&self.order).rev() {
            let p = &local[i as usize];
            spans[0].add(p[others[0]]);
            spans[1].add(p[others[1]]);
            *slot = spans;
        }
    }

    /// Calls `visit` with the best cut of each of the two faces along `axis`.
    fn cut(&self, local: &[Vector3<f64>], axis: usize, others: [usize; 2], mut visit: impl FnMut(Split)) {
        let (Some(first), Some(last), Some(whole)) = (self.order.first(), self.order.last(), self.tail.first()) else {
            return;
        };
        let (start, end) = (first.0, last.0);
        let mut least = [(f64::INFINITY, 0.0); 2];
        let mut head = [Span::EMPTY; 2];
        for (pair, tail) in self.order.windows(2).zip(&self.tail[1..]) {
            let p = &local[pair[0].1 as usize];
            head[0].add(p[others[0]]);
            head[1].add(p[others[1]]);
            let (below, above) = (pair[0].0, pair[1].0);
            if below == above {
                continue;
            }
            for face in 0..2 {
                let area = (below - start) * head[face].length() + (end - above) * tail[face].length();
                if area < least[face].0 * BETTER {
                    least[face] = (area, 0.5 * (below + above));
                }
            }
        }
        for face in 0..2 {
            let total = (end - start) * whole[face].length();
            let (area, position) = least[face];
            if total > 0.0 && area.is_finite() {
                visit(Split { axis, across: others[face], position, area, share: area / total });
            }
        }
    }
}
