//! Closing of a chain in its plane until it is blocked: the motion of an underactuated finger or a jaw, without dynamics.
//!
//! | module | purpose |
//! |---|---|
//! | `model` | the chain of a hand as rectangles in the plane in which it closes |
//! | `plane` | rectangles and frames, and their collisions with the table |
//! | `obstacles` | the points that block them |
//! | `steps` | all halvings of a step at once |
//! | `spatial` | chains in space, for hands with a chain whose plane rotates as it closes, or whose joints have motors of their own |
//!
//! The chain moves in the plane normal to the axis of its last closing joint. Joints about other axes keep their positions in the open hand. One
//! tendon pulls all joints: it shortens by `sum of r_i dq_i`, and the chain makes any collision-free motion for which that is positive. First the
//! root closes, then the joints after it, each by itself. If only the tip is held, it curls further while an earlier joint yields.

mod model;
mod obstacles;
mod plane;
mod spatial;
mod steps;

use nalgebra::{Isometry3, Vector3};
use obstacles::{Fill, Found, Moving, Obstacles, View};
use plane::{Frame, LinkShape, Rect};
use steps::{ALL, Frames, LinkMotion, STEPS, Witnesses};

pub(crate) use obstacles::POINTS;
pub(crate) use plane::{PlanePoint, PlaneTable};
pub(crate) use spatial::{SpatialChain, TableSide};

/// Motion of a segment relative to the one before it.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Motion {
    /// Rotation about the plane's normal, from x towards z.
    Turn,
    /// Translation along a unit direction of the plane.
    Slide([f64; 2]),
}

/// The part of a chain that moves with one joint.
#[derive(Clone, Debug)]
struct Segment {
    /// Position of the joint in the frame of the segment before it.
    at: [f64; 2],
    motion: Motion,
    /// Its coordinate, and its position per unit of the coordinate.
    coordinate: usize,
    ratio: f64,
    shape: LinkShape,
}

/// An independent joint of the chain.
#[derive(Clone, Copy, Debug)]
struct Coordinate {
    /// Least and greatest position relative to the open hand, towards closing, rad or m.
    limits: [f64; 2],
    /// Moment arm of the tendon that closes it; 0 without a tendon.
    arm: f64,
    /// Step per angular step: 1 for a rotation, metres per radian for a translation.
    scale: f64,
}

/// A direction of motion.
#[derive(Clone, Debug)]
struct Direction {
    /// Change of each coordinate per angular step.
    along: Vec<f64>,
    links: Vec<LinkMotion>,
}

/// A chain at one preshape.
#[derive(Clone, Debug)]
pub(crate) struct ChainModel {
    /// Plane of the chain: origin at its first joint, x along the open chain, y across, z towards the closing side.
    pub hand_from_plane: Isometry3<f64>,
    segments: Vec<Segment>,
    /// The last segment with a pad, or the last one.
    tip: usize,
    coordinates: Vec<Coordinate>,
    /// Directions of motion in order of preference.
    moves: Vec<Direction>,
    /// Half the width of the chain, metres.
    pub half_width: f64,
    /// Greatest distance from the first joint that it reaches.
    pub reach: f64,
    /// Greatest distance of a corner of a link from the first joint, at any position.
    extent: f64,
    /// Its plane rotates as it closes, since a joint about another axis closes too.
    pub turns: bool,
    /// Several motors close it at the same time: no tendon shares their motion, and no joint waits for another.
    pub together: bool,
}

/// A chain after closing.
#[derive(Clone, Debug, Default)]
pub(crate) struct ClosedChain {
    /// Closing of its first coordinate, rad or m.
    pub root: f64,
    /// Rotation of its last segment with a pad, radians.
    pub turn: f64,
    /// Points that each segment touches: index, and whether it is on a pad; by index.
    pub touched: Vec<Vec<(u32, bool)>>,
    /// The table blocked it at some time.
    pub met_table: bool,
}

