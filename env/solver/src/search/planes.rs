//! Contact candidates with the scenery: corners over the planes of table and ground, and boxes, which are walls and the table near its edges.

use nalgebra::{Isometry3, Point3, Vector3};
use parry3d::shape::{Cuboid, Shape};
use std::f64::consts::FRAC_1_SQRT_2;

use super::manifold::chosen;
use super::{Candidate, Opposite, Searcher, Situation, world_center};
use crate::dispatch::Dispatcher;
use crate::model::{BodyIndex, BodyKind, Corners, Model};
use crate::scenery::{Plane, Surface, Wall};
use crate::units;

/// Directions in the plane along which the farthest corners are kept: every 45 degrees.
const DIRECTIONS: [[f64; 2]; 8] = [
    [1.0, 0.0],
    [FRAC_1_SQRT_2, FRAC_1_SQRT_2],
    [0.0, 1.0],
    [-FRAC_1_SQRT_2, FRAC_1_SQRT_2],
    [-1.0, 0.0],
    [-FRAC_1_SQRT_2, -FRAC_1_SQRT_2],
    [0.0, -1.0],
    [FRAC_1_SQRT_2, -FRAC_1_SQRT_2],
];

/// Shapes with at most this many corners (a box) keep all of them.
const FEW: usize = 8;

/// Weight of height against distance along a direction, dimensionless: 1 mm higher counts as 30 mm less far out, so a corner is kept only if it
/// is nearly as low as the lowest.
const HEIGHT_WEIGHT: f64 = 30.0;

/// A plane in the frame of a body.
struct Local {
    x: Vector3<f64>,
    y: Vector3<f64>,
    up: Vector3<f64>,
    /// Height of the body's origin.
    gap: f64,
    at: [f64; 2],
    half: f64,
    /// Corners below this height are under the table, not in it, metres.
    deepest: f64,
}

impl Local {
    fn new(plane: &Plane, pose: &Isometry3<f64>, deepest: f64) -> Self {
        let local = |v: &Vector3<f64>| pose.rotation.inverse_transform_vector(v);
        let origin = &pose.translation.vector;
        Self {
            x: local(&plane.x),
            y: local(&plane.y),
            up: local(&plane.up),
            gap: plane.gap(origin),
            at: [plane.x.dot(origin) - plane.middle[0], plane.y.dot(origin) - plane.middle[1]],
            half: plane.half,
            deepest,
        }
    }

    /// Height of a corner.
    #[inline]
    fn height(&self, p: &Vector3<f64>) -> f64 {
        self.up.dot(p) + self.gap
    }

    /// True if a corner at height `z` is over the surface, and not under the table.
    #[inline]
    fn over(&self, p: &Vector3<f64>, z: f64) -> bool {
        z > self.deepest
            && (self.x.dot(p) + self.at[0]).abs() < self.half
            && (self.y.dot(p) + self.at[1]).abs() < self.half
    }
}

impl Searcher {
    /// Collects the candidates of a pair. Returns a lower bound of the distance of all other points of the body to both surfaces, metres.
    pub(super) fn over_scenery(&mut self, model: &Model, now: &Situation, pair: usize) -> f64 {
        let body = model.pairs[pair].a;
        let edge = over_edge(model, now, body);
        let margin = self.pairs[pair].margin;
        let mut clearance = self.walls(model, now, pair);
        for (plane, surface) in now.planes.iter().zip([Surface::Table, Surface::Ground]) {
            if surface == Surface::Table && edge {
                self.table_as_box(model, now, pair);
                clearance = clearance.min(margin);
                continue;
            }
            let above = plane.gap(&now.moving[body].center) - model.radius[body];
            if above > margin {
                clearance = clearance.min(above);
                continue;
            }
            let local = Local::new(plane, &now.poses[body], -model.scenery.table_thickness / 2.0);
            for corners in &model.corners[body] {
                let friction = corners.friction * model.scenery.friction;
                let candidates = &mut self.pairs[pair].candidates;
                let least = extremes(corners, &local, margin, |p| {
                    candidates.push(Candidate {
                        on_a: p - local.up * corners.radius,
                        opposite: Opposite::Plane(surface),
                        friction,
                        shapes: [corners.shape, None],
                    });
                });
                clearance = clearance.min(least);
            }
        }
        clearance
    }

    /// The table as a box: its edges support bodies that have no corner over the table.
    fn table_as_box(&mut self, model: &Model, now: &Situation, pair: usize) {
        let (side, thick) = (model.scenery.table_side / 2.0, model.scenery.table_thickness / 2.0);
        let table =
            Wall { world_from_wall: Isometry3::translation(0.0, 0.0, -thick), half: Vector3::new(side, side, thick) };
        self.body_and_box(model, now, pair, &table, None);
    }

