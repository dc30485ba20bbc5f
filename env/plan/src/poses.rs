//! Candidate poses from boxes: outermost box first, every face, both orientations, variations along and about the long axis.

use crate::PlanError;
use crate::boxes::OrientedBox;
use crate::preshape::{FaceSize, closing_center, preshapes};
use graspbox_hand::{Grasp, GraspPose, Hand};
use graspbox_mesh::in_range;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

/// Half the size of a palm, metres: parts of a box beyond it do not constrain a rotated hand.
const PALM: f64 = 0.04;
/// Depth of the grasp centre of a hand for which `standoffs` are given, metres: that of the ReFlex.
const USUAL_DEPTH: f64 = 0.06;
/// Most random variations per face and orientation.
const MOST_VARIATIONS: usize = 10_000;
/// Most extra distances.
const MOST_STANDOFFS: usize = 1000;
/// Most antipodal pairs.
const MOST_PAIRS: usize = 1000;
/// Most candidates of a plan: they occupy 0.1 GB.
pub const MOST_CANDIDATES: usize = 200_000;

/// Variation of poses along and about the long axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Variation {
    /// The plain pose, and uniformly random ones.
    #[default]
    Random,
    /// The grid of the reference study: {0, +-1, +-2} fifths of the long side times {0, +10} degrees, at the base offset only.
    Grid,
}

/// Settings of the candidate poses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PoseParams {
    /// Distance of the palm from the box, metres (reference study: 5 mm).
    pub offset: f64,
    /// Extra distances, added to `offset`, metres; at most 1,000. Fingers need space to close above the table: a flat object is grasped with
    /// the palm up to a finger's length above it. For a hand whose grasp centre is deeper than 60 mm they grow in proportion.
    pub standoffs: Vec<f64>,
    /// The kind of variation.
    pub variation: Variation,
    /// Random variations per face and orientation, at most 10,000, and as many again for each range of the hand (`closing_range`, `side_range`,
    /// `max_roll`, `max_lean`). A plan has at most 200,000 candidates.
    pub variations: usize,
    /// Greatest shift along the long side, as a share of it. The grid of the study goes to 0.4.
    pub max_shift: f64,
    /// Greatest rotation about the long axis, radians.
    pub max_tilt: f64,
    /// A face whose short side is at least this share of its long one is also tried with the hand rotated by 90 degrees.
    pub square: f64,
    /// Try the box around the whole object like the leaves, unless it is the only leaf.
    pub whole: bool,
    /// Antipodal pairs of surface points (walls, rims, handles) for hands with a bounded opening, at most 1,000.
    pub pairs: usize,
}

impl PoseParams {
    /// # Errors
    /// [`PlanError::OutOfRange`] for the first value out of range.
    pub fn validate(&self) -> Result<(), PlanError> {
        let distance = |name, value: f64| in_range(name, value, 0.0..=0.5, "m");
        distance("offset", self.offset)?;
        in_range("variations", self.variations as f64, 0.0..=MOST_VARIATIONS as f64, "")?;
        in_range("len(standoffs)", self.standoffs.len() as f64, 0.0..=MOST_STANDOFFS as f64, "")?;
        self.standoffs.iter().try_for_each(|&value| distance("standoffs", value))?;
        in_range("pairs", self.pairs as f64, 0.0..=MOST_PAIRS as f64, "")?;
        in_range("max_shift", self.max_shift, 0.0..=1.0, "")?;
        in_range("max_tilt", self.max_tilt, 0.0..=std::f64::consts::FRAC_PI_2, "rad")?;
        Ok(in_range("square", self.square, 0.0..=1.0, "")?)
    }
}

impl Default for PoseParams {
    fn default() -> Self {
        Self {
            offset: 0.005,
            standoffs: vec![0.015, 0.03, 0.045, 0.06],
            variation: Variation::Random,
            variations: 8,
            max_shift: 0.4,
            max_tilt: 0.5,
            square: 0.6,
            whole: true,
            pairs: 60,
        }
    }
}

/// A candidate pose before the filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Proposal {
    pub grasp: GraspPose,
    pub box_index: usize,
    pub face: usize,
}

