//! Candidate grasps of an occupied volume on a table, from surface points and from the planner's boxes around them.
//!
//! The z axis of the frame points up from the table z = 0. Surface points are approached against the normal, vertically, and half-way
//! between, with every preshape and from several distances; the hand closes along the least extent of the surface around the point. Preshapes
//! that the planner always tries rotated by 90 degrees are rotated here too. Candidates that the open hand cannot reach, or in which too few
//! fingers meet the object, are dropped; the most diverse of the others are kept.

use crate::PerceptionError;
use crate::hand_grid::{GraspContact, HandGrid};
use crate::surface::{SurfacePoint, surface};
use graspbox_hand::GraspPose;
use graspbox_mesh::{VoxelFrame, in_range};
use graspbox_plan::{DecomposeParams, Fit, PoseParams, box_grasps, decompose_points};
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;

/// Number of directions in which the extent of the surface is measured.
const DIRECTIONS: usize = 8;
/// The hand is also tried rotated by 90 degrees if the least extent is at least this share of the one across.
const SQUARE: f64 = 0.7;
/// Depth below the top, along the approach, beyond which the surface does not count for the extent, metres: fingers do not reach it.
const DEPTH: f64 = 0.08;
/// Number of surface points for the extent and the boxes.
const SHAPE_POINTS: usize = 400;
/// Normals whose z is below this are not approached: the hand would come from below.
const DOWN: f64 = -0.3;
/// Approaches within this cosine of the vertical also give the lowest pose, with the fingertips just above the table.
const STEEP: f64 = 0.85;
/// Distance of the lowest fingertip from the table as it closes, metres.
const OVER_TABLE: f64 = 0.0015;
/// Translation (metres) or rotation (radians) that counts as one unit of difference between poses.
const MOVED: f64 = 0.03;
const TURNED: f64 = 0.5;

/// The origin of a candidate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Source {
    /// A surface point, approached against its normal or half-way to the vertical.
    Normal,
    /// A surface point, approached vertically.
    Vertical,
    /// A steep approach, with the fingertips just above the table.
    Low,
    /// A face of a box.
    Box,
}

impl Source {
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Normal => "normal",
            Self::Vertical => "vertical",
            Self::Low => "low",
            Self::Box => "box",
        }
    }
}

/// Settings of the proposals.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ProposalConfig {
    /// Number of surface points to approach, spread as far apart as possible.
    pub seeds: usize,
    /// Distances of the palm from the top of the surface, metres.
    pub standoffs: Vec<f64>,
    /// Radius around a point within which the extent of the surface is measured, metres.
    pub radius: f64,
    /// Number of boxes whose faces are also approached; 0 for none.
    pub boxes: usize,
    /// Least number of chains that meet the object as they close.
    pub fingers: usize,
    /// Number of surface points for collisions.
    pub points: usize,
    /// Greatest number of candidates.
    pub most: usize,
}

impl Default for ProposalConfig {
    fn default() -> Self {
        Self {
            seeds: 32,
            standoffs: vec![0.005, 0.02, 0.035, 0.05, 0.065],
            radius: 0.05,
            boxes: 4,
            fingers: 2,
            points: 1000,
            most: 128,
        }
    }
}