/// The obstacle that blocks a chain.
#[derive(Clone, Copy, PartialEq)]
enum Block {
    Free,
    Object,
    Table,
}

/// Share of the speed of a chain's fastest joint, dimensionless: a faster joint closes fast, and rotates the chain's plane if its axis differs.
const TURNING: f64 = 0.5;
/// Coarse step of a closing joint, radians: the tip moves by 11 mm, less than the thickness of a link.
const STEP: f64 = 0.1;
/// Number of times that a step is halved: to 0.7 degrees.
const HALVINGS: usize = 3;
/// Most steps per coordinate: a joint that closes by 2.8 rad takes 28.
const MOST_STEPS: usize = 40;
/// Greatest extent of a chain whose frames in f32 are exact enough, metres; the steps of longer ones are compared in f64.
const LONGEST: f64 = 1.0;
/// A link touches points within this distance, metres: half the distance between surface samples of a hand-sized object.
const TOUCH: f64 = 0.003;

impl ChainModel {
    /// Axes of the chain's plane in the hand frame.
    pub fn axes(&self) -> [Vector3<f64>; 3] {
        [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| self.hand_from_plane * axis)
    }

    /// Closes the chain on points (within its width and reach) over a table.
    ///
    /// * `discs`: a disc around each block of points, centre and radius, metres; `fill` gives the points.
    pub fn close(
        &self,
        discs: impl Iterator<Item = ([f64; 2], f64)>,
        fill: Fill<'_>,
        table: &PlaneTable,
        work: &mut Workspace,
    ) -> ClosedChain {
        work.start(self, discs);
        let over_table = self.extent * table.normal[0].hypot(table.normal[1]) < -table.offset;
        let around = Around { table: if over_table { None } else { Some(table) }, fill };
        let mut met_table = false;
        for _ in 0..MOST_STEPS * self.coordinates.len() {
            let mut moved = false;
            for (number, direction) in self.moves.iter().enumerate() {
                let (free, block) = self.advance((number, direction), &around, work);
                met_table |= block == Block::Table;
                if free {
                    moved = true;
                    break;
                }
            }
            if !moved {
                break;
            }
        }
        self.place(&work.at, &mut work.frames, Frame::new);
        let touched = self.touched(work, fill);
        let root = work.at.first().copied().unwrap_or(0.0);
        let turn = work.frames.get(self.tip).map_or(0.0, |frame| frame.angle);
        ClosedChain { root, turn, touched, met_table }
    }

    /// Steps along a direction from `work.at` to `work.next`, halved until it is free of collisions; false if it never is. Returns also what
    /// blocked the last step before.
    fn advance(
        &self,
        (number, direction): (usize, &Direction),
        around: &Around<'_>,
        work: &mut Workspace,
    ) -> (bool, Block) {
        // Larger steps are outside the limits too.
        if !self.is_inside(direction, STEPS - 1, work) {
            return (false, Block::Free);
        }
        let clear = self.place_steps(direction, around.table, work);
        let mut blocked = self.blocked_again(number, work);
        let exact = self.extent > LONGEST;
        let (mut first, mut from) = (Block::Free, 0);
        while from < STEPS {
            // Those that are surely blocked are passed over; if one is outside the limits too, a smaller step decides.
            let open = (ALL << from) & if exact { ALL } else { ALL & !(clear & blocked) };
            if open == 0 {
                return (false, Block::Object);
            }
            let halving = open.trailing_zeros() as usize;
            if halving > from {
                first = Block::Object;
            }
            from = halving + 1;
            if !self.is_inside(direction, halving, work) {
                continue;
            }
            let [is_clear, is_blocked] = [clear, blocked].map(|bits| bits >> halving & 1 == 1);
            let above = if is_clear { Some(true) } else { self.clears_table(halving, around.table, work) };
            let block = match above {
                Some(true) if is_blocked & !exact => Block::Object,
                Some(true) if !exact => self.nearly_block((number, direction, halving), around, work),
                Some(false) if !exact => Block::Table,
                _ => self.exactly_block(around, work),
            };
            match block {
                Block::Free => {
                    work.accept(self, direction, halving);
                    return (true, first);
                }
                // A new point may block the smaller steps too.
                Block::Object if !is_blocked => blocked = self.blocked_again(number, work),
                Block::Object | Block::Table => {}
            }
            first = block;
        }
        (false, first)
    }

