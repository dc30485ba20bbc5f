//! How much room a posture leaves: the least distance between links that may touch, and from the links to table and walls.
//!
//! One distance is true for a neighbourhood: it shrinks by no more than what moves, and that is bounded by the change of each axis times the length
//! beyond it. So a motion in steps measures distances anew only where it comes near something.

use crate::bodies::{ArmBodies, Body, Carried, Solid, frame, half_height, library_pose, library_shape};
use crate::chain::{Chain, Frames, MAX_AXES, Positions};
use graspbox_hand::Shape;
use nalgebra::{Isometry3, Point3, Vector3};
use parry3d_f64::query::distance;
use parry3d_f64::shape::SharedShape;

/// Distances from here on count as this one, metres: more is not needed, and far pairs cost no query.
const FAR: f64 = 0.15;
/// Rounding of distances and bounds, metres.
const ROUNDING: f64 = 1e-6;

/// A box that does not move: half sides and pose in the base's frame.
struct Fixed {
    shape: Shape,
    solid: SharedShape,
    at: Isometry3<f64>,
}

/// What the links of an arm must keep away from.
pub struct Room {
    bodies: ArmBodies,
    hand: Carried,
    world_from_base: Isometry3<f64>,
    walls: Vec<Fixed>,
    /// Greatest distance of anything that an axis moves from it, metres; 1 for a prismatic one.
    levers: Positions,
    count: usize,
}

impl std::fmt::Debug for Room {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Room({} walls)", self.walls.len())
    }
}

/// A posture whose room was measured.
#[derive(Clone, Copy, Debug)]
pub struct Measured {
    positions: Positions,
    room: f64,
}

impl Room {
    /// * `walls`: half sides and poses in the world of boxes that do not move.
    #[must_use]
    pub fn new(
        chain: &Chain,
        bodies: &ArmBodies,
        hand: Carried,
        world_from_base: Isometry3<f64>,
        walls: &[(Vector3<f64>, Isometry3<f64>)],
    ) -> Self {
        let base_from_world = world_from_base.inverse();
        let fixed = |(half, world_from_wall): &(Vector3<f64>, Isometry3<f64>)| {
            let shape = Shape::Cuboid(*half);
            Fixed { shape, solid: library_shape(&shape, 0.0), at: base_from_world * world_from_wall }
        };
        let levers = levers(chain, bodies, &hand);
        let walls = walls.iter().map(fixed).collect();
        Self { bodies: bodies.clone(), hand, world_from_base, walls, levers, count: chain.len() }
    }

    /// The bodies, to name them.
    #[must_use]
    pub fn bodies(&self) -> &ArmBodies {
        &self.bodies
    }

    /// An upper bound of how far anything moves between two postures, metres.
    #[must_use]
    pub fn motion(&self, from: &Positions, to: &Positions) -> f64 {
        (0..self.count).map(|axis| (from[axis] - to[axis]).abs() * self.levers[axis]).sum()
    }

    /// True if a posture leaves at least `least` metres; `last` keeps the last measurement, which changes no answer.
    pub fn leaves(&self, chain: &Chain, positions: &Positions, least: f64, last: &mut Option<Measured>) -> bool {
        if let Some(last) = last.as_ref()
            && last.room - self.motion(&last.positions, positions) - ROUNDING >= least
        {
            return true;
        }
        let room = self.measure(&chain.frames(positions));
        *last = Some(Measured { positions: *positions, room });
        room >= least
    }

