//! A hand prepared for perception: a grid of cells in its frame, the volume that its fingers sweep as they close, and collision look-ups.
//!
//! All of it is computed from the hand's description once per preshape, so a candidate costs one look-up per point of the object.

use crate::PerceptionError;
use crate::lookup::{CellBox, Solid};
use graspbox_hand::{Hand, Preshape, QuarterTurn};
use graspbox_mesh::in_range;
use graspbox_plan::closing_center;
use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Number of steps of closing: the tip of a finger of 0.1 m that closes by pi moves by 3 mm in each.
const STEPS: usize = 96;
/// Number of first steps that do not count for the grid: open fingers may spread far beyond a grasped object.
const SPREAD: usize = STEPS / 4;
/// The number of cells along each axis is a multiple of this, so a network can halve the grid three times.
const MULTIPLE: usize = 8;
/// Most cells along an axis, where their number is set.
const MOST: usize = 64;
/// Cells between the swept volume and the border of the grid.
const MARGIN: f64 = 1.0;
/// Side of a cell of the collision look-up, metres.
const LOOKUP: f64 = 0.004;
/// Flag of cells that the open hand sweeps; lower bits are chains.
const HAND: u16 = 1 << 15;
/// Values of the swept volume at the open finger and at its last position.
const FIRST_LAST: [f64; 2] = [255.0, 64.0];

/// Settings of the grid and the look-up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct HandGridConfig {
    /// Side of a cell, metres; with `shape` the least side.
    pub cell: f64,
    /// Numbers of cells along x, y and z; by default as many as the volume that the fingers sweep needs.
    pub shape: Option<[usize; 3]>,
    /// Least distance of the open hand from the object, metres.
    pub clearance: f64,
    /// Length of the straight approach along the hand's z, metres.
    pub standoff: f64,
}

impl Default for HandGridConfig {
    /// Cells of 10 mm; the approach of a trial.
    fn default() -> Self {
        Self { cell: 0.010, shape: None, clearance: 0.002, standoff: 0.10 }
    }
}

impl HandGridConfig {
    fn check(&self) -> Result<(), PerceptionError> {
        in_range("cell", self.cell, 0.002..=0.1, "m")?;
        for (axis, cells) in self.shape.into_iter().flatten().enumerate() {
            if cells % MULTIPLE != 0 || !(MULTIPLE..=MOST).contains(&cells) {
                return Err(PerceptionError::GridShape { axis, cells, multiple: MULTIPLE, most: MOST });
            }
        }
        in_range("clearance", self.clearance, 0.0..=0.05, "m")?;
        Ok(in_range("standoff", self.standoff, 0.0..=1.0, "m")?)
    }
}

/// One preshape of the hand.
pub(crate) struct PreshapeGrid {
    pub preshape: f64,
    /// Time at which a finger reaches each cell: 255 at the open finger, 64 at its last position, 0 for cells that it does not reach.
    pub swept: Vec<u8>,
    /// The hand is also tried rotated by 90 degrees for any extents of the object, since fingers oppose each other along its y too.
    pub turns: bool,
    /// Closing centre, on the palm's plane.
    pub center: Vector3<f64>,
    /// Greatest extent of a finger along the hand's z as it closes, metres.
    pub reach: f64,
    /// Corners of the open hand's shapes, grown by the clearance.
    corners: Vec<Point3<f64>>,
    /// Flags of each cell of the look-up.
    flags: Vec<u16>,
    lookup: CellBox,
}

/// Collisions of the open hand, and contacts of its closing chains.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GraspContact {
    /// The open hand collides with nothing at the pose and on the approach.
    pub free: bool,
    /// Bit set of the chains that meet the object as they close.
    pub chains: u16,
}

/// A hand, prepared for perception; see the module.
pub struct HandGrid {
    /// The cells, hand frame.
    pub cells: CellBox,
    pub(crate) shaped: Vec<PreshapeGrid>,
    standoff: f64,
    /// Chains that close.
    pub(crate) chains: u32,
    /// Point at which closed fingers meet, hand frame.
    pub(crate) center: Point3<f64>,
    pub hand: Hand,
}

impl HandGrid {
    /// Prepares a hand: a few milliseconds per preshape.
    ///
    /// # Errors
    /// [`PerceptionError::OutOfRange`] for the config, [`PerceptionError::NothingCloses`], and [`PerceptionError::Hand`].
    pub fn new(hand: &Hand, config: &HandGridConfig) -> Result<Self, PerceptionError> {
        config.check()?;
        let motions = hand.preshapes().iter().map(|preshape| closing(hand, preshape)).collect::<Result<Vec<_>, _>>()?;
        let moving = |motions: &[Vec<ChainLink>]| motions.iter().flatten().fold(0, |all, part| all | part.chain);
        let chains = motions.iter().fold(0, |all, motion| all | moving(motion));
        if chains == 0 {
            return Err(PerceptionError::NothingCloses { name: hand.name.clone() });
        }
        let cells = grid(&motions, config);
        let shaped = hand.preshapes().iter().zip(&motions);
        let shaped = shaped.map(|(preshape, motion)| PreshapeGrid::new(hand, preshape, motion, &cells, config));
        let shaped = shaped.collect::<Result<Vec<_>, _>>()?;
        let (standoff, center) = (config.standoff, hand.grasp.center);
        Ok(Self { cells, shaped, standoff, chains: chains.count_ones(), center, hand: hand.clone() })
    }

