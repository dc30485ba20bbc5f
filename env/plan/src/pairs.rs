//! Candidate poses across walls, rims and handles, from antipodal pairs of surface points no farther apart than the opening of the hand. Boxes do not
//! propose them: the face of a bowl is wider than any jaw, but its wall is not.
//!
//! Only hands with a bounded opening (a `width` of a preshape) get such poses. The hand's x joins the two points, its grasp centre is between them,
//! and it approaches as steeply from above as x allows, or rotated about x by a random angle.

use crate::PlanError;
use crate::boxes::OrientedBox;
use crate::poses::{MOST_CANDIDATES, PoseParams, Proposal, Variation};
use graspbox_hand::{GraspPose, Hand, Preshape};
use graspbox_mesh::SurfaceSample;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Two points are antipodal if the cosine between their normals is at most this: 26 degrees, less than the friction cone of rubber.
const FACING: f64 = -0.9;
/// Greatest distance of a point from the line along the other's normal, metres: samples are about 5 mm apart.
const BESIDE: f64 = 0.004;
/// Number of points that are tried per requested pair.
const ASKED: usize = 4;
/// Greatest rotation of the hand about its x away from the steepest approach, radians.
const MAX_TURN: f64 = 1.2;
/// Greatest extra distance of the hand from the pair, metres: finger tips extend this far beyond the grasp centre.
const MAX_RAISE: f64 = 0.012;

/// An antipodal pair.
struct Pair {
    middle: Point3<f64>,
    /// Unit vector from the first point to the second.
    along: Vector3<f64>,
}

/// Inputs for poses across pairs; object frame.
pub(crate) struct Surroundings<'a> {
    pub samples: &'a [SurfaceSample],
    /// The boxes, each with its index.
    pub boxes: &'a [(usize, OrientedBox)],
    /// Normal of the table.
    pub up: Unit<Vector3<f64>>,
}

/// Four poses for each pair and preshape: the steepest approach and a rotated one, each at the grasp centre and farther out.
///
/// # Errors
/// [`PlanError::TooMany`] if the plan, with `before` candidates already, would have more than [`MOST_CANDIDATES`].
pub(crate) fn propose_across(
    thin: &Surroundings<'_>,
    hand: &Hand,
    params: &PoseParams,
    seed: u64,
    before: usize,
) -> Result<Vec<Proposal>, PlanError> {
    const EACH: usize = 4;
    let opens = |preshape: &&Preshape| preshape.face.width[1].is_finite();
    let preshapes: Vec<&Preshape> = hand.preshapes().iter().filter(opens).collect();
    let mut proposals = Vec::new();
    if params.variation == Variation::Grid || params.pairs == 0 {
        return Ok(proposals);
    }
    // A separate random stream, so these poses change no others.
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(1);
    for preshape in preshapes {
        let pairs = find_pairs(thin.samples, preshape.face.width, params.pairs);
        if before + proposals.len() + EACH * pairs.len() > MOST_CANDIDATES {
            return Err(PlanError::TooMany { boxes: thin.boxes.len(), each: EACH, limit: MOST_CANDIDATES });
        }
        for pair in pairs {
            let sign = if rng.random::<bool>() { 1.0 } else { -1.0 };
            let turn = rng.random_range(-MAX_TURN..MAX_TURN);
            let raise = rng.random_range(0.0..MAX_RAISE);
            for (turn, raise) in [(0.0, 0.0), (0.0, raise), (turn, 0.0), (turn, raise)] {
                let pose = pose_across(&pair, sign, turn, raise, &thin.up, &hand.grasp.center);
                let (box_index, face) = nearest_face(thin.boxes, &pair.middle, &(pose * Vector3::z()));
                proposals.push(Proposal {
                    grasp: GraspPose { object_from_hand: pose, preshape: preshape.value },
                    box_index,
                    face,
                });
            }
        }
    }
    Ok(proposals)
}

/// At most `wanted` pairs, spread over the surface.
fn find_pairs(samples: &[SurfaceSample], width: [f64; 2], wanted: usize) -> Vec<Pair> {
    let every = (samples.len() / (ASKED * wanted)).max(1);
    let found: Vec<Pair> = samples.iter().step_by(every).filter_map(|first| partner(samples, first, width)).collect();
    let every = found.len().div_ceil(wanted).max(1);
    found.into_iter().step_by(every).collect()
}

/// The antipodal partner of `first`: the nearest point along its inward normal, at a distance within `width`.
fn partner(samples: &[SurfaceSample], first: &SurfaceSample, width: [f64; 2]) -> Option<Pair> {
    let along = -first.normal;
    let behind = |second: &SurfaceSample| {
        let from = second.point - first.point;
        let gap = from.dot(&along);
        let aside = (from - along * gap).norm_squared();
        (second.normal.dot(&first.normal) <= FACING && gap > 0.0 && aside < BESIDE * BESIDE).then_some(gap)
    };
    let gap = samples.iter().filter_map(behind).fold(f64::INFINITY, f64::min);
    let fits = gap >= width[0] && gap <= width[1];
    fits.then(|| Pair { middle: first.point + along * (0.5 * gap), along })
}

