//! All halvings of a step along one direction at once, in f32: most of a closing chain's steps are blocked by a point that blocked it before.

use super::obstacles::{COARSE, View};
use super::plane::{Frame, LinkShape, PlaneTable, Rect};
use super::{HALVINGS, Motion, STEP, Segment};
use crate::Lanes;
use parry3d_f64::glamx::glam::BVec4A;

/// A number for each halving of a step.
pub(super) const STEPS: usize = HALVINGS + 1;
/// A mask of each halving and those after it.
const FROM: [BVec4A; STEPS] = [
    BVec4A::new(true, true, true, true),
    BVec4A::new(false, true, true, true),
    BVec4A::new(false, false, true, true),
    BVec4A::new(false, false, false, true),
];
/// A bit for each halving.
pub(super) const ALL: u32 = (1 << STEPS) - 1;

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
    Lanes::from_array(std::array::from_fn(|k| value(k) as f32))
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
    pub const ORIGIN: Self = Self { x: Lanes::ZERO, z: Lanes::ZERO, sin: Lanes::ZERO, cos: Lanes::ONE };

    /// * `before`: frames of the link before; `now`: the frame at present; `at`: the coordinate at present.
    pub fn place(before: &Self, segment: &Segment, motion: &LinkMotion, now: &Frame, at: f64) -> Self {
        let [mut x, mut z] = segment.at.map(|x| Lanes::splat(x as f32));
        if let Motion::Slide(along) = segment.motion {
            let moved = motion.moved + Lanes::splat((segment.ratio * at) as f32);
            x += moved * along[0] as f32;
            z += moved * along[1] as f32;
        }
        let (sin, cos) = (Lanes::splat(now.sin as f32), Lanes::splat(now.cos as f32));
        Self {
            x: before.x + before.cos * x - before.sin * z,
            z: before.z + before.sin * x + before.cos * z,
            sin: sin * motion.cos + cos * motion.sin,
            cos: cos * motion.cos - sin * motion.sin,
        }
    }

    /// The link after the step halved `halving` times.
    pub fn view<'a>(&self, link: &'a LinkShape, halving: usize) -> View<'a> {
        View::new(link, [self.x[halving], self.z[halving]], self.sin[halving], self.cos[halving])
    }

    /// The halvings for which the points that blocked a link surely do so again, as bits.
    pub fn blocked(&self, by: &Witnesses) -> u32 {
        let (x, z) = (by.x - self.x, by.z - self.z);
        let along = self.cos * x + self.sin * z - by.middle[0];
        let above = self.cos * z - self.sin * x - by.middle[1];
        (along.abs().cmplt(by.half[0]) & above.abs().cmplt(by.half[1])).bitmask()
    }

    /// The halvings for which the bounds of the link are surely above the table, as bits.
    pub fn clear_table(&self, bounds: &Rect, table: &PlaneTable) -> u32 {
        let normal = table.normal.map(|x| Lanes::splat(x as f32));
        let offset = Lanes::splat(table.offset as f32 + COARSE);
        let [x, z] = [bounds.x, bounds.z].map(|side| side.map(|x| Lanes::splat(x as f32)));
        let least = |reach: Lanes, side: [Lanes; 2]| (reach * side[0]).min(reach * side[1]);
        let along = normal[0] * self.cos + normal[1] * self.sin;
        let above = normal[1] * self.cos - normal[0] * self.sin;
        let height = normal[0] * self.x + normal[1] * self.z;
        (height + least(along, x) + least(above, z)).cmpgt(offset).bitmask()
    }
}

impl Frames {
    /// Whether the link is above the table after the step halved `halving` times; `None` where rounding decides.
    pub fn clears_table(&self, link: &LinkShape, halving: usize, table: &PlaneTable) -> Option<bool> {
        let normal = table.normal.map(|x| x as f32);
        let (sin, cos) = (self.sin[halving], self.cos[halving]);
        let (along, above) = (normal[0] * cos + normal[1] * sin, normal[1] * cos - normal[0] * sin);
        let height = normal[0] * self.x[halving] + normal[1] * self.z[halving] - table.offset as f32;
        let lowest = link
            .corners_in_lanes
            .iter()
            .fold(Lanes::INFINITY, |lowest, [x, z]| lowest.min(Lanes::splat(height) + *x * along + *z * above));
        let lowest = lowest.min_element();
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
    pub const NONE: Self = Self { x: Lanes::ZERO, z: Lanes::ZERO, middle: [Lanes::ZERO; 2], half: [Lanes::NEG_ONE; 2] };

    /// Keeps a point that blocked the step halved `halving` times, for it and for the smaller ones, which come next.
    ///
    /// * `rect`: middle and half sides of its rectangle.
    pub fn keep(&mut self, halving: usize, point: [f32; 2], [middle, half]: &[[Lanes; 2]; 2]) {
        let put = |lanes: &mut Lanes, value: Lanes| *lanes = Lanes::select(FROM[halving], value, *lanes);
        put(&mut self.x, Lanes::splat(point[0]));
        put(&mut self.z, Lanes::splat(point[1]));
        for axis in 0..2 {
            put(&mut self.middle[axis], middle[axis]);
            put(&mut self.half[axis], half[axis] - Lanes::splat(COARSE));
        }
    }
}