    /// The preshapes, in the order of the hand's file.
    pub fn preshapes(&self) -> impl ExactSizeIterator<Item = f64> + '_ {
        self.shaped.iter().map(|shaped| shaped.preshape)
    }

    /// Index of the preshape nearest to a number.
    #[must_use]
    pub fn nearest(&self, preshape: f64) -> usize {
        let distance = |index: &usize| (self.shaped[*index].preshape - preshape).abs();
        (0..self.shaped.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
    }

    /// Time at which a finger reaches each cell with preshape `index`, (X, Y, Z): 255 at the open finger, 64 at its last position, 0 for cells that
    /// it does not reach.
    #[must_use]
    pub fn swept(&self, index: usize) -> &[u8] {
        &self.shaped[index].swept
    }

    /// Point where the fingertips close with preshape `index`, hand frame, metres: in front of the closing centre, as far as they reach.
    pub(crate) fn fingertips(&self, index: usize) -> Point3<f64> {
        let shaped = &self.shaped[index];
        Point3::from(shaped.center + Vector3::z() * shaped.reach)
    }

    /// Collisions of the open hand, and contacts of the closing fingers, at a pose over the table z = 0.
    ///
    /// * `points`: points of the object's surface in the frame of `pose`; looked up in this order.
    /// * `obstacles`: further points that the open hand must not touch; whether it touches them as it closes does not count.
    /// * `index`: index of the preshape.
    #[must_use]
    pub fn meets(
        &self,
        points: &[Point3<f32>],
        obstacles: &[Point3<f32>],
        pose: &Isometry3<f64>,
        index: usize,
    ) -> GraspContact {
        let shaped = &self.shaped[index];
        let refused = GraspContact { free: false, chains: 0 };
        if shaped.hits_table(pose, self.standoff) {
            return refused;
        }
        let inverse = pose.inverse();
        let turn = inverse.rotation.to_rotation_matrix().matrix().cast::<f32>() / shaped.lookup.cell as f32;
        let origin = shaped.lookup.origin.coords;
        let shift = ((inverse.translation.vector - origin) / shaped.lookup.cell).cast::<f32>();
        let size = shaped.lookup.shape;
        let flags_at = |point: &Point3<f32>| {
            let at = turn * point.coords + shift;
            let inside = |axis: usize| at[axis] >= 0.0 && at[axis] < size[axis] as f32;
            let within = inside(0) && inside(1) && inside(2);
            if within { shaped.flags[shaped.lookup.index([at.x as usize, at.y as usize, at.z as usize])] } else { 0 }
        };
        let mut chains = 0;
        for point in points {
            let flags = flags_at(point);
            if flags & HAND != 0 {
                return refused;
            }
            chains |= flags;
        }
        if obstacles.iter().any(|point| flags_at(point) & HAND != 0) {
            refused
        } else {
            GraspContact { free: true, chains }
        }
    }
}

/// A link of a closing chain.
struct ChainLink {
    solid: Solid,
    /// Bit of its chain.
    chain: u16,
}

/// The links of the chains in each step of closing, for two orders: all joints of a chain at once, as in stiff fingers, and one after the other from
/// the root, as if the root joint were the softest.
fn closing(hand: &Hand, preshape: &Preshape) -> Result<Vec<Vec<ChainLink>>, PerceptionError> {
    let open = hand.open_configuration(preshape.value);
    let closed = hand.closed_configuration(preshape.value, 1.0);
    // Index of each coordinate among the closing ones of its chain, and their number.
    let chains = hand.chains();
    let place = |joint: usize| {
        let closes = |other: &usize| hand.joints[*other].is_independent() && hand.closing_rate(*other) != 0.0;
        let own = chains.iter().find(|chain| chain.joints.contains(&joint));
        let own: Vec<usize> = own.into_iter().flat_map(|chain| chain.joints.iter().copied().filter(closes)).collect();
        (own.iter().position(|other| *other == joint).unwrap_or(0), own.len().max(1))
    };
    let places: Vec<(usize, usize)> = hand.coordinates().map(place).collect();
    let mut steps = Vec::with_capacity(STEPS + 1);
    for step in 0..=STEPS {
        let share = step as f64 / STEPS as f64;
        let mut parts = Vec::new();
        for in_turn in [false, true] {
            let between = |index: usize| {
                let (place, count) = places[index];
                let own = if in_turn { (share * count as f64 - place as f64).clamp(0.0, 1.0) } else { share };
                open[index] + own * (closed[index] - open[index])
            };
            let configuration: Vec<f64> = (0..open.len()).map(between).collect();
            for placed in hand.shapes_at(&configuration)? {
                let moves = |chain: &usize| {
                    let mut joints = chains[*chain].joints.iter();
                    joints.any(|joint| hand.closing_rate(*joint) != 0.0)
                };
                if let Some(chain) = hand.chain_of_link(placed.link).filter(moves) {
                    let solid = Solid::new(&placed.collider.shape, &placed.hand_from_shape, 0.0, 0.0);
                    parts.push(ChainLink { solid, chain: 1 << chain.min(14) });
                }
            }
        }
        steps.push(parts);
    }
    Ok(steps)
}

