//! The object's points around a closing chain: which links they block.

use super::plane::{Frame, LinkShape, PlanePoint};

/// Points of a block, and blocks that are compared at once.
const POINTS: usize = 8;
const BLOCKS: usize = 4;
/// Margin for the rounding of a point in f32, metres; far above it.
pub(super) const COARSE: f32 = 2e-6;
/// A coordinate of a point that does not exist, metres.
const FAR: f32 = 1e6;

/// Coordinates of several points or balls in f32: the compiler compares them at once.
type Lanes<const N: usize> = [[f32; N]; 2];

/// A ball around each of several blocks: its centre and its radius.
struct Balls {
    at: Lanes<BLOCKS>,
    radius: [f32; BLOCKS],
}

/// A link at a frame, in f32.
pub(super) struct View<'a> {
    link: &'a LinkShape,
    sin: f32,
    cos: f32,
    /// The frame's origin along its own axes.
    origin: [f32; 2],
}

impl<'a> View<'a> {
    pub fn new(link: &'a LinkShape, [x, z]: [f32; 2], sin: f32, cos: f32) -> Self {
        Self { link, sin, cos, origin: [cos * x + sin * z, cos * z - sin * x] }
    }

    /// Distances of balls from the bounds, along the farther of their axes: at most the true ones, negative inside. Branch-free.
    fn gaps<const N: usize>(&self, [x, z]: &Lanes<N>, radius: &[f32; N]) -> [f32; N] {
        let [middle, half] = self.link.middle_and_half;
        let middle = [self.origin[0] + middle[0], self.origin[1] + middle[1]];
        std::array::from_fn(|k| {
            let along = (self.cos * x[k] + self.sin * z[k] - middle[0]).abs() - half[0];
            let above = (self.cos * z[k] - self.sin * x[k] - middle[1]).abs() - half[1];
            (if along > above { along } else { above }) - radius[k]
        })
    }

    /// Whether one of a few points is inside the link: the first one and its rectangle. `None` where rounding decides.
    fn holds(&self, points: &Lanes<POINTS>) -> Option<Option<([f32; 2], usize)>> {
        let mut sure = true;
        let [x, z] = points;
        for (number, rect) in self.link.rects.iter().enumerate() {
            let [[left, right], [low, high]] = [rect.x, rect.z].map(|side| side.map(|x| x as f32));
            // Depth of each point in the rectangle, negative outside.
            let depths: [f32; POINTS] = std::array::from_fn(|k| {
                let along = self.cos * x[k] + self.sin * z[k] - self.origin[0];
                let above = self.cos * z[k] - self.sin * x[k] - self.origin[1];
                lesser(lesser(along - left, right - along), lesser(above - low, high - above))
            });
            if let Some(k) = depths.iter().position(|depth| *depth > COARSE) {
                return Some(Some(([x[k], z[k]], number)));
            }
            sure &= depths.iter().fold(true, |sure, depth| sure & (*depth < -COARSE));
        }
        sure.then_some(None)
    }
}

/// The lesser of two numbers, neither of which is NaN.
fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The least of a multiple of four numbers, none of which is NaN.
fn least<const N: usize>(values: &[f32; N]) -> f32 {
    let mut columns = [FAR; 4];
    for row in values.chunks_exact(4) {
        for (column, x) in columns.iter_mut().zip(row) {
            *column = lesser(*column, *x);
        }
    }
    lesser(lesser(columns[0], columns[1]), lesser(columns[2], columns[3]))
}

/// Result of a comparison of a link with all points.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Found {
    /// No point is inside the link, and none will be until it moves by more than this distance, metres.
    Free(f32),
    /// This point is inside this rectangle of the link.
    Blocked([f32; 2], usize),
}

/// The object's points around one closing chain, in blocks of neighbours.
#[derive(Default)]
pub(super) struct Obstacles {
    points: Vec<[f64; 2]>,
    /// The points of each block, and a ball around it. What is missing in the last ones is far away.
    blocks: Vec<Lanes<POINTS>>,
    balls: Vec<Balls>,
}

impl Obstacles {
    /// Takes the points around the next chain; neighbours should follow each other.
    pub fn set(&mut self, points: &[PlanePoint]) {
        self.points.clear();
        self.points.extend(points.iter().map(|p| [p.x, p.z]));
        self.blocks.clear();
        self.balls.clear();
        for (number, points) in self.points.chunks(POINTS).enumerate() {
            let mut block = [[FAR; POINTS]; 2];
            let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
            for (k, point) in points.iter().enumerate() {
                for axis in 0..2 {
                    let at = point[axis] as f32;
                    block[axis][k] = at;
                    low[axis] = low[axis].min(at);
                    high[axis] = high[axis].max(at);
                }
            }
            self.blocks.push(block);
            if number % BLOCKS == 0 {
                self.balls.push(Balls { at: [[FAR; BLOCKS]; 2], radius: [0.0; BLOCKS] });
            }
            if let Some(balls) = self.balls.last_mut() {
                let half = [0, 1].map(|axis| 0.5 * (high[axis] - low[axis]));
                balls.radius[number % BLOCKS] = half[0].hypot(half[1]) + 2.0 * COARSE;
                (0..2).for_each(|axis| balls.at[axis][number % BLOCKS] = 0.5 * (low[axis] + high[axis]));
            }
        }
    }

    /// Whether one of all points is inside a link; `None` where rounding decides.
    pub fn find(&self, view: &View<'_>) -> Option<Found> {
        let mut clearance = FAR;
        for (balls, blocks) in self.balls.iter().zip(self.blocks.chunks(BLOCKS)) {
            let gaps = view.gaps(&balls.at, &balls.radius);
            for (block, gap) in blocks.iter().zip(gaps) {
                let free = if gap > 0.0 { gap } else { least(&view.gaps(block, &[2.0 * COARSE; POINTS])) };
                clearance = lesser(clearance, free);
                if free <= 0.0
                    && let Some((point, rect)) = view.holds(block)?
                {
                    return Some(Found::Blocked(point, rect));
                }
            }
        }
        Some(Found::Free(clearance))
    }

    /// True if a point is inside the link at this frame.
    pub fn block(&self, link: &LinkShape, frame: &Frame) -> bool {
        self.points.iter().any(|point| link.holds(frame, *point))
    }
}