    /// Sets `work.next` to a step from `work.at`; false outside the limits.
    fn is_inside(&self, direction: &Direction, halving: usize, work: &mut Workspace) -> bool {
        let step = STEP / f64::from(1_u32 << halving);
        let count = self.coordinates.len();
        let (next, at, along) = (&mut work.next[..count], &work.at[..count], &direction.along[..count]);
        let mut inside = true;
        for (k, Coordinate { limits, .. }) in self.coordinates.iter().enumerate() {
            next[k] = at[k] + step * along[k];
            inside &= (next[k] >= limits[0]) & (next[k] <= limits[1]);
        }
        inside
    }

    /// Places the links after all halvings of a step; returns those for which they are surely above the table, as bits.
    fn place_steps(&self, direction: &Direction, table: Option<&PlaneTable>, work: &mut Workspace) -> u32 {
        let mut clear = ALL;
        let mut before = Frames::ORIGIN;
        let count = self.segments.len();
        let (links, frames, steps) = (&direction.links[..count], &work.frames[..count], &mut work.steps[..count]);
        for (which, segment) in self.segments.iter().enumerate() {
            before = Frames::place(&before, segment, &links[which], &frames[which], work.at[segment.coordinate]);
            steps[which] = before;
            if let Some(table) = table {
                clear &= before.clear_table(&segment.shape.bounds, table);
            }
        }
        clear
    }

    /// Whether all links are above the table after a step; `None` where rounding decides.
    fn clears_table(&self, halving: usize, table: Option<&PlaneTable>, work: &Workspace) -> Option<bool> {
        let table = table?;
        let mut sure = true;
        for (segment, steps) in self.segments.iter().zip(&work.steps) {
            match steps.clears_table(&segment.shape, halving, table) {
                Some(false) => return Some(false),
                above => sure &= above.is_some(),
            }
        }
        sure.then_some(true)
    }

    /// The halvings of a step that are blocked by points that blocked them, or larger ones, before, as bits.
    fn blocked_again(&self, number: usize, work: &Workspace) -> u32 {
        let witnesses = &work.witnesses[number * self.segments.len()..];
        work.steps.iter().zip(witnesses).fold(0, |blocked, (steps, witnesses)| blocked | steps.blocked(witnesses))
    }

    /// Whether the object blocks the chain after a step, by frames in f32, and by exact ones where rounding decides.
    fn nearly_block(
        &self,
        (number, direction, halving): (usize, &Direction, usize),
        around: &Around<'_>,
        work: &mut Workspace,
    ) -> Block {
        let Workspace { next, steps, moved, witnesses, obstacles, .. } = work;
        obstacles.forget();
        // Outer links are blocked more often.
        for (which, Segment { shape, .. }) in self.segments.iter().enumerate().rev() {
            let (before, step) = (moved[which], direction.links[which].travel[halving]);
            if shape.rects.is_empty() || obstacles.is_free(which, before, step) {
                continue;
            }
            let exactly = |points: &[PlanePoint]| {
                let frame = self.segments[..=which]
                    .iter()
                    .fold(Frame::ORIGIN, |before, segment| segment.place(&before, next, Frame::new));
                points.iter().any(|point| shape.holds(&frame, [point.x, point.z]))
            };
            let link = Moving { which, view: steps[which].view(shape, halving), before, step };
            if let Found::Blocked(found) = obstacles.find(&link, around.fill, exactly) {
                if let Some((point, rect)) = found {
                    witnesses[number * self.segments.len() + which].keep(halving, point, &shape.rects_in_lanes[rect]);
                }
                return Block::Object;
            }
        }
        Block::Free
    }

