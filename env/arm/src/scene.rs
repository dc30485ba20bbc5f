//! What an arm must not touch: the table, measured points, and objects. World frame.

use crate::bodies::{Solid, half_height, is_near, library, library_pose, library_shape};
use crate::error::ArmError;
use graspbox_hand::Shape;
use graspbox_plan::Obstacle;
use graspbox_plan::collision::COVERED;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use parry3d_f64::bounding_volume::BoundingVolume;
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::shape::SharedShape;
use std::sync::Arc;

/// Most points.
pub const MAX_POINTS: usize = 1 << 22;
/// Most objects.
pub const MAX_OBSTACLES: usize = 1 << 12;
/// Side of a cell of the grid of points, metres, unless there would be too many cells.
const CELL: f64 = 0.04;
const MAX_CELLS: usize = 1 << 20;
/// Farthest distance from a shape at which points are looked for, metres.
const FAR: f64 = 0.04;
/// Points nearer than this to one that is kept are left out, metres.
const THIN: f64 = 0.005;

/// What an arm touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Touched {
    Table,
    /// A measured point.
    Points,
    /// An object, by its index.
    Obstacle(usize),
}

/// The surroundings of an arm.
#[derive(Clone)]
pub struct Scene {
    world_from_base: Isometry3<f64>,
    cloud: Option<Arc<Cloud>>,
    obstacles: Vec<(Arc<Obstacle>, Isometry3<f64>)>,
    /// Distance that links keep from the table and objects, and from points, metres.
    clearance: f64,
    point_radius: f64,
}

impl std::fmt::Debug for Scene {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let points = self.cloud.as_ref().map_or(0, |cloud| cloud.points.len());
        write!(f, "Scene({points} points, {} objects)", self.obstacles.len())
    }
}

impl Scene {
    /// The surroundings of an arm at `world_from_base`, over the table z = 0.
    ///
    /// * `points`: measured points, metres.
    /// * `obstacles`: objects with their poses.
    ///
    /// # Errors
    /// [`ArmError::UnderTable`], and [`ArmError::TooMany`] for points or objects.
    pub fn new(
        world_from_base: Isometry3<f64>,
        points: &[Point3<f64>],
        obstacles: Vec<(Arc<Obstacle>, Isometry3<f64>)>,
        clearance: f64,
        point_radius: f64,
    ) -> Result<Self, ArmError> {
        let z = world_from_base.translation.z;
        if z < -UNDER {
            return Err(ArmError::UnderTable { z });
        }
        for (what, count, limit) in [("points", points.len(), MAX_POINTS), ("objects", obstacles.len(), MAX_OBSTACLES)]
        {
            if count > limit {
                return Err(ArmError::TooMany { what, count, limit });
            }
        }
        let obstacles = obstacles.into_iter().map(|(obstacle, pose)| (obstacle, pose.inverse())).collect();
        Ok(Self { world_from_base, cloud: Cloud::new(points).map(Arc::new), obstacles, clearance, point_radius })
    }

    /// Pose of the arm's base.
    pub(crate) fn world_from_base(&self) -> &Isometry3<f64> {
        &self.world_from_base
    }

    /// The same surroundings with one more object, the last.
    #[must_use]
    pub(crate) fn with(&self, obstacle: &Arc<Obstacle>, world_from_obstacle: &Isometry3<f64>) -> Self {
        let mut more = self.clone();
        more.obstacles.push((Arc::clone(obstacle), world_from_obstacle.inverse()));
        more
    }

    /// The same surroundings without the points of a region.
    #[must_use]
    pub(crate) fn without_points(&self, region: impl Fn(&Point3<f64>) -> bool) -> Self {
        let points = self.cloud.iter().flat_map(|cloud| &cloud.points).filter(|point| !region(point));
        let cloud = Cloud::new(&points.copied().collect::<Vec<_>>()).map(Arc::new);
        Self { cloud, ..self.clone() }
    }

    /// The objects, each with the world's pose in its frame.
    pub(crate) fn obstacles(&self) -> &[(Arc<Obstacle>, Isometry3<f64>)] {
        &self.obstacles
    }

    /// The objects that are nearer to a sphere than a distance, beyond half of the clearance.
    pub(crate) fn near(&self, (center, radius): (Vector, f64), most: f64) -> Vec<usize> {
        let reach = radius + (most + 0.5 * self.clearance).max(self.clearance) + COVERED;
        let center = Point3::new(center.x, center.y, center.z);
        let is_near = |index: &usize| {
            let (obstacle, from_world) = &self.obstacles[*index];
            obstacle.is_near(&(from_world * center).coords, reach)
        };
        (0..self.obstacles.len()).filter(is_near).collect()
    }

