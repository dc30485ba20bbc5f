//! Closing of a chain in its plane until it is blocked: the motion of an underactuated finger or a jaw, without dynamics.
//!
//! | module | purpose |
//! |---|---|
//! | `model` | the chain of a hand as rectangles in the plane in which it closes |
//! | `plane` | rectangles and frames, and their collisions with points and the table |
//! | `spatial` | chains in space, for hands with a chain whose plane rotates as it closes, or whose joints have motors of their own |
//!
//! The chain moves in the plane normal to the axis of its last closing joint. Joints about other axes keep their positions in the open hand. One
//! tendon pulls all joints: it shortens by `sum of r_i dq_i`, and the chain makes any collision-free motion for which that is positive. First the
//! root closes, then the joints after it, each by itself. If only the tip is held, it curls further while an earlier joint yields.

mod model;
mod plane;
mod spatial;

use nalgebra::{Isometry3, Vector3};
use plane::{Frame, LinkShape, Obstacles, Rect};

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

/// A chain at one preshape.
#[derive(Clone, Debug)]
pub(crate) struct ChainModel {
    /// Plane of the chain: origin at its first joint, x along the open chain, y across, z towards the closing side.
    pub hand_from_plane: Isometry3<f64>,
    segments: Vec<Segment>,
    /// The last segment with a pad, or the last one.
    tip: usize,
    coordinates: Vec<Coordinate>,
    /// Directions of motion in order of preference, each with one entry per coordinate.
    moves: Vec<Vec<f64>>,
    /// Half the width of the chain, metres.
    pub half_width: f64,
    /// Greatest distance from the first joint that it reaches.
    pub reach: f64,
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
    /// Points that each segment touches: index, and whether it is on a pad.
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
/// A link touches points within this distance, metres: half the distance between surface samples of a hand-sized object.
const TOUCH: f64 = 0.003;

impl ChainModel {
    /// Axes of the chain's plane in the hand frame.
    pub fn axes(&self) -> [Vector3<f64>; 3] {
        [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| self.hand_from_plane * axis)
    }

    /// Closes the chain on points (within its width and reach) over a table.
    pub fn close(&self, points: &[PlanePoint], table: &PlaneTable) -> ClosedChain {
        let mut at = vec![0.0; self.coordinates.len()];
        let (mut next, mut frames) = (at.clone(), self.frames(&at));
        let mut obstacles = Obstacles::new(points, self.segments.len());
        let mut met_table = false;
        for _ in 0..MOST_STEPS * at.len() {
            let mut moved = false;
            for direction in &self.moves {
                let (free, block) = self.advance((&at, &mut next), direction, &mut obstacles, table, &mut frames);
                met_table |= block == Block::Table;
                if free {
                    std::mem::swap(&mut at, &mut next);
                    moved = true;
                    break;
                }
            }
            if !moved {
                break;
            }
        }
        self.place(&at, &mut frames);
        let touched = self.touched(&frames, points);
        let root = at.first().copied().unwrap_or(0.0);
        let turn = frames.get(self.tip).map_or(0.0, |frame| frame.angle);
        ClosedChain { root, turn, touched, met_table }
    }

    /// Steps along `direction` from `at` to `next`, halved until it is free of collisions; false if it never is.
    fn advance(
        &self,
        (at, next): (&[f64], &mut [f64]),
        direction: &[f64],
        obstacles: &mut Obstacles,
        table: &PlaneTable,
        frames: &mut [Frame],
    ) -> (bool, Block) {
        let mut step = STEP;
        let mut first = Block::Free;
        for _ in 0..=HALVINGS {
            for (to, (from, along)) in next.iter_mut().zip(at.iter().zip(direction)) {
                *to = from + step * along;
            }
            let inside =
                |(q, coordinate): (&f64, &Coordinate)| (coordinate.limits[0]..=coordinate.limits[1]).contains(q);
            if next.iter().zip(&self.coordinates).all(inside) {
                self.place(next, frames);
                let block = self.block(frames, next[0], obstacles, table);
                if block == Block::Free {
                    return (true, first);
                }
                first = block;
            }
            step *= 0.5;
        }
        (false, first)
    }

    /// * `first`: position of the first coordinate.
    fn block(&self, frames: &[Frame], first: f64, obstacles: &mut Obstacles, table: &PlaneTable) -> Block {
        let links = self.segments.iter().map(|segment| &segment.shape).zip(frames);
        if links.clone().any(|(link, frame)| link.hits_table(frame, table)) {
            Block::Table
        } else if obstacles.block(links, first) {
            Block::Object
        } else {
            Block::Free
        }
    }