/// Cells around the volume that the chains sweep with any preshape; where their number is set, they are as small as it allows.
fn grid(motions: &[Vec<Vec<ChainLink>>], config: &HandGridConfig) -> CellBox {
    let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    for part in motions.iter().flat_map(|steps| &steps[SPREAD..]).flatten() {
        let [from, to] = part.solid.bounds();
        low = low.inf(&from);
        high = high.sup(&to);
    }
    // Grasped objects are in front of the palm, whose surface is z = 0.
    low.z = low.z.max(0.0);
    let extent = high - low;
    let cell = config.shape.map_or(config.cell, |shape| {
        let needed = [0, 1, 2].map(|axis| extent[axis] / (shape[axis] as f64 - 2.0 * MARGIN));
        needed.into_iter().fold(config.cell, f64::max)
    });
    let shape = config.shape.unwrap_or_else(|| {
        [0, 1, 2].map(|axis| {
            let cells = (extent[axis] / cell + 2.0 * MARGIN - 1e-9).ceil() as usize;
            cells.next_multiple_of(MULTIPLE)
        })
    });
    // The swept volume is in the middle; along the approach it is at the beginning, so the grid extends beyond the fingertips.
    let middle = (low + high) * 0.5;
    let mut origin = middle - Vector3::from(shape.map(|n| n as f64)) * (0.5 * cell);
    origin.z = low.z - MARGIN * cell;
    CellBox { origin: Point3::from(origin), shape, cell }
}

impl PreshapeGrid {
    fn new(
        hand: &Hand,
        preshape: &Preshape,
        motion: &[Vec<ChainLink>],
        cells: &CellBox,
        config: &HandGridConfig,
    ) -> Result<Self, PerceptionError> {
        let mut swept = vec![0; cells.len()];
        for (step, parts) in motion.iter().enumerate() {
            let share = step as f64 / STEPS as f64;
            let value = (FIRST_LAST[0] + share * (FIRST_LAST[1] - FIRST_LAST[0])).round() as u8;
            for part in parts {
                cells.cover(&part.solid, |index| {
                    if swept[index] == 0 {
                        swept[index] = value;
                    }
                });
            }
        }
        let placed = hand.shapes_at(&hand.open_configuration(preshape.value))?;
        let solid = |standoff: f64| {
            let grown = placed.iter();
            grown.map(move |p| Solid::new(&p.collider.shape, &p.hand_from_shape, config.clearance, standoff))
        };
        let way: Vec<Solid> = solid(config.standoff).collect();
        let bounds = way.iter().map(Solid::bounds).chain(motion.iter().flatten().map(|part| part.solid.bounds()));
        let [low, high] = bounds
            .fold([Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY)], |[low, high], [from, to]| {
                [low.inf(&from), high.sup(&to)]
            });
        let lookup = CellBox::covering(&low, &high, LOOKUP);
        let mut flags = vec![0; lookup.len()];
        way.iter().for_each(|solid| lookup.cover(solid, |index| flags[index] |= HAND));
        for part in motion.iter().flatten() {
            lookup.cover(&part.solid, |index| flags[index] |= part.chain);
        }
        let reach = motion.iter().flatten().map(|part| part.solid.bounds()[1].z).fold(0.0, f64::max);
        let center = closing_center(hand, preshape.value)?;
        let corners = solid(0.0).flat_map(|solid| solid.corners().collect::<Vec<_>>()).collect();
        let turns = preshape.face.quarter == QuarterTurn::Always;
        Ok(Self { preshape: preshape.value, swept, turns, center, reach, corners, flags, lookup })
    }

    /// True if the open hand reaches below z = 0 at the pose or on the approach.
    fn hits_table(&self, pose: &Isometry3<f64>, standoff: f64) -> bool {
        let back = (pose.rotation * Vector3::z()).z * standoff;
        let lowest = self.corners.iter().map(|corner| (pose * corner).z).fold(f64::INFINITY, f64::min);
        lowest - back.max(0.0) < 0.0
    }
}