impl ProposalConfig {
    /// # Errors
    /// [`PerceptionError::OutOfRange`] names the first field outside its range.
    pub fn check(&self) -> Result<(), PerceptionError> {
        in_range("seeds", self.seeds as f64, 0.0..=1000.0, "points")?;
        in_range("len(standoffs)", self.standoffs.len() as f64, 1.0..=100.0, "")?;
        self.standoffs.iter().try_for_each(|&standoff| in_range("standoffs", standoff, 0.0..=0.5, "m"))?;
        in_range("radius", self.radius, 0.001..=1.0, "m")?;
        in_range("boxes", self.boxes as f64, 0.0..=64.0, "")?;
        in_range("fingers", self.fingers as f64, 0.0..=15.0, "")?;
        in_range("points", self.points as f64, 16.0..=1e5, "")?;
        Ok(in_range("most", self.most as f64, 1.0..=1e5, "")?)
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Pose of the hand in the frame of the grid.
    pub pose: Isometry3<f64>,
    /// Index of the preshape in the hand's file.
    pub preshape: usize,
    /// Its origin.
    pub source: Source,
}

/// At most `most` candidates, the most diverse first.
///
/// * `occupancy`: (N, N, N), 0 to 255; a quarter or more counts as occupied.
/// * `obstacles`: points that the open hand must not touch either.
///
/// Empty if nothing is occupied, or nothing is feasible. The result does not depend on the number of threads.
///
/// # Errors
/// [`PerceptionError::OutOfRange`] for the config.
pub fn propose(
    hand: &HandGrid,
    grid: &VoxelFrame,
    occupancy: &[u8],
    obstacles: &[Point3<f32>],
    config: &ProposalConfig,
) -> Result<Vec<Candidate>, PerceptionError> {
    config.check()?;
    let surface = surface(grid, occupancy);
    if surface.is_empty() {
        return Ok(Vec::new());
    }
    let shape = spread(&surface, SHAPE_POINTS);
    let mut candidates = on_points(hand, &shape, config);
    candidates.extend(on_boxes(hand, &shape, config)?);
    let points = collision_points(&surface, config.points);
    let needed = (config.fingers as u32).min(hand.chains);
    let meets = |candidate: &Candidate| hand.meets(&points, obstacles, &candidate.pose, candidate.preshape);
    let met: Vec<GraspContact> = candidates.par_iter().map(meets).collect();
    let kept = candidates.into_iter().zip(met);
    let kept = kept.filter(|(_, met)| met.free && met.chains.count_ones() >= needed).map(|(candidate, _)| candidate);
    Ok(most_different(hand, kept.collect(), config.most))
}

/// Points of an occupancy's surface for collisions, in an order in which early ones are far apart.
#[must_use]
pub fn obstacle_points(grid: &VoxelFrame, occupancy: &[u8], most: usize) -> Vec<Point3<f32>> {
    collision_points(&surface(grid, occupancy), most)
}

fn collision_points(surface: &[SurfacePoint], most: usize) -> Vec<Point3<f32>> {
    spread(surface, most).iter().map(|p| p.point.cast::<f32>()).collect()
}

/// At most `most` points at equal steps of their order, in an order in which early ones are far apart.
fn spread(surface: &[SurfacePoint], most: usize) -> Vec<SurfacePoint> {
    let count = surface.len().min(most);
    let at = |index: usize| surface[index * surface.len() / count];
    // Every 16th, then those half-way between, and so on.
    let offsets = [0, 8, 4, 12, 2, 10, 6, 14, 1, 9, 5, 13, 3, 11, 7, 15];
    offsets.into_iter().flat_map(|offset| (offset..count).step_by(16)).map(at).collect()
}

/// Candidates that approach surface points.
fn on_points(hand: &HandGrid, shape: &[SurfacePoint], config: &ProposalConfig) -> Vec<Candidate> {
    let approached: Vec<&SurfacePoint> = shape.iter().filter(|p| p.normal.z >= DOWN).collect();
    let seeds =
        farthest(approached.len(), config.seeds, 0, |a, b| (approached[a].point - approached[b].point).norm_squared());
    let of_seed = |(order, seed): (usize, &usize)| {
        let SurfacePoint { point, normal } = approached[*seed];
        let down = -Vector3::z();
        let mut approaches = vec![(-normal, Source::Normal)];
        approaches.extend((down - normal).try_normalize(1e-3).map(|approach| (approach, Source::Normal)));
        if order % 2 == 0 {
            approaches.push((down, Source::Vertical));
        }
        let along = |(approach, source)| approach_point(hand, shape, point, approach, source, config);
        approaches.into_iter().flat_map(along).collect::<Vec<_>>()
    };
    seeds.par_iter().enumerate().map(of_seed).collect::<Vec<_>>().concat()
}

/// Candidates that approach one point along one direction.
fn approach_point(
    hand: &HandGrid,
    shape: &[SurfacePoint],
    point: &Point3<f64>,
    approach: Vector3<f64>,
    source: Source,
    config: &ProposalConfig,
) -> Vec<Candidate> {
    let local = Local::new(shape, point, &approach, config.radius);
    let mut candidates = Vec::new();
    let (directions, square) = local.closing_directions();
    for (turned, (across, middle)) in directions.into_iter().enumerate() {
        for across in [across, -across] {
            let columns = [across, approach.cross(&across), approach];
            let rotation = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&columns));
            let rotation = UnitQuaternion::from_rotation_matrix(&rotation);
            for (preshape, shaped) in hand.shaped.iter().enumerate() {
                if turned > 0 && !square && !shaped.turns {
                    continue;
                }
                let on_top = point - approach * local.top + middle - rotation * shaped.center;
                let mut push = |out: f64, source: Source| {
                    let at = on_top - approach * out;
                    let pose = Isometry3::from_parts(Translation3::from(at.coords), rotation);
                    candidates.push(Candidate { pose, preshape, source });
                };
                config.standoffs.iter().for_each(|&out| push(out, source));
                if -approach.z >= STEEP {
                    let out = (shaped.reach + OVER_TABLE - on_top.z) / -approach.z;
                    if (0.0..=shaped.reach).contains(&out) {
                        push(out, Source::Low);
                    }
                }
            }
        }
    }
    candidates
}

/// A direction in which the hand may close, and the vector along it to the middle of the surface.
type Closing = (Vector3<f64>, Vector3<f64>);

/// The surface around a point, in the plane normal to an approach.
struct Local {
    /// Two directions across the approach.
    axes: [Vector3<f64>; 2],
    /// Positions along these, metres from the point.
    across: Vec<Vector2<f64>>,
    /// Greatest height of the surface against the approach, metres from the point.
    top: f64,
}

