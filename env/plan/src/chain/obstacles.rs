//! The object's points around a closing chain: which links they block.

use super::plane::{Frame, LinkShape, PlanePoint};
use crate::Lanes;
use parry3d_f64::glamx::glam::BVec4A;

/// Most points of a block, and blocks that are compared at once.
pub(crate) const POINTS: usize = 8;
const BLOCKS: usize = 4;
/// Margin for the rounding of a point in f32, metres; far above it.
pub(super) const COARSE: f32 = 2e-6;
/// A coordinate of a point that does not exist, metres.
const FAR: f32 = 1e6;
/// A mask of each lane.
const LANE: [BVec4A; BLOCKS] = [
    BVec4A::new(true, false, false, false),
    BVec4A::new(false, true, false, false),
    BVec4A::new(false, false, true, false),
    BVec4A::new(false, false, false, true),
];
/// Place of a block whose points are not known.
const UNKNOWN: u32 = u32::MAX;

/// A disc around each of several blocks: its centre and its radius.
#[derive(Clone, Copy)]
struct Discs {
    at: [Lanes; 2],
    radius: Lanes,
}

/// A block whose points are known.
struct Block {
    lanes: [[Lanes; 2]; 2],
    /// Where its points are in the list of all.
    points: [u32; 2],
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

    /// Distances of points from the bounds, along the farther of their axes: at most the true ones, negative inside.
    fn gaps(&self, [x, z]: [Lanes; 2]) -> Lanes {
        let [middle, half] = self.link.middle_and_half;
        let [along, above] = self.inward([x, z]);
        let along = (along - Lanes::splat(middle[0])).abs() - Lanes::splat(half[0]);
        let above = (above - Lanes::splat(middle[1])).abs() - Lanes::splat(half[1]);
        along.max(above)
    }

    /// Points in the frame of the link.
    fn inward(&self, [x, z]: [Lanes; 2]) -> [Lanes; 2] {
        let (sin, cos) = (Lanes::splat(self.sin), Lanes::splat(self.cos));
        [cos * x + sin * z - Lanes::splat(self.origin[0]), cos * z - sin * x - Lanes::splat(self.origin[1])]
    }
}

/// Result of a comparison of a link with all points.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Found {
    /// No point is inside the link.
    Free,
    /// A point is inside the link: if it surely is, with its rectangle.
    Blocked(Option<([f32; 2], usize)>),
}

/// Appends the points of a block, at most [`POINTS`]; called once for each block that comes near a link.
pub(crate) type Fill<'a> = &'a dyn Fn(usize, &mut Vec<PlanePoint>);

/// A link of a chain, in f32, and how far it has moved.
pub(super) struct Moving<'a> {
    /// Its number, and the link after the step that is tried.
    pub which: usize,
    pub view: View<'a>,
    /// Sum of the greatest distances by which its points have moved until now, and that of the step, metres.
    pub before: f64,
    pub step: f32,
}

/// What changes in [`Obstacles`] once a step is made.
enum Later {
    /// At this place of `due`.
    Due(usize, Lanes),
    /// For this link in `next`.
    Next(usize, f32),
}

/// The object's points around one closing chain, in blocks of neighbours.
#[derive(Default)]
pub(super) struct Obstacles {
    discs: Vec<Discs>,
    /// For each link and block, the sum of distances that the link may have moved before a point of the block can be inside it, the least of four of
    /// these, and that of all.
    due: Vec<Lanes>,
    least: Vec<f32>,
    next: Vec<f32>,
    /// What changes once the step that is tried is made.
    later: Vec<Later>,
    /// Of each link, the block that blocked it last.
    last: Vec<Option<usize>>,
    /// For each block, its place in `blocks`; [`UNKNOWN`] for one that nothing came near.
    places: Vec<u32>,
    blocks: Vec<Block>,
    points: Vec<PlanePoint>,
}