    fn touched(&self, frames: &[Frame], points: &[PlanePoint]) -> Vec<Vec<(u32, bool)>> {
        let of = |(segment, frame): (&Segment, &Frame)| {
            let LinkShape { rects, bounds } = &segment.shape;
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
            points.iter().filter_map(touch).collect()
        };
        self.segments.iter().zip(frames).map(of).collect()
    }

    /// The frame of every segment at coordinates `at`.
    fn frames(&self, at: &[f64]) -> Vec<Frame> {
        let mut frames = vec![Frame::new([0.0, 0.0], 0.0); self.segments.len()];
        self.place(at, &mut frames);
        frames
    }

    fn place(&self, at: &[f64], frames: &mut [Frame]) {
        let mut before = Frame::new([0.0, 0.0], 0.0);
        for (segment, frame) in self.segments.iter().zip(frames) {
            let moved = segment.ratio * at[segment.coordinate];
            let [x, z] = segment.at;
            *frame = match segment.motion {
                Motion::Turn => Frame::new(before.outward(x, z), before.angle + moved),
                Motion::Slide([dx, dz]) => Frame { at: before.outward(x + dx * moved, z + dz * moved), ..before },
            };
            before = *frame;
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use graspbox_hand::Hand;
    use graspbox_hand::assets::asset;
    use nalgebra::Point3;

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

    /// No table: far below.
    const NO_TABLE: PlaneTable = PlaneTable { normal: [0.0, 1.0], offset: -10.0 };

    #[test]
    fn a_free_finger_closes_to_its_stops() {
        let finger = finger_3();
        let closed = finger.close(&[], &NO_TABLE);
        assert!((closed.root - finger.coordinates[0].limits[1]).abs() < 0.02, "{closed:?}");
        assert!((closed.turn - closed.root - finger.coordinates[1].limits[1]).abs() < 0.02, "{closed:?}");
        assert!(closed.touched.iter().all(Vec::is_empty) && !closed.met_table);
    }

    #[test]
    fn a_post_stops_the_proximal_link_and_the_distal_link_wraps_on() {
        let finger = finger_3();
        // A point above the middle of the proximal pad (surface 15.4 mm over the joint): touched at asin(z / r) - asin(h / r).
        let (x, z) = (0.0, 0.040);
        let closed = finger.close(&[PlanePoint { x, z, index: 7 }], &NO_TABLE);
        let expected = std::f64::consts::FRAC_PI_2 - (0.0154_f64 / z).asin();
        assert!((closed.root - expected).abs() < 0.02, "{} against {expected}", closed.root);
        assert!(closed.turn - closed.root > 1.0, "the tip goes on: {closed:?}");
        assert_eq!(closed.touched[0], vec![(7, true)]);
    }

    #[test]
    fn the_table_makes_a_finger_curl() {
        let finger = finger_3();
        // The closing side points down, at a table 6 cm below the joint.
        let closed = finger.close(&[], &PlaneTable { normal: [0.0, -1.0], offset: -0.06 });
        assert!(closed.met_table);
        for frame in finger.frames(&[closed.root, closed.turn - closed.root]) {
            assert!(frame.at[1] < 0.06);
        }
        assert!(closed.turn > 1.5, "{closed:?}");
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
            let free = jaw.close(&[], &NO_TABLE);
            assert!((free.root - 0.04).abs() < 1e-3 && free.turn == 0.0, "{free:?}");
            let middle = -jaw.hand_from_plane.translation.vector.dot(&z);
            let held = jaw.close(&[PlanePoint { x: 0.045, z: middle - 0.01, index: 3 }], &NO_TABLE);
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
            let free = jaw.close(&[], &NO_TABLE);
            assert!((free.root - 0.8).abs() < 0.02 && free.turn.abs() < 1e-9, "{free:?}");
            // A point 20 mm from the middle of the hand, in front of the pads: they are there at an opening of 40 mm, at 0.449 rad.
            let point = jaw.hand_from_plane.inverse() * Point3::new(0.0, 0.0, 0.053);
            let held = jaw.close(&[PlanePoint { x: point.x, z: point.z - 0.02, index: 2 }], &NO_TABLE);
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
        let free = chains[2].close(&[], &NO_TABLE);
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