/// The faces of a box as (axis, sign), in order of preference. Their numbers are `2 axis` for the positive and `2 axis + 1` for the negative side.
fn faces(bounds: &OrientedBox, up: &Vector3<f64>, outward: &Vector3<f64>) -> Vec<(usize, f64)> {
    let mut all: Vec<(usize, f64)> = (0..3).flat_map(|axis| [(axis, 1.0), (axis, -1.0)]).collect();
    let along = |&(axis, sign): &(usize, f64), direction: &Vector3<f64>| bounds.axes.column(axis).dot(direction) * sign;
    all.sort_by(|a, b| along(b, up).total_cmp(&along(a, up)));
    if all[0].0 == 0 {
        // The face nearest to up is an end of the long axis: the one that points away from the object's centre comes first.
        all.sort_by(|a, b| along(b, outward).total_cmp(&along(a, outward)));
    }
    let (axis, sign) = all[0];
    // The pose mirrored by pi about the long axis comes second.
    let rank = |face: &(usize, f64)| {
        if *face == (axis, sign) {
            0
        } else if face.0 == axis {
            1
        } else {
            2
        }
    };
    all.sort_by_key(rank);
    all
}

/// All candidates, outermost box first.
///
/// * `boxes`: indices and boxes; `centroid`, `up`: centre of the object and normal of the table; object frame.
///
/// # Errors
/// [`PlanError::TooMany`] beyond [`MOST_CANDIDATES`], [`PlanError::UnsupportedHand`] for a preshape beyond the hand's limits.
pub(crate) fn propose(
    boxes: &[(usize, OrientedBox)],
    centroid: &Point3<f64>,
    up: &Vector3<f64>,
    hand: &Hand,
    params: &PoseParams,
    seed: u64,
) -> Result<Vec<Proposal>, PlanError> {
    let mut order: Vec<&(usize, OrientedBox)> = boxes.iter().collect();
    let distance = |bounds: &OrientedBox| (bounds.center - centroid).norm();
    order.sort_by(|a, b| distance(&b.1).total_cmp(&distance(&a.1)));
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let centers = hand.preshapes().iter().map(|named| Ok((named.value, closing_center(hand, named.value)?)));
    let centers = centers.collect::<Result<Vec<_>, PlanError>>()?;
    let mut proposals = Vec::new();
    for (box_index, bounds) in order {
        for (axis, sign) in faces(bounds, up, &(bounds.center - centroid)) {
            let face = Face::new(bounds, axis, sign);
            for (quarter, long) in face.orientations() {
                let size = face.size(bounds, long);
                for preshape in preshapes(hand, size, quarter, params.square) {
                    let known = centers.iter().find(|(value, _)| *value == preshape);
                    let center = known.map_or_else(Vector3::zeros, |(_, center)| *center);
                    let variations = variations(params, &hand.grasp, &mut rng);
                    if proposals.len() + variations.len() > MOST_CANDIDATES {
                        return Err(PlanError::TooMany {
                            boxes: boxes.len(),
                            each: variations.len(),
                            limit: MOST_CANDIDATES,
                        });
                    }
                    for variation in variations {
                        let pose = face.pose(bounds, long, &variation, params, &center);
                        let grasp = GraspPose { object_from_hand: pose, preshape };
                        let face = 2 * axis + usize::from(sign < 0.0);
                        proposals.push(Proposal { grasp, box_index: *box_index, face });
                    }
                }
            }
        }
    }
    Ok(proposals)
}

struct Face {
    /// Outward normal.
    normal: Vector3<f64>,
    /// The two axes of the face, longer one first.
    sides: [usize; 2],
}

/// Difference of a pose from the plain one of its face.
#[derive(Default)]
struct Variant {
    /// Shift along the long side, as a share of it.
    shift: f64,
    /// Rotation about the long side, radians.
    tilt: f64,
    /// Extra distance, metres.
    standoff: f64,
    /// Offset of the box from the hand's centre, along the hand's x and y, metres.
    ahead: f64,
    aside: f64,
    /// Rotations of the hand about its z, then about its x, radians; the box keeps its position in the palm.
    roll: f64,
    lean: f64,
}

impl Face {
    fn new(bounds: &OrientedBox, axis: usize, sign: f64) -> Self {
        let sides = [[1, 2], [0, 2], [0, 1]][axis];
        Self { normal: bounds.axes.column(axis) * sign, sides }
    }