impl Obstacles {
    /// Takes the blocks around the next chain, each as a disc around its points (centre and radius, metres).
    pub fn set(&mut self, links: usize, discs: impl Iterator<Item = ([f64; 2], f64)>) {
        self.discs.clear();
        self.places.clear();
        self.blocks.clear();
        self.points.clear();
        for ([x, z], radius) in discs {
            let k = self.places.len() % BLOCKS;
            if k == 0 {
                self.discs.push(Discs { at: [Lanes::splat(FAR); 2], radius: Lanes::ZERO });
            }
            if let Some(discs) = self.discs.last_mut() {
                (discs.at[0][k], discs.at[1][k]) = (x as f32, z as f32);
                discs.radius[k] = radius as f32 + 3.0 * COARSE;
            }
            self.places.push(UNKNOWN);
        }
        self.due.clear();
        self.due.resize(links * self.discs.len(), Lanes::NEG_ONE);
        self.least.clear();
        self.least.resize(links * self.discs.len(), -1.0);
        self.next.clear();
        self.next.resize(links, if self.discs.is_empty() { FAR } else { -1.0 });
        self.later.clear();
        self.last.clear();
        self.last.resize(links, None);
    }

    /// The place of a block, whose points are then known.
    fn place(&mut self, number: usize, fill: Fill<'_>) -> usize {
        if self.places[number] == UNKNOWN {
            self.places[number] = self.blocks.len() as u32;
            self.read(number, fill);
        }
        self.places[number] as usize
    }

    /// Reads the points of a block.
    #[cold]
    fn read(&mut self, number: usize, fill: Fill<'_>) {
        let first = self.points.len();
        fill(number, &mut self.points);
        let points = &self.points[first..];
        let mut lanes = [[FAR; POINTS]; 2];
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for (k, point) in points.iter().enumerate().take(POINTS) {
            for (axis, at) in [point.x as f32, point.z as f32].into_iter().enumerate() {
                lanes[axis][k] = at;
                low[axis] = low[axis].min(at);
                high[axis] = high[axis].max(at);
            }
        }
        let half = |k: usize| [0, 1].map(|axis| Lanes::from_slice(&lanes[axis][k * BLOCKS..]));
        self.blocks.push(Block { lanes: [half(0), half(1)], points: [first as u32, self.points.len() as u32] });
        // The smaller disc around its points.
        let (discs, k) = (&mut self.discs[number / BLOCKS], number % BLOCKS);
        let empty = low[0] > high[0];
        for axis in 0..2 {
            discs.at[axis][k] = if empty { FAR } else { 0.5 * (low[axis] + high[axis]) };
        }
        discs.radius[k] = if empty { 0.0 } else { 0.5 * (high[0] - low[0]).hypot(high[1] - low[1]) + 3.0 * COARSE };
    }

    /// Whether one of all points is inside a link after a step.
    ///
    /// * `exactly`: whether one of a few points is, where rounding decides.
    pub fn find(&mut self, link: &Moving<'_>, fill: Fill<'_>, exactly: impl Fn(&[PlanePoint]) -> bool) -> Found {
        // Often the block that blocked the link last does so again.
        if let Some(last) = self.last[link.which]
            && let Err(found) = self.approach(last, &link.view, fill, &exactly)
        {
            return found;
        }
        let before = link.before as f32;
        let limit = before + link.step;
        let count = self.discs.len();
        let mut next = FAR;
        for group in 0..count {
            let at = link.which * count + group;
            let least = self.least[at];
            if least >= limit {
                next = if least < next { least } else { next };
                continue;
            }
            let (due, discs) = (self.due[at], &self.discs[group]);
            let mut gaps = link.view.gaps(discs.at) - discs.radius;
            let mut inside = (due.cmplt(Lanes::splat(limit)) & gaps.cmple(Lanes::ZERO)).bitmask();
            while inside != 0 {
                let k = inside.trailing_zeros() as usize;
                inside &= inside - 1;
                match self.approach(group * BLOCKS + k, &link.view, fill, &exactly) {
                    Ok(gap) => gaps = Lanes::select(LANE[k], Lanes::splat(gap), gaps),
                    Err(found) => {
                        self.last[link.which] = Some(group * BLOCKS + k);
                        return found;
                    }
                }
            }
            let then = due.max(gaps + Lanes::splat(limit));
            self.later.push(Later::Due(at, then));
            let least = then.min_element();
            next = if least < next { least } else { next };
            // If the step is not made, it was on the way to what comes near.
            self.put(at, due.max(gaps + Lanes::splat(before - link.step)));
        }
        self.later.push(Later::Next(link.which, next));
        Found::Free
    }

