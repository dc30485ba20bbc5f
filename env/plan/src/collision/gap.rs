//! Distances between a convex shape and an object, for motions: a motion that is shorter than the distance meets nothing.
//!
//! The object is its convex parts, and those triangles of its surface that they do not cover: most often none.

use super::{COVERED, Obstacle};
use crate::open_hand::{convex, vector};
use nalgebra::Point3;
use parry3d_f64::bounding_volume::{Aabb, BoundingVolume};
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::query;
use parry3d_f64::query::gjk::{self, CsoPoint, GJKResult, VoronoiSimplex};
use parry3d_f64::shape::{SharedShape, SupportMap, TriMesh as Triangles};

/// Rounding of the corners of a hull, metres.
const ROUNDING: f64 = 1e-9;
/// Most triangles into which a triangle of the surface is cut; what remains then is not covered.
const MOST_TRIANGLES: usize = 2_000;

/// An object for distances.
pub(super) struct Solids {
    parts: Vec<(SharedShape, Aabb)>,
    rest: Option<(Triangles, Aabb)>,
    /// Distance by which the surface may be outside of the parts, metres.
    slack: f64,
}

/// A convex part, and the half-spaces whose intersection it is.
struct Part<'a> {
    shape: &'a SharedShape,
    bounds: Aabb,
    planes: Vec<(Vector, f64)>,
}

impl<'a> Part<'a> {
    fn new(shape: &'a SharedShape) -> Self {
        let planes = shape.as_convex_polyhedron().map_or_else(Vec::new, |hull| {
            let plane = hull.faces().iter().map(|face| {
                let corner = hull.points()[hull.vertices_adj_to_face()[face.first_vertex_or_edge as usize] as usize];
                (face.normal, face.normal.dot(corner))
            });
            plane.collect()
        });
        Self { shape, bounds: shape.compute_local_aabb(), planes }
    }

    /// Distance of a point, infinite beyond [`COVERED`], metres.
    fn distance(&self, point: &Vector) -> f64 {
        let out = self.planes.iter().map(|(normal, offset)| normal.dot(*point) - offset);
        match out.fold(f64::NEG_INFINITY, f64::max) {
            out if out.is_infinite() || out > COVERED => f64::INFINITY,
            out if out <= 0.0 => 0.0,
            _ => self.shape.distance_to_local_point(*point, true),
        }
    }
}

impl Solids {
    fn new(obstacle: &Obstacle) -> Self {
        let mesh = &obstacle.mesh;
        let mut parts = obstacle.parts.clone();
        if parts.is_empty() {
            // A mesh that is its own hull, such as a wall, is its own part.
            parts.extend(convex(mesh).map(|hull| (hull.clone(), hull.compute_local_aabb())));
            let is_own = |hull: &Part<'_>| mesh.vertices().iter().all(|p| hull.distance(&vector(&p.coords)) < ROUNDING);
            if parts.first().is_some_and(|(hull, _)| is_own(&Part::new(hull))) {
                return Self { parts, rest: None, slack: 0.0 };
            }
            parts.clear();
        }
        let all: Vec<Part<'_>> = parts.iter().map(|(part, _)| Part::new(part)).collect();
        let vertices: Vec<Vector> = mesh.vertices().iter().map(|p| vector(&p.coords)).collect();
        let corners = |face: &[u32; 3]| face.map(|corner| vertices[corner as usize]);
        let faces: Vec<[u32; 3]> =
            mesh.faces().iter().filter(|face| !is_covered(corners(face), &all)).copied().collect();
        let rest = (!faces.is_empty()).then(|| Triangles::new(vertices, faces).ok()).flatten();
        let rest = rest.map(|triangles| {
            let bounds = triangles.local_aabb();
            (triangles, bounds)
        });
        Self { parts, rest, slack: COVERED }
    }
}

