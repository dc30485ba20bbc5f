//! Closing of chains in space, for hands with a finger that swings around as it closes, such as an opposable thumb, or whose joints close at the
//! same time, each with a motor of its own.
//!
//! All joints close together along the path of the free hand: a sprung joint is where its spring balances the common tension, and a directly
//! driven joint moves uniformly. Where a link meets the object or the table, the joints before it stop and those after it continue.

use super::{ClosedChain, TOUCH, TURNING};
use crate::PlanError;
use graspbox_hand::{Hand, JointKind, Material, Transmission};
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

/// Number of fine steps from open to closed: a finger tip moves by less than 2 mm in each.
const STEPS: usize = 160;
/// Numbers of fine steps that are tried at once, longest first.
const STRIDES: [usize; 3] = [4, 2, 1];
/// Points farther than this from the path of the free chain are ignored, metres: a blocked chain deviates little from that path.
const ROOM: f64 = 0.01;

/// A box of a link.
#[derive(Clone, Debug)]
struct LinkBox {
    link_from_box: Isometry3<f64>,
    half: Vector3<f64>,
    pad: bool,
}

/// A link of the chain.
#[derive(Clone, Debug)]
struct Node {
    /// Parent node; `None` for the hand itself.
    parent: Option<usize>,
    /// The coordinate that moves it relative to its parent.
    coordinate: Option<usize>,
    /// Its pose in its parent at every step; one entry if it does not move.
    poses: Vec<Isometry3<f64>>,
    boxes: Vec<LinkBox>,
    /// Bit set of the coordinates that it depends on.
    upstream: u64,
}

/// A chain at one preshape, prepared for closing in space.
#[derive(Clone, Debug)]
pub(crate) struct SpatialChain {
    nodes: Vec<Node>,
    coordinates: usize,
    /// Position of the first joint that closes fast, relative to the open hand, at every step: rad or m.
    root: (usize, Vec<f64>),
    /// Rotation of the last link at each step, by coordinate, radians.
    turns: Vec<Vec<f64>>,
    /// Bounds of the free chain's path in the hand frame, with the margin [`ROOM`].
    bounds: [Vector3<f64>; 2],
}

/// A box at its pose in the hand frame.
struct Placed<'a> {
    node: usize,
    axes: Matrix3<f64>,
    center: Vector3<f64>,
    shape: &'a LinkBox,
}

impl Placed<'_> {
    /// Inlined whatever the compiler thinks: as a call, plans take 1.4 times as long.
    #[inline(always)]
    fn holds(&self, point: &Vector3<f64>, margin: f64) -> bool {
        let at = self.axes.tr_mul(&(point - self.center)).abs();
        let half = &self.shape.half;
        (at.x < half.x + margin) & (at.y < half.y + margin) & (at.z < half.z + margin)
    }

    /// Height of its lowest corner above the table.
    fn lowest(&self, table: &TableSide) -> f64 {
        table.up.dot(&self.center) + table.offset - self.axes.tr_mul(&table.up).abs().dot(&self.shape.half)
    }
}

/// The table in the hand frame: free space is `up . p + offset >= 0`.
pub(crate) struct TableSide {
    pub up: Vector3<f64>,
    pub offset: f64,
}

impl SpatialChain {
    /// Every chain of `hand` that closes, at `preshape`.
    ///
    /// # Errors
    /// [`PlanError::UnsupportedHand`] for a preshape beyond the hand's limits, or a chain of more than 64 joints.
    pub fn all(hand: &Hand, preshape: f64) -> Result<Vec<Self>, PlanError> {
        let bad = |reason| PlanError::UnsupportedHand { name: hand.name.clone(), reason };
        let way = free_path(hand, preshape);
        let links = way.iter().map(|at| hand.hand_from_links(at)).collect::<Result<Vec<_>, _>>();
        let positions = way.iter().map(|at| hand.joint_positions(at)).collect::<Result<Vec<_>, _>>();
        let (Ok(links), Ok(positions)) = (links, positions) else { return Err(bad("cannot take this preshape")) };
        let mut chains = Vec::new();
        for (number, chain) in hand.chains().iter().enumerate() {
            if chain.joints.len() > 64 {
                return Err(bad("has a chain of more than 64 joints"));
            }
            if chain.joints.iter().any(|joint| hand.closing_rate(*joint) != 0.0) {
                chains.push(Self::new(hand, number, &chain.joints, &links, &positions));
            }
        }
        Ok(chains)
    }