    fn put(&mut self, at: usize, due: Lanes) {
        self.due[at] = due;
        self.least[at] = due.min_element();
    }

    /// Distance of the points of a block from a link, at most 0 where rounding decides.
    ///
    /// # Errors
    /// [`Found::Blocked`] if one of them is inside.
    fn approach(
        &mut self,
        number: usize,
        view: &View<'_>,
        fill: Fill<'_>,
        exactly: impl Fn(&[PlanePoint]) -> bool,
    ) -> Result<f32, Found> {
        let place = self.place(number, fill);
        let Block { lanes, points: [first, end] } = &self.blocks[place];
        let mut least = Lanes::splat(FAR);
        let inward = lanes.map(|half| view.inward(half));
        for (rect, [middle, half]) in view.link.rects_in_lanes.iter().enumerate() {
            for (which, [along, above]) in inward.iter().enumerate() {
                let gaps = ((*along - middle[0]).abs() - half[0]).max((*above - middle[1]).abs() - half[1]);
                let inside = gaps.cmplt(Lanes::splat(-COARSE)).bitmask();
                if inside != 0 {
                    let point = lanes[which].map(|lanes| lanes[inside.trailing_zeros() as usize]);
                    return Err(Found::Blocked(Some((point, rect))));
                }
                least = least.min(gaps);
            }
        }
        let gap = least.min_element() - 3.0 * COARSE;
        if gap <= 0.0 && exactly(&self.points[*first as usize..*end as usize]) {
            return Err(Found::Blocked(None));
        }
        Ok(gap)
    }

    /// Whether no point can be inside a link after a step, by what is known.
    ///
    /// * `before`, `step`: as in [`Moving`].
    pub fn is_free(&self, which: usize, before: f64, step: f32) -> bool {
        self.next[which] >= before as f32 + step
    }

    /// Forgets the last step that was tried.
    pub fn forget(&mut self) {
        self.later.clear();
    }

    /// Takes the last step that was tried.
    pub fn accept(&mut self) {
        while let Some(later) = self.later.pop() {
            match later {
                Later::Due(at, due) => self.put(at, due),
                Later::Next(which, next) => self.next[which] = next,
            }
        }
    }

    /// True if a point is inside the link at this frame.
    pub fn hold(&mut self, link: &LinkShape, frame: &Frame, fill: Fill<'_>) -> bool {
        (0..self.places.len()).for_each(|number| {
            self.place(number, fill);
        });
        self.points.iter().any(|point| link.holds(frame, [point.x, point.z]))
    }

    /// Calls `visit` with every point that may be within `distance` metres of the bounds of a link, along each of their axes.
    pub fn visit_near(&mut self, view: &View<'_>, distance: f64, fill: Fill<'_>, mut visit: impl FnMut(&PlanePoint)) {
        for group in 0..self.discs.len() {
            let discs = &self.discs[group];
            let mut near = (view.gaps(discs.at) - discs.radius).cmple(Lanes::splat(distance as f32)).bitmask();
            while near != 0 {
                let place = self.place(group * BLOCKS + near.trailing_zeros() as usize, fill);
                near &= near - 1;
                let [first, end] = self.blocks[place].points;
                self.points[first as usize..end as usize].iter().for_each(&mut visit);
            }
        }
    }
}