fn pose_across(
    pair: &Pair,
    sign: f64,
    turn: f64,
    raise: f64,
    up: &Vector3<f64>,
    center: &Point3<f64>,
) -> Isometry3<f64> {
    let x = pair.along * sign;
    let level = |v: &Vector3<f64>| v - x * x.dot(v);
    // If x is vertical, every approach is horizontal, and any serves.
    let sideways = level(&Vector3::ith(x.iamin(), 1.0));
    let steepest = level(&-up).try_normalize(0.1).unwrap_or_else(|| sideways.normalize());
    let z = Rotation3::from_axis_angle(&Unit::new_unchecked(x), turn) * steepest;
    let columns = [x, z.cross(&x), z];
    let rotation =
        UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(Matrix3::from_columns(&columns)));
    let at = pair.middle.coords - rotation * center.coords - z * raise;
    Isometry3::from_parts(Translation3::from(at), rotation)
}

/// The box nearest to a point, and its face most opposed to `approach`.
fn nearest_face(boxes: &[(usize, OrientedBox)], point: &Point3<f64>, approach: &Vector3<f64>) -> (usize, usize) {
    let mut best = (f64::INFINITY, 0, 0);
    for (index, bounds) in boxes {
        let at = bounds.axes.tr_mul(&(point - bounds.center));
        let outside = (at.abs() - bounds.half_extents).sup(&Vector3::zeros()).norm();
        if outside < best.0 {
            let against = -bounds.axes.tr_mul(approach);
            let axis = against.iamax();
            best = (outside, *index, 2 * axis + usize::from(against[axis] < 0.0));
        }
    }
    (best.1, best.2)
}

#[cfg(test)]
mod tests {
    use super::*;
    use graspbox_hand::assets::asset;

    /// Samples, 5 mm apart, of both sides of an upright wall, 6 mm thick and 20 cm square.
    fn wall() -> Vec<SurfaceSample> {
        let side = |x: f64| {
            let at = move |i: usize| Point3::new(x, 0.005 * (i % 40) as f64, 0.005 * (i / 40) as f64);
            (0..1600).map(move |i| SurfaceSample { point: at(i), normal: Vector3::x() * x.signum(), face: 0 })
        };
        side(0.003).chain(side(-0.003)).collect()
    }

    fn around_it() -> Vec<(usize, OrientedBox)> {
        let half_extents = Vector3::new(0.003, 0.1, 0.1);
        vec![(4, OrientedBox { center: Point3::new(0.0, 0.1, 0.1), axes: Matrix3::identity(), half_extents })]
    }

    fn across(hand: &str, params: &PoseParams) -> Vec<Proposal> {
        let hand = asset(hand).unwrap().read().unwrap();
        let (samples, boxes) = (wall(), around_it());
        let thin = Surroundings { samples: &samples, boxes: &boxes, up: Vector3::z_axis() };
        propose_across(&thin, &hand, params, 3, 0).unwrap()
    }

    #[test]
    fn a_jaw_takes_a_wall_between_its_fingers() {
        let hand = asset("panda_gripper").unwrap().read().unwrap();
        let proposals = across("panda_gripper", &PoseParams::default());
        assert!(proposals.len() >= 4 * 30 && proposals.len() <= 4 * 60, "{}", proposals.len());
        for (i, proposal) in proposals.iter().enumerate() {
            let pose = proposal.grasp.object_from_hand;
            assert!((pose * Vector3::x()).x.abs() > 1.0 - 1e-9, "x joins the sides");
            let center = pose * hand.grasp.center;
            assert!(center.x.abs() < 1e-9, "the grasp centre is inside the wall");
            assert_eq!(proposal.box_index, 4);
            if i % 4 == 0 {
                assert!((pose * Vector3::z()).z < -1.0 + 1e-9, "from above");
                assert_eq!(proposal.face, 4, "the upper face");
            }
        }
    }

    #[test]
    fn only_hands_that_say_how_far_they_open_and_only_where_asked_for() {
        assert!(across("reflex", &PoseParams::default()).is_empty());
        assert!(across("panda_gripper", &PoseParams { pairs: 0, ..PoseParams::default() }).is_empty());
        let grid = PoseParams { variation: Variation::Grid, ..PoseParams::default() };
        assert!(across("panda_gripper", &grid).is_empty());
    }

    #[test]
    fn what_is_wider_than_the_hand_opens_has_no_pair() {
        assert!(find_pairs(&wall(), [0.0, 0.005], 60).is_empty());
        assert!(!find_pairs(&wall(), [0.0, 0.007], 60).is_empty());
    }
}