    /// Walls within the margin. Returns a lower bound of the distance of the others, or the margin if there are none nearer, metres.
    fn walls(&mut self, model: &Model, now: &Situation, pair: usize) -> f64 {
        let mut clearance = f64::INFINITY;
        if model.scenery.walls.is_empty() {
            return clearance;
        }
        let body = model.pairs[pair].a;
        let margin = self.pairs[pair].margin;
        let center = world_center(model, now, body);
        for (index, wall) in model.scenery.walls.iter().enumerate() {
            let apart = wall.distance(&center) - model.radius[body];
            clearance = clearance.min(apart.max(margin));
            if apart <= margin {
                self.body_and_box(model, now, pair, wall, Some(index as u16));
            }
        }
        clearance
    }

    /// The shapes of a body against a box of the scenery; `index` is that of a wall.
    fn body_and_box(&mut self, model: &Model, now: &Situation, pair: usize, wall: &Wall, index: Option<u16>) {
        let body = model.pairs[pair].a;
        let solid = Cuboid::new(units::lengths(&wall.half));
        let base_from_box = now.poses[model.scenery_body()] * wall.world_from_wall;
        let box_from_body = base_from_box.inv_mul(&now.poses[body]);
        let reach = units::length(self.pairs[pair].margin);
        let one = |this: &mut Self, shape: &dyn Shape, body_from_shape: &Isometry3<f64>, friction, own| {
            let place = units::pose(&(box_from_body * body_from_shape).inverse());
            if !this.contact(Dispatcher::default(), &place, shape, &solid, parry3d::math::Vector::ZERO, reach) {
                return;
            }
            let (kept, count) = chosen(&this.manifold, reach);
            let normal = body_from_shape.rotation * units::direction(this.manifold.local_n1);
            for point in kept[..count].iter().map(|i| &this.manifold.points[*i]) {
                let on_a = (body_from_shape * Point3::from(units::metres64(point.local_p1))).coords;
                let on_b = (wall.world_from_wall * Point3::from(units::metres64(point.local_p2))).coords;
                let opposite = Opposite::Point { on_b, normal };
                let friction = friction * model.scenery.friction;
                this.pairs[pair].candidates.push(Candidate { on_a, opposite, friction, shapes: [own, index] });
            }
        };
        match model.kind(body) {
            BodyKind::Object(index) => {
                let object = &model.objects[index];
                for part in &object.parts {
                    one(self, &*part.shape, &part.object_from_part, object.own.friction, None);
                }
            }
            BodyKind::Hand(index) => {
                for index in model.shapes_of[index].clone() {
                    let shape = &model.shapes[index];
                    one(self, &*shape.shape, &shape.body_from_shape, shape.friction, Some(index as u16));
                }
            }
            BodyKind::Scenery => {}
        }
    }
}

/// True if an edge of the table may be within the body's bounding sphere.
fn over_edge(model: &Model, now: &Situation, body: BodyIndex) -> bool {
    let table = &now.planes[0];
    let (center, radius) = (&now.moving[body].center, model.radius[body]);
    let outside = |axis: &Vector3<f64>, middle: f64| (axis.dot(center) - middle).abs() - table.half;
    let out = outside(&table.x, table.middle[0]).max(outside(&table.y, table.middle[1]));
    let below = -table.gap(center) - model.scenery.table_thickness;
    out.abs() < radius && below < radius
}

/// Visits the corners that may touch the plane: all of a shape with few corners; else the lowest, and the farthest in eight directions.
/// Returns the height of the lowest corner, including corners off the surface.
fn extremes(corners: &Corners, plane: &Local, margin: f64, mut push: impl FnMut(&Vector3<f64>)) -> f64 {
    let highest = margin + corners.radius;
    let mut least = f64::INFINITY;
    if corners.points.len() <= FEW {
        for p in &corners.points {
            let z = plane.height(p);
            if z < least {
                least = z;
            }
            if z <= highest && plane.over(p, z) {
                push(p);
            }
        }
        return least - corners.radius;
    }
    let mut lowest = (f64::MAX, usize::MAX);
    let mut farthest = [(f64::MIN, usize::MAX); 8];
    for (index, p) in corners.points.iter().enumerate() {
        let z = plane.height(p);
        // `f64::min` would also ask for NaN, in the loop that costs most of a search.
        if z < least {
            least = z;
        }
        if z > highest || !plane.over(p, z) {
            continue;
        }
        if z < lowest.0 {
            lowest = (z, index);
        }
        let (x, y) = (plane.x.dot(p), plane.y.dot(p));
        for (direction, best) in DIRECTIONS.iter().zip(&mut farthest) {
            let value = direction[0] * x + direction[1] * y - HEIGHT_WEIGHT * z;
            if value > best.0 {
                *best = (value, index);
            }
        }
    }
    let mut chosen = [usize::MAX; 9];
    let mut count = 0;
    for index in std::iter::once(lowest.1).chain(farthest.iter().map(|b| b.1)) {
        if index != usize::MAX && !chosen[..count].contains(&index) {
            chosen[count] = index;
            count += 1;
            push(&corners.points[index]);
        }
    }
    least - corners.radius
}