    /// What blocks the chain at `work.next`, the table before the object.
    fn exactly_block(&self, around: &Around<'_>, work: &mut Workspace) -> Block {
        let Workspace { next, tried, obstacles, .. } = work;
        obstacles.forget();
        self.place(next, tried, Frame::new);
        let links = || self.segments.iter().map(|segment| &segment.shape).zip(tried.iter());
        if around.table.is_some_and(|table| links().any(|(link, frame)| link.hits_table(frame, table))) {
            Block::Table
        } else if links().any(|(link, frame)| obstacles.hold(link, frame, around.fill)) {
            Block::Object
        } else {
            Block::Free
        }
    }

    fn touched(&self, work: &mut Workspace, fill: Fill<'_>) -> Vec<Vec<(u32, bool)>> {
        let Workspace { frames, obstacles, .. } = work;
        let of = |(segment, frame): (&Segment, &Frame)| {
            let LinkShape { rects, bounds, .. } = &segment.shape;
            let touch = |p: &PlanePoint| {
                let (x, z) = frame.inward(p.x, p.z);
                if x <= bounds.x[0] || x >= bounds.x[1] + TOUCH || z <= bounds.z[0] || z >= bounds.z[1] + TOUCH {
                    return None;
                }
                let near = |r: &&Rect| {
                    x > r.x[0] && x < r.x[1] + TOUCH && z > r.z[0].max(r.z[1] - 2.0 * TOUCH) && z < r.z[1] + TOUCH
                };
                let rects = rects.iter().filter(near);
                let pad = rects.clone().any(|r| r.pad);
                rects.clone().next().map(|_| (p.index, pad))
            };
            let view = View::new(&segment.shape, frame.at.map(|x| x as f32), frame.sin as f32, frame.cos as f32);
            let mut touched: Vec<(u32, bool)> = Vec::new();
            obstacles.visit_near(&view, TOUCH, fill, |point| touched.extend(touch(point)));
            touched.sort_unstable_by_key(|(index, _)| *index);
            touched
        };
        self.segments.iter().zip(frames.iter()).map(of).collect()
    }

    /// Places every segment at the coordinates `at`; `turned` makes a frame from its position and angle.
    fn place(&self, at: &[f64], frames: &mut [Frame], turned: impl Fn([f64; 2], f64) -> Frame) {
        let mut before = Frame::ORIGIN;
        for (segment, frame) in self.segments.iter().zip(frames) {
            *frame = segment.place(&before, at, &turned);
            before = *frame;
        }
    }
}

impl Segment {
    /// Its frame after that of the segment before it; `turned` makes one from its position and angle.
    fn place(&self, before: &Frame, at: &[f64], turned: impl FnOnce([f64; 2], f64) -> Frame) -> Frame {
        let moved = self.ratio * at[self.coordinate];
        let [x, z] = self.at;
        match self.motion {
            Motion::Turn => turned(before.outward(x, z), before.angle + moved),
            Motion::Slide([dx, dz]) => Frame { at: before.outward(x + dx * moved, z + dz * moved), ..*before },
        }
    }
}

/// Buffers of a thread that closes chains, one after the other.
pub(crate) struct Workspace {
    /// Coordinates of the chain, and those that are tried.
    at: Vec<f64>,
    next: Vec<f64>,
    /// Frames of its links, those after all halvings of a step, and exact ones of a single step.
    frames: Vec<Frame>,
    steps: Vec<Frames>,
    tried: Vec<Frame>,
    /// Sum of the greatest distances by which the points of each link have moved, metres.
    moved: Vec<f64>,
    /// The points that blocked each link, direction by direction.
    witnesses: Vec<Witnesses>,
    obstacles: Obstacles,
    /// See [`Frame::nearly`].
    angles: &'static [[f64; 2]],
}