    /// How far a convex shape of the collision library is from everything, beyond half of the distance that it must keep, metres; at most
    /// `most`. Also what it is nearer to than that distance, if anything.
    ///
    /// * `at`: pose of the shape, world frame; `center`, `radius`: a sphere around it.
    /// * `near`: the objects that are looked at.
    /// * `ignored`: what may be touched.
    pub(crate) fn room(
        &self,
        shape: &SharedShape,
        at: &Pose,
        (center, radius): (Vector, f64),
        most: f64,
        near: &[usize],
        ignored: impl Fn(Touched) -> bool,
    ) -> (f64, Option<Touched>) {
        let half = 0.5 * self.clearance;
        let (mut least, mut touched) = (most, None);
        let mut take = |gap: f64, half: f64, what: Touched, least: &mut f64| {
            *least = least.min(gap - half);
            if gap < 2.0 * half && touched.is_none() {
                touched = Some(what);
            }
        };
        if center.z - radius - half < least && !ignored(Touched::Table) {
            let low = shape.as_support_map().map_or(center.z - radius, |map| map.support_point(at, -Vector::Z).z);
            take(low, half, Touched::Table, &mut least);
        }
        if let Some(cloud) = self.cloud.as_ref().filter(|_| !ignored(Touched::Points)) {
            let half = 0.5 * self.point_radius;
            // So far the points are looked for: a shape farther away takes further looks, not more points.
            let gap = cloud.gap(shape, at, (center, radius), (least + half).min(FAR).max(2.0 * half));
            take(gap, half, Touched::Points, &mut least);
        }
        for &index in near {
            let (obstacle, from_world) = &self.obstacles[index];
            let place = from_world * Point3::new(center.x, center.y, center.z);
            let needed = (least + half).max(2.0 * half);
            if obstacle.is_near(&place.coords, radius + needed + COVERED) && !ignored(Touched::Obstacle(index)) {
                let gap = obstacle.gap(shape, &(library(from_world) * *at), needed);
                take(gap, half, Touched::Obstacle(index), &mut least);
            }
        }
        (least, touched)
    }

    /// What a shape touches.
    pub(crate) fn touches(&self, solid: &Solid, base_from_shape: &Isometry3<f64>) -> Option<Touched> {
        let at = self.world_from_base * base_from_shape;
        if at.translation.z - solid.radius < self.clearance
            && at.translation.z - half_height(&solid.shape, &at.rotation) < self.clearance
        {
            return Some(Touched::Table);
        }
        if self.cloud.as_ref().is_some_and(|cloud| cloud.touches(&solid.shape, &at, self.point_radius)) {
            return Some(Touched::Points);
        }
        let hit = self.obstacles.iter().position(|(obstacle, from_world)| {
            let place = from_world * at;
            obstacle.is_near(&place.translation.vector, solid.radius + self.clearance)
                && obstacle.hits(&library_shape(&solid.shape, self.clearance), &library_pose(&place, &solid.shape))
        });
        hit.map(Touched::Obstacle)
    }
}

/// Depth under the table at which a base may still be: the rounding of a measured pose, metres.
const UNDER: f64 = 0.005;

/// Points in a grid.
struct Cloud {
    points: Vec<Point3<f64>>,
    /// Index of the first point of each cell, and the number of points.
    starts: Vec<u32>,
    low: Point3<f64>,
    cell: f64,
    counts: [usize; 3],
}

impl Cloud {
    /// Thins points and sorts them into cells; `None` without points.
    fn new(points: &[Point3<f64>]) -> Option<Self> {
        let first = points.first()?;
        let (low, high) = points.iter().fold((*first, *first), |(low, high), p| (low.inf(p), high.sup(p)));
        let points = thinned(points, &low);
        let mut cell = CELL;
        let counts = loop {
            let counts: [usize; 3] = std::array::from_fn(|axis| ((high[axis] - low[axis]) / cell) as usize + 1);
            if counts.iter().map(|count| *count as f64).product::<f64>() <= MAX_CELLS as f64 {
                break counts;
            }
            cell *= 1.5;
        };
        let mut cloud = Self { points: Vec::new(), starts: Vec::new(), low, cell, counts };
        let mut keyed: Vec<(usize, Point3<f64>)> = points.iter().map(|point| (cloud.key(point), *point)).collect();
        keyed.sort_by_key(|(key, _)| *key);
        cloud.starts = vec![0; counts.iter().product::<usize>() + 1];
        for (key, _) in &keyed {
            cloud.starts[key + 1] += 1;
        }
        for index in 1..cloud.starts.len() {
            cloud.starts[index] += cloud.starts[index - 1];
        }
        cloud.points = keyed.into_iter().map(|(_, point)| point).collect();
        Some(cloud)
    }

