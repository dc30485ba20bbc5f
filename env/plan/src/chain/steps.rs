//! All halvings of a step along one direction at once, in f32: most of a closing chain's steps are blocked by a point that blocked it before.

use super::obstacles::{COARSE, View};
use super::plane::{Frame, LinkShape, PlaneTable, Rect};
use super::{HALVINGS, Motion, STEP, Segment};

/// A number for each halving of a step.
pub(super) const STEPS: usize = HALVINGS + 1;
pub(super) type Lanes = [f32; STEPS];

/// How a link moves along a direction.
#[derive(Clone, Debug)]
pub(super) struct LinkMotion {
    /// Sine and cosine of the angle by which it turns.
    sin: Lanes,
    cos: Lanes,
    /// Change of its own coordinate, times its ratio.
    moved: Lanes,
    /// Greatest distance by which any of its points moves, metres.
    pub travel: Lanes,
}

fn lanes(value: impl Fn(usize) -> f64) -> Lanes {
    std::array::from_fn(|k| value(k) as f32)
}

/// The motion of every link along `direction`.
///
/// * `slides`: greatest displacement of each segment by its own joint, metres; 0 for one that turns.
pub(super) fn motions(segments: &[Segment], slides: &[f64], direction: &[f64]) -> Vec<LinkMotion> {
    let rate = |segment: &Segment| segment.ratio * direction[segment.coordinate];
    let step = |k: usize| STEP / f64::from(1_u32 << k);
    let (mut turn, mut all) = (0.0, Vec::with_capacity(segments.len()));
    for (outer, segment) in segments.iter().enumerate() {
        turn += if segment.motion == Motion::Turn { rate(segment) } else { 0.0 };
        // From the link's farthest corner to each joint before it.
        let (mut arm, mut travel) = (segment.shape.furthest_corner(), 0.0);
        for (inner, slide) in segments[..=outer].iter().zip(slides).rev() {
            travel += rate(inner).abs() * if inner.motion == Motion::Turn { arm } else { 1.0 };
            arm += inner.at[0].hypot(inner.at[1]) + slide;
        }
        all.push(LinkMotion {
            sin: lanes(|k| (turn * step(k)).sin()),
            cos: lanes(|k| (turn * step(k)).cos()),
            moved: lanes(|k| rate(segment) * step(k)),
            travel: lanes(|k| travel * step(k)),
        });
    }
    all
}

/// Frames of a link after each halving of a step.
#[derive(Clone, Copy)]
pub(super) struct Frames {
    x: Lanes,
    z: Lanes,
    sin: Lanes,
    cos: Lanes,
}

impl Frames {
    /// The frames before the first link.
    pub const ORIGIN: Self = Self { x: [0.0; STEPS], z: [0.0; STEPS], sin: [0.0; STEPS], cos: [1.0; STEPS] };

    /// * `before`: frames of the link before; `now`: the frame at present; `at`: the coordinate at present.
    pub fn place(before: &Self, segment: &Segment, motion: &LinkMotion, now: &Frame, at: f64) -> Self {
        let mut frames = Self { ..Self::ORIGIN };
        let (sin, cos, place) = (now.sin as f32, now.cos as f32, segment.at.map(|x| x as f32));
        let (slide, moved) = match segment.motion {
            Motion::Turn => ([0.0; 2], 0.0),
            Motion::Slide(along) => (along.map(|x| x as f32), (segment.ratio * at) as f32),
        };
        for k in 0..STEPS {
            let x = place[0] + slide[0] * (moved + motion.moved[k]);
            let z = place[1] + slide[1] * (moved + motion.moved[k]);
            frames.x[k] = before.x[k] + before.cos[k] * x - before.sin[k] * z;
            frames.z[k] = before.z[k] + before.sin[k] * x + before.cos[k] * z;
            frames.sin[k] = sin * motion.cos[k] + cos * motion.sin[k];
            frames.cos[k] = cos * motion.cos[k] - sin * motion.sin[k];
        }
        frames
    }

    /// The link after the step halved `halving` times.
    pub fn view<'a>(&self, link: &'a LinkShape, halving: usize) -> View<'a> {
        View::new(link, [self.x[halving], self.z[halving]], self.sin[halving], self.cos[halving])
    }

    /// Where the points that blocked a link surely do so again.
    pub fn blocked(&self, by: &Witnesses) -> [bool; STEPS] {
        std::array::from_fn(|k| {
            let (x, z) = (by.x[k] - self.x[k], by.z[k] - self.z[k]);
            let along = self.cos[k] * x + self.sin[k] * z - by.middle[0][k];
            let above = self.cos[k] * z - self.sin[k] * x - by.middle[1][k];
            (along.abs() < by.half[0][k]) & (above.abs() < by.half[1][k])
        })
    }

    /// Where the bounds of the link are surely above the table.
    pub fn clear_table(&self, bounds: &Rect, table: &PlaneTable) -> [bool; STEPS] {
        let normal = table.normal.map(|x| x as f32);
        let offset = table.offset as f32 + COARSE;
        let [x, z] = [bounds.x, bounds.z].map(|side| side.map(|x| x as f32));
        let least = |reach: f32, side: [f32; 2]| {
            let (a, b) = (reach * side[0], reach * side[1]);
            if a < b { a } else { b }
        };
        std::array::from_fn(|k| {
            let along = normal[0] * self.cos[k] + normal[1] * self.sin[k];
            let above = normal[1] * self.cos[k] - normal[0] * self.sin[k];
            let height = normal[0] * self.x[k] + normal[1] * self.z[k];
            height + least(along, x) + least(above, z) > offset
        })
    }
}

impl Frames {
    /// Whether the link is above the table after the step halved `halving` times; `None` where rounding decides.
    pub fn clears_table(&self, link: &LinkShape, halving: usize, table: &PlaneTable) -> Option<bool> {
        let normal = table.normal.map(|x| x as f32);
        let (sin, cos) = (self.sin[halving], self.cos[halving]);
        let (along, above) = (normal[0] * cos + normal[1] * sin, normal[1] * cos - normal[0] * sin);
        let height = normal[0] * self.x[halving] + normal[1] * self.z[halving] - table.offset as f32;
        let mut lowest = f32::INFINITY;
        for rect in &link.rects {
            for (x, z) in rect.upper_corners() {
                lowest = lowest.min(height + along * x as f32 + above * z as f32);
            }
        }
        (lowest.abs() > COARSE).then_some(lowest > 0.0)
    }
}

/// For each halving of a step along a direction, a point that blocked a link there, and the middle and the half sides of its rectangle, a margin
/// smaller.
#[derive(Clone, Copy)]
pub(super) struct Witnesses {
    x: Lanes,
    z: Lanes,
    middle: [Lanes; 2],
    half: [Lanes; 2],
}

impl Witnesses {
    pub const NONE: Self =
        Self { x: [0.0; STEPS], z: [0.0; STEPS], middle: [[0.0; STEPS]; 2], half: [[-1.0; STEPS]; 2] };

    /// Keeps a point that blocked the step halved `halving` times, for it and for the smaller ones, which come next.
    pub fn keep(&mut self, halving: usize, point: [f32; 2], rect: &Rect) {
        for k in halving..STEPS {
            (self.x[k], self.z[k]) = (point[0], point[1]);
            for (axis, [low, high]) in [rect.x, rect.z].into_iter().enumerate() {
                self.middle[axis][k] = (0.5 * (low + high)) as f32;
                self.half[axis][k] = (0.5 * (high - low)) as f32 - COARSE;
            }
        }
    }
}