    /// * `links`, `positions`: poses of all links and positions of all joints, at every step.
    fn new(
        hand: &Hand,
        number: usize,
        joints: &[usize],
        links: &[Vec<Isometry3<f64>>],
        positions: &[Vec<f64>],
    ) -> Self {
        let leader = |joint: usize| hand.joints[joint].mimic.map_or(joint, |mimic| mimic.joint);
        let mut leaders: Vec<usize> = joints.iter().map(|joint| leader(*joint)).collect();
        leaders.sort_unstable();
        leaders.dedup();
        let mine: Vec<usize> = (1..hand.links.len()).filter(|link| hand.chain_of_link(*link) == Some(number)).collect();
        let mut nodes: Vec<Node> = Vec::with_capacity(mine.len());
        for &link in &mine {
            let joint = link - 1;
            let above = hand.joints[joint].parent;
            let parent = mine.iter().position(|known| *known == above);
            let coordinate = leaders.binary_search(&leader(joint)).ok().filter(|_| !hand.joints[joint].is_fixed());
            let pose = |at: &Vec<Isometry3<f64>>| {
                if parent.is_some() { at[above].inverse() * at[link] } else { at[link] }
            };
            let poses = if coordinate.is_some() { links.iter().map(pose).collect() } else { vec![pose(&links[0])] };
            let boxes = hand.links[link].colliders.iter().map(|collider| LinkBox {
                link_from_box: collider.link_from_shape,
                half: collider.shape.half_extents(&nalgebra::UnitQuaternion::identity()),
                pad: collider.material == Material::Pad,
            });
            let own = coordinate.map_or(0, |coordinate| 1_u64 << coordinate);
            let upstream = own | parent.map_or(0, |parent| nodes[parent].upstream);
            nodes.push(Node { parent, coordinate, poses, boxes: boxes.collect(), upstream });
        }
        let moved = |joint: usize| positions.iter().map(move |at| (at[joint] - positions[0][joint]).abs());
        let fastest = joints.iter().map(|joint| hand.closing_rate(*joint).abs()).fold(0.0, f64::max);
        let is_fast = |joint: &usize| hand.closing_rate(*joint).abs() > TURNING * fastest;
        let first = joints.iter().copied().find(is_fast).unwrap_or(joints[0]);
        let turn = |leading: &usize| {
            let mut turns = vec![0.0; STEPS + 1];
            let follow =
                |joint: &&usize| leader(**joint) == *leading && hand.joints[**joint].kind == JointKind::Revolute;
            for joint in joints.iter().filter(follow) {
                turns.iter_mut().zip(moved(*joint)).for_each(|(sum, moved)| *sum += moved);
            }
            turns
        };
        let root = (leaders.binary_search(&leader(first)).unwrap_or(0), moved(first).collect());
        let turns = leaders.iter().map(turn).collect();
        let coordinates = leaders.len();
        let mut chain = Self { nodes, coordinates, root, turns, bounds: [Vector3::zeros(); 2] };
        chain.bounds = chain.bounds_of_way();
        chain
    }