/// True if no point of a triangle is farther than [`COVERED`] from the parts.
fn is_covered(triangle: [Vector; 3], parts: &[Part<'_>]) -> bool {
    let around = Aabb::from_points(triangle).loosened(COVERED);
    let near: Vec<&Part<'_>> = parts.iter().filter(|part| part.bounds.intersects(&around)).collect();
    let mut open = vec![triangle];
    for _ in 0..MOST_TRIANGLES {
        let Some([a, b, c]) = open.pop() else { return true };
        // Distances of the corners from each part. The distance from a convex part is greatest at a corner.
        let distances = near.iter().map(|part| [a, b, c].map(|corner| part.distance(&corner)));
        let (mut nearest, mut by_one) = ([f64::INFINITY; 3], false);
        for own in distances {
            by_one |= own.iter().all(|distance| *distance <= COVERED);
            nearest = [0, 1, 2].map(|corner| own[corner].min(nearest[corner]));
        }
        let farthest = nearest.into_iter().fold(0.0, f64::max);
        if farthest > COVERED {
            return false;
        }
        let sides = [(a - b).length(), (b - c).length(), (c - a).length()];
        let longest = sides.into_iter().fold(0.0, f64::max);
        // The farthest point from all three corners is as far from them as the longest side / sqrt 3 at most.
        if by_one || farthest + longest / 3.0_f64.sqrt() <= COVERED {
            continue;
        }
        let [a, b, c] = match sides.iter().position(|side| *side == longest) {
            Some(0) => [a, b, c],
            Some(1) => [b, c, a],
            _ => [c, a, b],
        };
        let middle = 0.5 * (a + b);
        open.extend([[a, middle, c], [middle, b, c]]);
    }
    open.is_empty()
}

impl Obstacle {
    fn solids(&self) -> &Solids {
        self.solids.get_or_init(|| Solids::new(self))
    }

    /// The object's convex parts, object frame; a mesh that is convex itself is its own part. Empty for any other without parts.
    pub fn convex_parts(&self) -> impl Iterator<Item = &SharedShape> {
        self.solids().parts.iter().map(|(part, _)| part)
    }

    /// Distance of a point in the object's frame, or `most` if it is farther, metres: as [`Obstacle::gap`].
    pub fn distance(&self, point: &Point3<f64>, most: f64) -> f64 {
        /// Radius of a ball that stands for a point, metres.
        const POINT: f64 = 1e-6;
        self.gap(&SharedShape::ball(POINT), &Pose::from_translation(vector(&point.coords)), most)
    }

    /// Distance of a convex shape of the collision library at `place` in the object's frame, or `most` if it is farther, metres.
    ///
    /// It is a lower bound, at most [`COVERED`] too small; 0 where they touch.
    pub fn gap(&self, shape: &SharedShape, place: &Pose, most: f64) -> f64 {
        let solids = self.solids();
        let around = shape.compute_aabb(place);
        let far = |bounds: &Aabb, least: f64| apart(&around, bounds) - solids.slack >= least;
        let mut least = most;
        if far(&self.bounds, least) {
            return least;
        }
        for (part, bounds) in &solids.parts {
            if !far(bounds, least) {
                least = least.min(distance_within(place, part, shape, least + solids.slack) - solids.slack);
            }
        }
        if let Some((rest, bounds)) = &solids.rest
            && !far(bounds, least)
        {
            least = distance_of_triangles(place, rest, shape, &around, least);
        }
        if solids.parts.is_empty() && self.is_inside(place.translation) {
            return 0.0;
        }
        least.max(0.0)
    }

    /// How deep a convex shape of the collision library at `place` in the object's frame is in the object's parts, metres; 0 outside.
    pub fn depth(&self, shape: &SharedShape, place: &Pose) -> f64 {
        let depth = |(part, _): &(SharedShape, Aabb)| {
            let found = query::contact(place, &*shape.0, &Pose::IDENTITY, &*part.0, 0.0).ok().flatten();
            found.map_or(0.0, |contact| -contact.dist)
        };
        self.solids().parts.iter().map(depth).fold(0.0, f64::max)
    }
}

/// Distance of a convex shape at `place` from triangles, or `most` if it is greater, metres.
///
/// * `around`: bounds of the shape at its place.
fn distance_of_triangles(place: &Pose, triangles: &Triangles, shape: &SharedShape, around: &Aabb, most: f64) -> f64 {
    let exact = || query::distance(place, &*shape.0, &Pose::IDENTITY, triangles).map_or(0.0, |found| found.distance);
    let Some(map) = shape.as_support_map() else { return exact().min(most) };
    let of_face = |face: u32, most: f64| {
        let triangle = triangles.triangle(face);
        let whole =
            || query::distance(&Pose::IDENTITY, &triangle, place, &*shape.0).map_or(0.0, |found| found.distance);
        Some(bounded(place, &triangle, map, most).unwrap_or_else(whole))
    };
    let nearest = triangles.bvh().find_best(most, |node, _| apart(around, &node.aabb()), of_face);
    nearest.map_or(most, |(_, distance)| distance.min(most))
}

/// Distance of two convex shapes, or `most` if it is greater, metres; 0 where they touch.
///
/// * `place`: pose of the second shape in the frame of the first.
///
/// With a bound the search for the distance most often ends after a few directions.
pub fn distance_within(place: &Pose, first: &SharedShape, second: &SharedShape, most: f64) -> f64 {
    let exact = || query::distance(&Pose::IDENTITY, &*first.0, place, &*second.0).map_or(0.0, |found| found.distance);
    let (Some(one), Some(two)) = (first.as_support_map(), second.as_support_map()) else { return exact().min(most) };
    bounded(place, one, two, most).unwrap_or_else(|| exact().min(most))
}

/// The same; `None` where the search does not converge.
fn bounded(place: &Pose, one: &dyn SupportMap, two: &dyn SupportMap, most: f64) -> Option<f64> {
    let toward = |direction: Vector| CsoPoint::from_shapes(place, one, two, direction);
    // Along a direction the shapes are at least so far apart.
    let bound = |direction: Vector, point: &CsoPoint| -direction.dot(point.point);
    let length = place.translation.length();
    let direction = if length > f64::EPSILON { -place.translation / length } else { Vector::X };
    let point = toward(direction);
    if bound(direction, &point) >= most {
        return Some(most);
    }
    let mut simplex = VoronoiSimplex::new();
    simplex.reset(point);
    match gjk::closest_points(place, one, two, most, true, &mut simplex) {
        GJKResult::Intersection => Some(0.0),
        GJKResult::ClosestPoints(a, b, _) => Some((a - b).length().min(most)),
        GJKResult::NoIntersection(direction) if bound(direction, &toward(direction)) >= most => Some(most),
        GJKResult::NoIntersection(_) | GJKResult::Proximity(_) => None,
    }
}

/// Distance between two boxes, metres.
fn apart(a: &Aabb, b: &Aabb) -> f64 {
    (a.mins - b.maxs).max(b.mins - a.maxs).max(Vector::ZERO).length()
}

#[cfg(test)]
mod tests {
    use super::*;
    use graspbox_mesh::{TriMesh, convex_hull};
    use nalgebra::{Point3, Vector3};

    fn brick(low: [f64; 3], high: [f64; 3]) -> TriMesh {
        let corner = |i: usize| Point3::from(Vector3::from_fn(|axis, _| [low, high][i >> axis & 1][axis]));
        convex_hull(&(0..8).map(corner).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn distances_are_those_of_boxes() {
        let wall = Obstacle::cuboid(&Vector3::new(0.1, 0.2, 0.3)).unwrap();
        let ball = SharedShape::ball(0.05);
        let at = |x: f64, y: f64| wall.gap(&ball, &Pose::from_translation(Vector::new(x, y, 0.0)), 1.0);
        assert!((at(0.25, 0.0) - 0.1).abs() < 1e-9);
        // Round shapes are searched to some nanometres.
        assert!((at(0.4, 0.6) - (0.5 - 0.05)).abs() < 1e-7);
        assert_eq!(at(0.0, 0.0), 0.0, "inside is no distance");
        assert_eq!(at(5.0, 0.0), 1.0);
    }

    /// A brick whose parts are its two halves: the triangles across their border are covered by both together.
    #[test]
    fn parts_cover_the_surface_that_they_share() {
        let whole = brick([-0.1, -0.02, 0.0], [0.1, 0.02, 0.05]);
        let halves = [brick([-0.1, -0.02, 0.0], [0.0, 0.02, 0.05]), brick([0.0, -0.02, 0.0], [0.1, 0.02, 0.05])];
        assert!(Obstacle::new(&whole, &halves).unwrap().solids().rest.is_none());
        // Without the second half its surface is left, and still met.
        let part = Obstacle::new(&whole, &halves[..1]).unwrap();
        assert!(part.solids().rest.is_some());
        let ball = SharedShape::ball(0.01);
        let gap = part.gap(&ball, &Pose::from_translation(Vector::new(0.13, 0.0, 0.025)), 1.0);
        assert!((gap - 0.02).abs() < 2e-3, "{gap}");
        assert!((part.depth(&ball, &Pose::from_translation(Vector::new(-0.105, 0.0, 0.025))) - 0.005).abs() < 1e-6);
    }
}