    /// Whether the hand is rotated by 90 degrees, and the axis that then counts as long, in both directions (rotation by pi about hand z).
    fn orientations(&self) -> [(bool, (usize, f64)); 4] {
        let [long, short] = self.sides;
        [(false, (long, 1.0)), (false, (long, -1.0)), (true, (short, 1.0)), (true, (short, -1.0))]
    }

    fn size(&self, bounds: &OrientedBox, (long, _): (usize, f64)) -> FaceSize {
        let across = self.sides[0] + self.sides[1] - long;
        let (length, width) = (2.0 * bounds.half_extents[long], 2.0 * bounds.half_extents[across]);
        FaceSize { width, length }
    }

    fn pose(
        &self,
        bounds: &OrientedBox,
        (axis, sign): (usize, f64),
        vary: &Variant,
        params: &PoseParams,
        center: &Vector3<f64>,
    ) -> Isometry3<f64> {
        let long = bounds.axes.column(axis).into_owned();
        let normal = Rotation3::from_axis_angle(&Unit::new_unchecked(long), vary.tilt) * self.normal;
        let (z, along) = (-normal, long * sign);
        // The hand closes along its x, so hand y is along the long side.
        let columns = [along.cross(&z), along, z];
        let facing = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&columns));
        let (turned, half_extents) = if vary.roll == 0.0 && vary.lean == 0.0 {
            (facing, bounds.half_extents)
        } else {
            let [roll, lean] = [(Vector3::z_axis(), vary.roll), (Vector3::x_axis(), vary.lean)]
                .map(|(axis, angle)| Rotation3::from_axis_angle(&axis, angle));
            // The far ends of the box are next to the palm, not under it.
            (facing * roll * lean, bounds.half_extents.map(|half| half.min(PALM)))
        };
        let normal = -turned.matrix().column(2);
        let rotation = UnitQuaternion::from_rotation_matrix(&turned);
        let out = bounds.axes.tr_mul(&normal).abs().dot(&half_extents) + params.offset + vary.standoff;
        let shift = long * (vary.shift * 2.0 * bounds.half_extents[axis]);
        let held = center + Vector3::new(vary.ahead, vary.aside, 0.0);
        let at = bounds.center.coords + shift + normal * out - rotation * held;
        Isometry3::from_parts(Translation3::from(at), rotation)
    }
}

/// The variants of a face: `params.variations`, and as many again for each range of the hand. Ranges that the hand does not have consume no random
/// numbers.
fn variations(params: &PoseParams, grasp: &Grasp, rng: &mut ChaCha8Rng) -> Vec<Variant> {
    let either_way = |most: f64| [-most, most];
    let own = [grasp.closing_range, grasp.side_range, either_way(grasp.max_roll), either_way(grasp.max_lean)];
    let given = own.iter().filter(|[least, most]| least < most).count();
    match params.variation {
        Variation::Grid => {
            let shifts = [0.0, 0.2, -0.2, 0.4, -0.4];
            let tilts = [0.0, 10.0_f64.to_radians()];
            let at = |shift| tilts.map(|tilt| Variant { shift, tilt, ..Variant::default() });
            shifts.into_iter().flat_map(at).collect()
        }
        Variation::Random => {
            let scale = (grasp.center.z / USUAL_DEPTH).max(1.0);
            let extra = params.standoffs.iter().map(|standoff| scale * standoff);
            let standoffs: Vec<f64> = std::iter::once(0.0).chain(extra).collect();
            let mut all: Vec<Variant> =
                standoffs.iter().map(|&standoff| Variant { standoff, ..Variant::default() }).collect();
            all.extend((0..params.variations * (1 + given)).map(|_| {
                let shift = params.max_shift * (2.0 * rng.random::<f64>() - 1.0);
                let tilt = params.max_tilt * (2.0 * rng.random::<f64>() - 1.0);
                let standoff = standoffs[rng.random_range(0..standoffs.len())];
                let [ahead, aside, roll, lean] =
                    own.map(|[least, most]| if least < most { rng.random_range(least..most) } else { 0.0 });
                Variant { shift, tilt, standoff, ahead, aside, roll, lean }
            }));
            all
        }
    }
}