    /// The least distance, at most [`FAR`], metres; 0 where something touches.
    #[must_use]
    pub fn measure(&self, frames: &Frames) -> f64 {
        let mut at = [Isometry3::identity(); MAX_AXES + 1];
        let mut centers = [Point3::origin(); MAX_AXES + 1];
        for (body, own) in self.bodies.bodies.iter().enumerate() {
            at[body] = frame(frames, body);
            centers[body] = at[body] * own.center;
        }
        let mut least = FAR;
        for &[a, b] in &self.bodies.pairs {
            let [one, two] = [a, b].map(|body| Posed { body: &self.bodies.bodies[body], at: &at[body] });
            apart(&one, &two, (centers[a] - centers[b]).norm(), &mut least);
        }
        let last = &at[self.bodies.bodies.len() - 1];
        let (hand, center) = (Posed { body: &self.hand.body, at: last }, last * self.hand.body.center);
        for &body in &self.hand.meets {
            let other = Posed { body: &self.bodies.bodies[body], at: &at[body] };
            apart(&hand, &other, (centers[body] - center).norm(), &mut least);
        }
        for (body, own) in self.bodies.bodies.iter().enumerate().skip(1) {
            self.from_surroundings(own, &at[body], &centers[body], &mut least);
        }
        least.max(0.0)
    }

    /// Lowers `least` to the distance of a body from the table and the walls.
    fn from_surroundings(&self, body: &Body, at: &Isometry3<f64>, center: &Point3<f64>, least: &mut f64) {
        let high = (self.world_from_base * center).z - body.radius >= *least;
        let far = |wall: &Fixed| (wall.at.inverse_transform_point(center).coords.abs() - half(&wall.shape)).max();
        for solid in &body.solids {
            let own = at * solid.body_from_shape;
            if !high {
                let world = self.world_from_base * own;
                *least = least.min(world.translation.z - half_height(&solid.shape, &world.rotation));
            }
            for wall in &self.walls {
                if far(wall) - body.radius < *least {
                    *least = least.min(gap((&solid.shape, &solid.solid, &own), (&wall.shape, &wall.solid, &wall.at)));
                }
            }
        }
    }
}

/// A body at its place.
struct Posed<'a> {
    body: &'a Body,
    at: &'a Isometry3<f64>,
}

/// Lowers `least` to the distance of two bodies whose centres are `between` metres apart.
fn apart(one: &Posed<'_>, two: &Posed<'_>, between: f64, least: &mut f64) {
    if between - one.body.radius - two.body.radius >= *least {
        return;
    }
    for a in &one.body.solids {
        let own = one.at * a.body_from_shape;
        for b in &two.body.solids {
            let other = two.at * b.body_from_shape;
            let near = (own.translation.vector - other.translation.vector).norm() - a.radius - b.radius;
            if near < *least {
                *least = least.min(gap((&a.shape, &a.solid, &own), (&b.shape, &b.solid, &other)));
            }
        }
    }
}

type Placed<'a> = (&'a Shape, &'a SharedShape, &'a Isometry3<f64>);

/// Distance of two shapes, metres; 0 where they overlap.
fn gap(a: Placed<'_>, b: Placed<'_>) -> f64 {
    // Unsupported pairs do not occur: all shapes are convex.
    distance(&library_pose(a.2, a.0), &*a.1.0, &library_pose(b.2, b.0), &*b.1.0).map_or(0.0, |found| found.distance)
}

fn half(shape: &Shape) -> Vector3<f64> {
    shape.half_extents(&nalgebra::UnitQuaternion::identity())
}

/// The greatest distances from each axis.
fn levers(chain: &Chain, bodies: &ArmBodies, hand: &Carried) -> Positions {
    let size = |solids: &[Solid]| {
        solids.iter().map(|solid| solid.body_from_shape.translation.vector.norm() + solid.radius).fold(0.0, f64::max)
    };
    let mut levers = [0.0; MAX_AXES];
    let mut beyond = size(&hand.body.solids);
    for axis in (0..chain.len()).rev() {
        beyond = beyond.max(size(&bodies.bodies[axis + 1].solids));
        levers[axis] = if chain.is_revolute(axis) { beyond } else { 1.0 };
        let [lower, upper] = chain.limits(axis);
        let travel = if chain.is_revolute(axis) { 0.0 } else { lower.abs().max(upper.abs()) };
        beyond += chain.before(axis).shift.norm() + travel;
    }
    levers
}