impl Default for Workspace {
    fn default() -> Self {
        let ([at, next, moved], [frames, tried]) = Default::default();
        let (steps, witnesses) = Default::default();
        let (obstacles, angles) = (Obstacles::default(), Frame::angles());
        Self { at, next, frames, steps, tried, moved, witnesses, obstacles, angles }
    }
}

impl Workspace {
    fn start(&mut self, chain: &ChainModel, discs: impl Iterator<Item = ([f64; 2], f64)>) {
        fn refill<T: Copy>(list: &mut Vec<T>, len: usize, value: T) {
            list.clear();
            list.resize(len, value);
        }
        let (coordinates, links) = (chain.coordinates.len(), chain.segments.len());
        [&mut self.at, &mut self.next].into_iter().for_each(|list| refill(list, coordinates, 0.0));
        [&mut self.frames, &mut self.tried].into_iter().for_each(|list| refill(list, links, Frame::ORIGIN));
        refill(&mut self.moved, links, 0.0);
        refill(&mut self.steps, links, Frames::ORIGIN);
        refill(&mut self.witnesses, links * chain.moves.len(), Witnesses::NONE);
        chain.place(&self.at, &mut self.frames, Frame::new);
        self.obstacles.set(links, discs);
    }

    /// The step that was tried becomes the state of the chain.
    fn accept(&mut self, chain: &ChainModel, direction: &Direction, halving: usize) {
        std::mem::swap(&mut self.at, &mut self.next);
        for (moved, link) in self.moved.iter_mut().zip(&direction.links) {
            *moved += f64::from(link.travel[halving]);
        }
        self.obstacles.accept();
        let angles = self.angles;
        chain.place(&self.at, &mut self.frames, |at, angle| Frame::nearly(at, angle, angles));
    }
}