    fn bounds_of_way(&self) -> [Vector3<f64>; 2] {
        let mut bounds = [Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY)];
        for step in 0..=STEPS {
            for placed in self.place(&vec![step; self.coordinates]) {
                let reach = placed.axes.abs() * placed.shape.half;
                bounds = [bounds[0].inf(&(placed.center - reach)), bounds[1].sup(&(placed.center + reach))];
            }
        }
        [bounds[0].add_scalar(-ROOM), bounds[1].add_scalar(ROOM)]
    }

    /// Closes the chain on `points` (hand frame, each with its index) over a table.
    pub fn close(&self, points: &[(Point3<f64>, u32)], table: &TableSide) -> ClosedChain {
        let [low, high] = &self.bounds;
        let near: Vec<(Vector3<f64>, u32)> = points
            .iter()
            .filter(|(p, _)| (0..3).all(|axis| p[axis] > low[axis] && p[axis] < high[axis]))
            .map(|(p, index)| (p.coords, *index))
            .collect();
        let mut at = vec![0; self.coordinates];
        // Bit set of the coordinates that still close, and their step.
        let (mut live, mut step, mut met_table) = (u64::MAX, 0, false);
        while self.nodes.iter().any(|node| node.coordinate.is_some_and(|c| live >> c & 1 == 1)) && step < STEPS {
            let mut blocked = None;
            for stride in STRIDES.into_iter().filter(|stride| step + stride <= STEPS) {
                let next = self.advanced(&at, live, step + stride);
                blocked = self.blocked(&next, live, &near, table);
                if blocked.is_none() {
                    (at, step) = (next, step + stride);
                    break;
                }
            }
            if let Some((node, by_table)) = blocked {
                live &= !self.nodes[node].upstream;
                met_table |= by_table;
            }
        }
        let touched = self.touched(&at, &near);
        let turn = self.turns.iter().zip(&at).map(|(turns, at)| turns[*at]).sum();
        ClosedChain { root: self.root.1[at[self.root.0]], turn, touched, met_table }
    }

    /// Live coordinates at `step`, the others at their last step.
    fn advanced(&self, at: &[usize], live: u64, step: usize) -> Vec<usize> {
        at.iter().enumerate().map(|(c, at)| if live >> c & 1 == 1 { step } else { *at }).collect()
    }

    /// The first node that is blocked, and whether by the table. Links that no longer move are not tested.
    fn blocked(
        &self,
        at: &[usize],
        live: u64,
        near: &[(Vector3<f64>, u32)],
        table: &TableSide,
    ) -> Option<(usize, bool)> {
        let moving = |placed: &Placed<'_>| self.nodes[placed.node].upstream & live != 0;
        self.place(at).into_iter().filter(moving).find_map(|placed| {
            if placed.lowest(table) < 0.0 {
                return Some((placed.node, true));
            }
            near.iter().any(|(point, _)| placed.holds(point, 0.0)).then_some((placed.node, false))
        })
    }

    /// The points that each node touches: index, and whether it is on a pad.
    fn touched(&self, at: &[usize], near: &[(Vector3<f64>, u32)]) -> Vec<Vec<(u32, bool)>> {
        let mut touched = vec![Vec::new(); self.nodes.len()];
        for placed in self.place(at) {
            let held = near.iter().filter(|(point, _)| placed.holds(point, TOUCH));
            touched[placed.node].extend(held.map(|(_, index)| (*index, placed.shape.pad)));
        }
        touched
    }

    /// All boxes, each coordinate at its step.
    fn place(&self, at: &[usize]) -> Vec<Placed<'_>> {
        let mut frames: Vec<Isometry3<f64>> = Vec::with_capacity(self.nodes.len());
        let mut placed = Vec::with_capacity(self.nodes.len());
        for (node, data) in self.nodes.iter().enumerate() {
            let own = data.poses[data.coordinate.map_or(0, |coordinate| at[coordinate])];
            let frame = data.parent.map_or(own, |parent| frames[parent] * own);
            placed.extend(data.boxes.iter().map(|shape| {
                let hand_from_box = frame * shape.link_from_box;
                let axes = hand_from_box.rotation.to_rotation_matrix().into_inner();
                Placed { node, axes, center: hand_from_box.translation.vector, shape }
            }));
            frames.push(frame);
        }
        placed
    }
}

/// Path of the free hand: positions of the independent joints from open to closed.
fn free_path(hand: &Hand, preshape: f64) -> Vec<Vec<f64>> {
    let open = hand.open_configuration(preshape);
    let fastest = hand.coordinates().map(|joint| hand.closing_rate(joint).abs()).fold(0.0, f64::max);
    let end = |joint: usize| hand.joints[joint].limits[usize::from(hand.closing_rate(joint) > 0.0)];
    // Tension at which a sprung joint reaches its limit.
    let tension = |joint: usize| {
        let data = &hand.joints[joint];
        data.stiffness * (end(joint) - data.spring_reference) / hand.closing_rate(joint)
    };
    let fast = |joint: &usize| sprung(hand, *joint) && hand.closing_rate(*joint).abs() > TURNING * fastest;
    let full = hand.coordinates().filter(fast).map(tension).fold(0.0, f64::max);
    let at = |share: f64, joint: usize, open: f64| {
        let rate = hand.closing_rate(joint);
        let (data, end) = (&hand.joints[joint], end(joint));
        if rate == 0.0 {
            open
        } else if sprung(hand, joint) {
            data.balanced(rate * share * full).clamp(open.min(end), open.max(end))
        } else {
            open + share * (end - open)
        }
    };
    let step = |step: usize| {
        let share = step as f64 / STEPS as f64;
        hand.coordinates().zip(&open).map(|(joint, open)| at(share, joint, *open)).collect()
    };
    (0..=STEPS).map(step).collect()
}