    fn index(&self, value: f64, axis: usize) -> usize {
        (((value - self.low[axis]) / self.cell).max(0.0) as usize).min(self.counts[axis] - 1)
    }

    fn key(&self, point: &Point3<f64>) -> usize {
        let [x, y, z] = std::array::from_fn(|axis| self.index(point[axis], axis));
        (x * self.counts[1] + y) * self.counts[2] + z
    }

    /// Distance of a convex shape from the points, or `most` if it is farther, metres.
    ///
    /// * `at`: pose of the shape; `center`, `radius`: a sphere around it.
    fn gap(&self, shape: &SharedShape, at: &Pose, (center, radius): (Vector, f64), most: f64) -> f64 {
        let mut least = most;
        let reach = radius + least;
        let around = shape.compute_aabb(at).loosened(least);
        let center = [center.x, center.y, center.z];
        let (low, high) = (around.mins, around.maxs);
        let bounds = [[low.x, high.x], [low.y, high.y], [low.z, high.z]];
        let mut ranges = [(0, 0); 3];
        for (axis, range) in ranges.iter_mut().enumerate() {
            let (low, high) = (bounds[axis][0].max(center[axis] - reach), bounds[axis][1].min(center[axis] + reach));
            if high < self.low[axis] || low > self.low[axis] + self.cell * self.counts[axis] as f64 {
                return least;
            }
            *range = (self.index(low, axis), self.index(high, axis));
        }
        for x in ranges[0].0..=ranges[0].1 {
            for y in ranges[1].0..=ranges[1].1 {
                let row = (x * self.counts[1] + y) * self.counts[2];
                let (from, to) = (self.starts[row + ranges[2].0] as usize, self.starts[row + ranges[2].1 + 1] as usize);
                for point in &self.points[from..to] {
                    let place = Vector::new(point.x, point.y, point.z);
                    if (Vector::from(center) - place).length() < radius + least {
                        least = least.min(shape.distance_to_point(at, place, true));
                    }
                }
            }
        }
        least
    }

    /// True if a point is within a distance of a shape.
    fn touches(&self, shape: &Shape, at: &Isometry3<f64>, distance: f64) -> bool {
        let half = bounds(shape, &at.rotation).add_scalar(distance);
        let center = at.translation.vector;
        let mut ranges = [(0, 0); 3];
        for (axis, range) in ranges.iter_mut().enumerate() {
            let (low, high) = (center[axis] - half[axis], center[axis] + half[axis]);
            let most = self.low[axis] + self.cell * self.counts[axis] as f64;
            if high < self.low[axis] || low > most {
                return false;
            }
            *range = (self.index(low, axis), self.index(high, axis));
        }
        let turn = *at.rotation.to_rotation_matrix().matrix();
        for x in ranges[0].0..=ranges[0].1 {
            for y in ranges[1].0..=ranges[1].1 {
                let row = (x * self.counts[1] + y) * self.counts[2];
                let (from, to) = (self.starts[row + ranges[2].0] as usize, self.starts[row + ranges[2].1 + 1] as usize);
                let near = |point: &Point3<f64>| is_near(shape, &turn.tr_mul(&(point.coords - center)), distance);
                if self.points[from..to].iter().any(near) {
                    return true;
                }
            }
        }
        false
    }
}

fn bounds(shape: &Shape, rotation: &UnitQuaternion<f64>) -> Vector3<f64> {
    shape.half_extents(rotation)
}

/// The first point of each small voxel, in the order of the points.
fn thinned(points: &[Point3<f64>], low: &Point3<f64>) -> Vec<Point3<f64>> {
    let voxel = |point: &Point3<f64>| [0, 1, 2].map(|axis| ((point[axis] - low[axis]) / THIN) as i64);
    let mut keyed: Vec<([i64; 3], usize)> = points.iter().map(voxel).zip(0..).collect();
    keyed.sort_unstable();
    keyed.dedup_by_key(|(voxel, _)| *voxel);
    let mut kept: Vec<usize> = keyed.into_iter().map(|(_, index)| index).collect();
    kept.sort_unstable();
    kept.into_iter().map(|index| points[index]).collect()
}