impl Local {
    fn new(shape: &[SurfacePoint], point: &Point3<f64>, approach: &Vector3<f64>, radius: f64) -> Self {
        let first = approach.cross(&Vector3::ith(approach.iamin(), 1.0)).normalize();
        let axes = [first, approach.cross(&first)];
        let near = |p: &SurfacePoint| {
            let away = p.point - point;
            let across = Vector2::new(away.dot(&axes[0]), away.dot(&axes[1]));
            (across.norm() <= radius).then(|| (across, -away.dot(approach)))
        };
        let near: Vec<(Vector2<f64>, f64)> = shape.iter().filter_map(near).collect();
        let top = near.iter().map(|(_, height)| *height).fold(0.0, f64::max);
        let reached = near.into_iter().filter(|(_, height)| *height >= top - DEPTH);
        Self { axes, across: reached.map(|(across, _)| across).collect(), top }
    }

    /// Least and greatest position along a direction, metres.
    fn extent(&self, angle: f64) -> [f64; 2] {
        let direction = Vector2::new(angle.cos(), angle.sin());
        let along = self.across.iter().map(|p| p.dot(&direction));
        along.fold([0.0_f64, 0.0_f64], |[low, high], x| [low.min(x), high.max(x)])
    }

    /// The direction of least extent and the one across, and whether both extents are similar.
    fn closing_directions(&self) -> ([Closing; 2], bool) {
        let angles = (0..DIRECTIONS).map(|i| i as f64 * PI / DIRECTIONS as f64);
        let widths: Vec<(f64, [f64; 2])> = angles.map(|angle| (angle, self.extent(angle))).collect();
        let width = |index: usize| widths[index].1[1] - widths[index].1[0];
        let least = (0..DIRECTIONS).min_by(|a, b| width(*a).total_cmp(&width(*b))).unwrap_or(0);
        let across = (least + DIRECTIONS / 2) % DIRECTIONS;
        let direction = |index: usize| {
            let (angle, [low, high]) = widths[index];
            let direction = self.axes[0] * angle.cos() + self.axes[1] * angle.sin();
            (direction, direction * (0.5 * (low + high)))
        };
        ([least, across].map(direction), width(least) >= SQUARE * width(across))
    }
}

/// The planner's candidates, from boxes around the points.
fn on_boxes(
    hand: &HandGrid,
    shape: &[SurfacePoint],
    config: &ProposalConfig,
) -> Result<Vec<Candidate>, PerceptionError> {
    let points: Vec<Point3<f64>> = shape.iter().map(|p| p.point).collect();
    // A stray voxel has fewer points, which span no box.
    if config.boxes == 0 || points.len() < 6 {
        return Ok(Vec::new());
    }
    let params = DecomposeParams { fit: Fit::Pca, max_boxes: config.boxes, ..DecomposeParams::default() };
    let tree = decompose_points(&points, &params)?;
    let sum = points.iter().fold(Vector3::zeros(), |sum, p| sum + p.coords);
    let centroid = Point3::from(sum / points.len() as f64);
    let poses = PoseParams { variations: 2, ..PoseParams::default() };
    let grasps = box_grasps(&tree, &centroid, &Vector3::z(), &hand.hand, &poses, 0)?;
    let candidate = |GraspPose { object_from_hand, preshape }: GraspPose| Candidate {
        pose: object_from_hand,
        preshape: hand.nearest(preshape),
        source: Source::Box,
    };
    Ok(grasps.into_iter().map(candidate).collect())
}

/// At most `most` candidates, each as different as possible from the previous ones.
fn most_different(hand: &HandGrid, candidates: Vec<Candidate>, most: usize) -> Vec<Candidate> {
    let centers: Vec<Point3<f64>> = candidates.iter().map(|candidate| candidate.pose * hand.center).collect();
    let distance = |a: usize, b: usize| {
        let (one, other) = (&candidates[a], &candidates[b]);
        let moved = (centers[a] - centers[b]).norm_squared() / (MOVED * MOVED);
        let same = one.pose.rotation.coords.dot(&other.pose.rotation.coords).abs();
        // The square of the angle where it is small; monotonic everywhere.
        let turned = 8.0 * (1.0 - same) / (TURNED * TURNED);
        moved + turned + f64::from(u8::from(one.preshape != other.preshape))
    };
    farthest(candidates.len(), most, 0, distance).into_iter().map(|index| candidates[index]).collect()
}

/// Farthest-point sampling of at most `most` of `count` elements, from `first`; no two of them are equal.
fn farthest(count: usize, most: usize, first: usize, distance: impl Fn(usize, usize) -> f64) -> Vec<usize> {
    let mut nearest = vec![f64::INFINITY; count];
    let mut taken = Vec::new();
    let mut next = (first < count).then_some(first);
    while let Some(one) = next.filter(|&one| taken.len() < most && nearest[one] > 0.0) {
        taken.push(one);
        for (other, nearest) in nearest.iter_mut().enumerate() {
            *nearest = nearest.min(distance(one, other));
        }
        nearest[one] = 0.0;
        next = (0..count).max_by(|a, b| nearest[*a].total_cmp(&nearest[*b]).then(b.cmp(a)));
    }
    taken
}