/// What surrounds a chain: a table, if the chain can reach it, and points.
struct Around<'a> {
    table: Option<&'a PlaneTable>,
    fill: Fill<'a>,
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use graspbox_hand::Hand;
    use graspbox_hand::assets::asset;
    use nalgebra::Point3;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    /// The LEAP hand with all flexions of a finger closing at once.
    pub(crate) fn curling() -> Hand {
        let leap = asset("leap").unwrap();
        let outer = r#"closing = ["if_pip", "if_dip", "mf_pip", "mf_dip", "rf_pip", "rf_dip", "th_ipl", "if_mcp""#;
        let toml = leap.toml.replace(r#"closing = ["if_mcp""#, outer);
        assert_ne!(toml, leap.toml);
        Hand::from_strs(leap.urdf, &toml, ["leap.urdf", "hand.toml"]).unwrap()
    }

    fn finger_3() -> ChainModel {
        let mut fingers = ChainModel::all(Hand::reflex().unwrap(), 0.0).unwrap();
        fingers.remove(2)
    }

    fn closed(chain: &ChainModel, points: &[PlanePoint], table: &PlaneTable) -> ClosedChain {
        let blocks: Vec<&[PlanePoint]> = points.chunks(POINTS).collect();
        let disc = |block: &&[PlanePoint]| {
            let (x, z) = (block[0].x, block[0].z);
            ([x, z], block.iter().map(|p| (p.x - x).hypot(p.z - z)).fold(0.0, f64::max))
        };
        let fill = |number: usize, into: &mut Vec<PlanePoint>| into.extend(blocks[number]);
        chain.close(blocks.iter().map(disc), &fill, table, &mut Workspace::default())
    }

    /// No table: far below.
    const NO_TABLE: PlaneTable = PlaneTable { normal: [0.0, 1.0], offset: -10.0 };

    #[test]
    fn a_free_finger_closes_to_its_stops() {
        let finger = finger_3();
        let closed = closed(&finger, &[], &NO_TABLE);
        assert!((closed.root - finger.coordinates[0].limits[1]).abs() < 0.02, "{closed:?}");
        assert!((closed.turn - closed.root - finger.coordinates[1].limits[1]).abs() < 0.02, "{closed:?}");
        assert!(closed.touched.iter().all(Vec::is_empty) && !closed.met_table);
    }

    #[test]
    fn a_post_stops_the_proximal_link_and_the_distal_link_wraps_on() {
        let finger = finger_3();
        // A point above the middle of the proximal pad (surface 15.4 mm over the joint): touched at asin(z / r) - asin(h / r).
        let (x, z) = (0.0, 0.040);
        let closed = closed(&finger, &[PlanePoint { x, z, index: 7 }], &NO_TABLE);
        let expected = std::f64::consts::FRAC_PI_2 - (0.0154_f64 / z).asin();
        assert!((closed.root - expected).abs() < 0.02, "{} against {expected}", closed.root);
        assert!(closed.turn - closed.root > 1.0, "the tip goes on: {closed:?}");
        assert_eq!(closed.touched[0], vec![(7, true)]);
    }

    #[test]
    fn the_table_makes_a_finger_curl() {
        let finger = finger_3();
        // The closing side points down, at a table 6 cm below the joint.
        let closed = closed(&finger, &[], &PlaneTable { normal: [0.0, -1.0], offset: -0.06 });
        assert!(closed.met_table);
        let mut frames = [Frame::ORIGIN; 2];
        finger.place(&[closed.root, closed.turn - closed.root], &mut frames, Frame::new);
        assert!(frames.iter().all(|frame| frame.at[1] < 0.06));
        assert!(closed.turn > 1.5, "{closed:?}");
    }

    /// A bug here: a margin below the rounding of f32, or a step that is passed over though a point blocks it.
    #[test]
    fn steps_in_f32_change_no_result() {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let mut within = |low: f64, high: f64| rng.random_range(low..high);
        let (mut touched, mut on_table) = (0, 0);
        for (hand, preshape) in [("reflex", 0.0), ("reflex", 0.8), ("panda_gripper", 0.0), ("robotiq_2f_85", 0.0)] {
            let hand = asset(hand).unwrap().read().unwrap();
            for chain in ChainModel::all(&hand, preshape).unwrap() {
                // Without steps in f32.
                let exact = ChainModel { extent: 2.0 * LONGEST, ..chain.clone() };
                for case in 0..60 {
                    // A bent strip of surface in front of the chain.
                    let ([x, z], [along, bend]) =
                        ([within(0.0, 0.1), within(0.0, 0.1)], [within(-3.0, 3.0), within(-20.0, 20.0)]);
                    let point = |index: u32| {
                        let s = 0.002 * (f64::from(index) - 30.0);
                        let (sin, cos) = (along + bend * s).sin_cos();
                        PlanePoint { x: x + s * cos, z: z + s * sin, index }
                    };
                    let points: Vec<PlanePoint> = (0..60).map(point).collect();
                    let (sin, cos) = within(-3.1, 3.1).sin_cos();
                    let offset = if case % 2 == 0 { -1.0 } else { -within(0.03, 0.12) };
                    let table = PlaneTable { normal: [cos, sin], offset };
                    let [fast, slow] = [&chain, &exact].map(|chain| closed(chain, &points, &table));
                    assert_eq!(format!("{fast:?}"), format!("{slow:?}"), "{} {case}", hand.name);
                    touched += usize::from(fast.touched.iter().any(|link| !link.is_empty()));
                    on_table += usize::from(fast.met_table);
                }
            }
        }
        assert!(touched > 100 && on_table > 50, "{touched} {on_table}");
    }

    /// Both jaws of a gripper slide in until a point blocks them.
    #[test]
    fn jaws_close_on_what_is_between_them() {
        let hand = graspbox_hand::assets::asset("panda_gripper").unwrap().read().unwrap();
        let jaws = ChainModel::all(&hand, 0.0).unwrap();
        assert_eq!(jaws.len(), 2, "the second follows the first");
        for jaw in &jaws {
            let [x, y, z] = jaw.axes();
            assert!((x - nalgebra::Vector3::z()).norm() < 1e-12, "along the approach");
            assert!(y.x.abs() < 1e-12 && z.x.abs() > 1.0 - 1e-12, "they slide along hand x");
            // The pads are 40 mm from the middle: free jaws meet there; a point 10 mm before it stops them.
            let free = closed(jaw, &[], &NO_TABLE);
            assert!((free.root - 0.04).abs() < 1e-3 && free.turn == 0.0, "{free:?}");
            let middle = -jaw.hand_from_plane.translation.vector.dot(&z);
            let held = closed(jaw, &[PlanePoint { x: 0.045, z: middle - 0.01, index: 3 }], &NO_TABLE);
            assert!((held.root - 0.03).abs() < 1e-3, "{held:?}");
            assert_eq!(held.touched, vec![vec![(3, true)]]);
        }
    }

    /// The tip of a four-bar linkage turns back as its knuckle turns, and stays parallel.
    #[test]
    fn the_tip_of_a_linkage_stays_parallel() {
        let hand = graspbox_hand::assets::asset("robotiq_2f_85").unwrap().read().unwrap();
        for jaw in ChainModel::all(&hand, 0.0).unwrap() {
            assert_eq!((jaw.segments.len(), jaw.coordinates.len(), jaw.tip), (3, 1, 1));
            let free = closed(&jaw, &[], &NO_TABLE);
            assert!((free.root - 0.8).abs() < 0.02 && free.turn.abs() < 1e-9, "{free:?}");
            // A point 20 mm from the middle of the hand, in front of the pads: they are there at an opening of 40 mm, at 0.449 rad.
            let point = jaw.hand_from_plane.inverse() * Point3::new(0.0, 0.0, 0.053);
            let held = closed(&jaw, &[PlanePoint { x: point.x, z: point.z - 0.02, index: 2 }], &NO_TABLE);
            assert!((held.root - 0.4486).abs() < 0.02 && held.turn.abs() < 1e-9, "{held:?}");
            assert_eq!(held.touched, vec![vec![], vec![(2, true)], vec![]]);
        }
    }

    /// The thumb of the SoftHand swings around as it closes, so its plane does not define where the hand closes.
    #[test]
    fn a_thumb_that_comes_round_turns_its_plane() {
        let hand = graspbox_hand::assets::asset("soft_hand").unwrap().read().unwrap();
        let chains = ChainModel::all(&hand, 0.0).unwrap();
        assert_eq!(chains.iter().map(|chain| chain.turns).collect::<Vec<_>>(), [true, false, false, false, false]);
        assert!(chains[1..].iter().all(|chain| chain.segments.len() == 6 && chain.coordinates.len() == 3));
        // A free finger closes to 90 degrees at each of its three joints.
        let free = closed(&chains[2], &[], &NO_TABLE);
        assert!((free.turn - 3.0 * std::f64::consts::FRAC_PI_2).abs() < 0.1, "{free:?}");
    }

    /// A finger with a motor per joint closes them all at once; a tendon's joints wait for each other, and a jaw has one.
    #[test]
    fn joints_with_motors_of_their_own_close_together() {
        let each =
            |hand: &Hand| ChainModel::all(hand, 0.0).unwrap().iter().map(|chain| chain.together).collect::<Vec<_>>();
        let together = |name: &str| each(&asset(name).unwrap().read().unwrap());
        assert_eq!(each(&curling()), vec![true; 4]);
        assert!(
            ["reflex", "panda_gripper", "robotiq_2f_85", "soft_hand"]
                .iter()
                .all(|name| !together(name).contains(&true))
        );
    }
}