/// True for a joint that a closing tendon pulls against a spring.
fn sprung(hand: &Hand, joint: usize) -> bool {
    let pulls = |actuator: &usize| match hand.actuators[*actuator].transmission {
        Transmission::Spool { tendon, .. } => hand.tendons[tendon].arm(joint) != 0.0,
        Transmission::Joints { .. } => false,
    };
    hand.joints[joint].stiffness > 0.0 && hand.grasp.closing.iter().any(pulls)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chain::tests::curling;
    use graspbox_hand::assets::asset;

    const NO_TABLE: TableSide = TableSide { up: Vector3::new(0.0, 0.0, -1.0), offset: 10.0 };

    fn chains() -> Vec<SpatialChain> {
        SpatialChain::all(&asset("soft_hand").unwrap().read().unwrap(), 0.0).unwrap()
    }

    #[test]
    fn free_chains_close_to_their_limits() {
        for (number, chain) in chains().iter().enumerate() {
            let free = chain.close(&[], &NO_TABLE);
            // The thumb has two flexions and its abduction, a finger three flexions; each is a quarter turn. Fingers also spread a little.
            assert!((free.turn - 3.0 * std::f64::consts::FRAC_PI_2).abs() < 0.5, "{number}: {free:?}");
            assert!(free.touched.iter().all(Vec::is_empty) && !free.met_table);
        }
    }

    #[test]
    fn a_point_stops_the_link_that_meets_it_and_the_tip_goes_on() {
        let middle = &chains()[2];
        let free = middle.close(&[], &NO_TABLE);
        // In front of the proximal link, 20 mm above the palm's plane.
        let held = middle.close(&[(Point3::new(0.04, 0.0, 0.02), 7)], &NO_TABLE);
        assert!(held.root < free.root - 0.2 && held.turn < free.turn - 0.4, "{held:?} {free:?}");
        assert!(held.touched.iter().flatten().all(|contact| *contact == (7, true)), "{held:?}");
        assert!(held.touched.iter().any(|link| !link.is_empty()), "{held:?}");
    }

    #[test]
    fn the_thumb_comes_round_to_the_middle() {
        let thumb = &chains()[0];
        let tip = |step: usize| thumb.place(&vec![step; thumb.coordinates]).last().map(|placed| placed.center).unwrap();
        assert!(
            tip(0).y < -0.08 && tip(STEPS / 2).y > -0.05 && tip(STEPS / 2).z > 0.03,
            "{} {}",
            tip(0),
            tip(STEPS / 2)
        );
        let held = thumb.close(&[(Point3::new(0.003, -0.04, 0.05), 3)], &NO_TABLE);
        assert!(held.touched.iter().flatten().any(|(index, _)| *index == 3), "{held:?}");
    }

    #[test]
    fn a_lower_table_lets_a_finger_close_further() {
        let middle = &chains()[2];
        let over = |offset| middle.close(&[], &TableSide { up: Vector3::new(0.0, 0.0, -1.0), offset });
        let (free, high, low) = (middle.close(&[], &NO_TABLE), over(0.025), over(0.04));
        assert!(high.met_table && low.met_table && !free.met_table);
        assert!(high.root < low.root && low.root < free.root, "{high:?} {low:?} {free:?}");
        assert!(0.2 < high.turn && high.turn < low.turn && low.turn < free.turn, "{high:?} {low:?} {free:?}");
    }

    /// All three flexions of a finger close at once: halfway, each has come half its way.
    #[test]
    fn driven_joints_close_at_the_same_time() {
        let middle = &SpatialChain::all(&curling(), 0.0).unwrap()[1];
        let turns: Vec<f64> = middle.turns.iter().map(|turns| turns[STEPS]).collect();
        assert_eq!(turns.iter().filter(|turn| **turn > 0.5).count(), 3, "{turns:?}");
        for turns in &middle.turns {
            assert!((turns[STEPS / 2] - turns[STEPS] / 2.0).abs() < 1e-9);
        }
        let free = middle.close(&[], &NO_TABLE);
        assert!((free.turn - turns.iter().sum::<f64>()).abs() < 1e-9, "{free:?}");
    }
}
