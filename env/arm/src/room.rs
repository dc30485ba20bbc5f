//! How much room a posture leaves: the distances between links that may touch, and from the links to table and walls.
//!
//! One distance is true for a neighbourhood: it shrinks by no more than what moves, and that is bounded by the change of each axis between the two
//! bodies times the length beyond it. So a motion measures a distance anew only where the two come near each other ([`way`]). And two shapes are most
//! often still apart along the direction in which they were nearest: that costs no query.

pub mod way;

use crate::bodies::{ArmBodies, Body, Carried, Solid, frame, half_extent, half_height, library_pose, library_shape};
use crate::chain::{Chain, Frames, MAX_AXES, Positions};
use graspbox_hand::Shape;
use nalgebra::{Isometry3, Vector3};
use parry3d_f64::query::details::closest_points_support_map_support_map_with_params as closest_points;
use parry3d_f64::query::gjk::{GJKResult, VoronoiSimplex};
use parry3d_f64::shape::SharedShape;
use std::ops::Range;

/// Greatest distance, metres: that of what no obstacle is near.
const FAR: f64 = 1.0;
/// From here on the distance of the spheres about two things, which is less than theirs, is enough, metres: it costs no query.
const ENOUGH: f64 = 0.03;
/// Most axes of a meeting of which it is tried to prove that the two never meet.
const FEW: usize = 2;
/// Postures that are measured to prove that two things never meet.
const PROOF: usize = 4000;
/// Distance that is kept by what never meets, metres: more than is ever asked for.
const NEVER: f64 = 0.011;
/// A distance along a known direction is enough from this share of the distance there on.
const NEARLY: f64 = 0.7;
/// Rounding of distances and bounds, metres.
const ROUNDING: f64 = 1e-6;

/// A box that does not move: half sides and pose in the base's frame.
struct Fixed {
    shape: Shape,
    solid: SharedShape,
    at: Isometry3<f64>,
}

/// Shapes that move together: a body, the hand, or one shape of them.
struct Part {
    /// The body in whose frame they are.
    carrier: usize,
    body: Body,
}

/// A part that must not touch another one, or its surroundings.
struct Meeting {
    moving: usize,
    /// What is nearer to the base; `None` for table and walls.
    other: Option<usize>,
    /// Axes that move one against the other.
    axes: Range<usize>,
    /// How far at most per change of each axis, metres.
    levers: Positions,
}

/// What the links of an arm must keep away from.
pub struct Room {
    world_from_base: Isometry3<f64>,
    walls: Vec<Fixed>,
    /// The bodies, the hand, and single shapes of them.
    parts: Vec<Part>,
    meetings: Vec<Meeting>,
    /// How far anything can move against the base per change of each axis, metres.
    most: Positions,
    count: usize,
}

impl std::fmt::Debug for Room {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Room({} meetings, {} walls)", self.meetings.len(), self.walls.len())
    }
}

/// Two shapes as they were measured.
#[derive(Clone, Copy, Debug)]
struct Pair {
    /// From one to the other where they were nearest, of length 1, in the frame of the first body.
    direction: Vector3<f64>,
    /// Metres; infinite before the first measurement.
    distance: f64,
}

impl Default for Pair {
    fn default() -> Self {
        Self { direction: Vector3::zeros(), distance: f64::INFINITY }
    }
}

/// The pairs of shapes of two bodies, the distance that is asked for, and the one that more of adds nothing to, metres.
struct Asked<'a> {
    pairs: &'a mut Vec<Pair>,
    least: f64,
    enough: f64,
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
        let last = bodies.count() - 1;
        let mut most = levers_of_all(chain, bodies, &hand);
        most[chain.len()..].fill(0.0);
        let own = bodies.bodies.iter().enumerate().map(|(carrier, body)| Part { carrier, body: body.clone() });
        let parts = own.chain([Part { carrier: last, body: hand.body }]).collect();
        let walls = walls.iter().map(fixed).collect();
        let mut room = Self { world_from_base, walls, parts, meetings: Vec::new(), most, count: chain.len() };
        let pairs =
            bodies.pairs.iter().map(|&[a, b]| (Some(a), b)).chain(hand.meets.iter().map(|a| (Some(*a), last + 1)));
        let surroundings = (1..=last).filter(|body| !bodies.bodies[*body].solids.is_empty()).map(|body| (None, body));
        for (other, moving) in pairs.chain(surroundings) {
            room.add(chain, other, moving);
        }
        room
    }

    /// Adds a meeting. On few axes it is divided into those of single shapes, most of which never meet.
    fn add(&mut self, chain: &Chain, other: Option<usize>, moving: usize) {
        let from = other.map_or(0, |other| self.parts[other].carrier);
        let axes = from..self.parts[moving].carrier;
        let Some(other) = other.filter(|_| axes.len() <= FEW) else { return self.add_one(chain, other, moving) };
        let [shapes, others] = [moving, other].map(|part| self.shapes(part));
        for moving in shapes {
            others.clone().for_each(|other| self.add_one(chain, Some(other), moving));
        }
    }

    /// Makes parts of the single shapes of a part.
    fn shapes(&mut self, part: usize) -> Range<usize> {
        let (first, Part { carrier, body }) = (self.parts.len(), &self.parts[part]);
        let one = |solid: &Solid| Part { carrier: *carrier, body: Body::new(vec![solid.clone()]) };
        let shapes: Vec<Part> = body.solids.iter().map(one).collect();
        self.parts.extend(shapes);
        first..self.parts.len()
    }

    /// Adds a meeting, unless the two never meet.
    fn add_one(&mut self, chain: &Chain, other: Option<usize>, moving: usize) {
        let fixed = other.map(|other| &self.parts[other]);
        let axes = fixed.map_or(0, |fixed| fixed.carrier)..self.parts[moving].carrier;
        let levers = levers(chain, &axes, fixed.map(|fixed| &*fixed.body.solids), &self.parts[moving].body.solids);
        let meeting = Meeting { moving, other, axes, levers };
        if !self.never_meet(chain, &meeting) {
            self.meetings.push(meeting);
        }
    }

    /// True if all postures within the limits leave [`NEVER`], for a meeting on which few axes have an influence.
    ///
    /// Divides the ranges of the axes until each part is proven by the distance at its middle, which is true for a neighbourhood.
    fn never_meet(&self, chain: &Chain, meeting: &Meeting) -> bool {
        let axes: Vec<usize> = meeting.axes.clone().filter(|axis| meeting.levers[*axis] > 0.0).collect();
        if axes.len() > FEW {
            return false;
        }
        let mut parts = vec![axes.iter().map(|axis| chain.limits(*axis)).collect::<Vec<_>>()];
        for _ in 0..PROOF {
            let Some(part) = parts.pop() else { return true };
            let mut middle = [0.0; MAX_AXES];
            axes.iter().zip(&part).for_each(|(axis, [low, high])| middle[*axis] = 0.5 * (low + high));
            let moved = |at: usize| 0.5 * (part[at][1] - part[at][0]) * meeting.levers[axes[at]];
            let room = self.distance(meeting, &chain.frames(&middle), None);
            if room < NEVER {
                return false;
            }
            if room - (0..axes.len()).map(moved).sum::<f64>() >= NEVER {
                continue;
            }
            let widest = (0..axes.len()).max_by(|a, b| moved(*a).total_cmp(&moved(*b))).unwrap_or(0);
            let [low, high] = part[widest];
            for half in [[low, middle[axes[widest]]], [middle[axes[widest]], high]] {
                let mut smaller = part.clone();
                smaller[widest] = half;
                parts.push(smaller);
            }
        }
        false
    }

    /// An upper bound of how far anything moves between two postures, metres.
    #[must_use]
    pub fn motion(&self, from: &Positions, to: &Positions) -> f64 {
        (0..self.count).map(|axis| (from[axis] - to[axis]).abs() * self.most[axis]).sum()
    }

    /// Distance of a meeting, metres, or less than it beyond [`ENOUGH`] or what is asked for; 0 where they touch.
    fn distance(&self, meeting: &Meeting, frames: &Frames, asked: Option<Asked<'_>>) -> f64 {
        let mut least = FAR;
        let place = |part: &Part| frame(frames, part.carrier);
        let moving = &self.parts[meeting.moving];
        let at = place(moving);
        if let Some(other) = meeting.other.map(|other| &self.parts[other]) {
            let theirs = place(other);
            let moving = Posed { body: &moving.body, at: &at };
            apart(&Posed { body: &other.body, at: &theirs }, &moving, &mut least, asked);
        } else {
            let enough = asked.map_or(ENOUGH, |asked| asked.enough);
            self.near_surroundings(&moving.body, &at, enough, &mut least);
        }
        least.max(0.0)
    }

    /// The least distance, metres, or less than it beyond `ENOUGH`; 0 where something touches.
    #[must_use]
    pub fn measure(&self, frames: &Frames) -> f64 {
        self.meetings.iter().map(|meeting| self.distance(meeting, frames, None)).fold(FAR, f64::min)
    }

    /// Lowers `least` to the distance of a body from the table and the walls.
    fn near_surroundings(&self, body: &Body, at: &Isometry3<f64>, enough: f64, least: &mut f64) {
        let center = &(at * body.center);
        let height = (self.world_from_base * center).z - body.radius;
        let far = |wall: &Fixed| {
            (wall.at.inverse_transform_point(center).coords.abs() - half(&wall.shape)).max() - body.radius
        };
        let nearest = self.walls.iter().map(far).fold(f64::INFINITY, f64::min);
        if height.min(nearest) >= enough {
            *least = least.min(height.min(nearest));
            return;
        }
        for solid in &body.solids {
            let own = at * solid.body_from_shape;
            if height < enough {
                let world = self.world_from_base * own;
                *least = least.min(world.translation.z - half_height(&solid.shape, &world.rotation));
            }
            for wall in self.walls.iter().filter(|wall| far(wall) < enough) {
                *least = least.min(gap((&solid.shape, &solid.solid, &own), (&wall.shape, &wall.solid, &wall.at)).0);
            }
        }
        // What is not near, but not nothing.
        for beyond in [height, nearest].into_iter().filter(|beyond| *beyond >= enough) {
            *least = least.min(beyond);
        }
    }
}

/// A body at its place.
struct Posed<'a> {
    body: &'a Body,
    at: &'a Isometry3<f64>,
}

/// Lowers `least` to the distance of two bodies.
fn apart(one: &Posed<'_>, two: &Posed<'_>, least: &mut f64, mut asked: Option<Asked<'_>>) {
    let between = (one.at * one.body.center - two.at * two.body.center).norm();
    let beyond = between - one.body.radius - two.body.radius;
    let enough = asked.as_ref().map_or(ENOUGH, |asked| asked.enough);
    if beyond >= enough {
        *least = least.min(beyond);
        return;
    }
    let (rows, columns) = (one.body.solids.len(), two.body.solids.len());
    if let Some(asked) = &mut asked {
        asked.pairs.resize(rows * columns, Pair::default());
    }
    for (row, a) in one.body.solids.iter().enumerate() {
        let own = one.at * a.body_from_shape;
        for (column, b) in two.body.solids.iter().enumerate() {
            let other = two.at * b.body_from_shape;
            let between = other.translation.vector - own.translation.vector;
            let near = between.norm() - a.radius - b.radius;
            if near >= enough {
                *least = least.min(near);
                continue;
            }
            if near >= *least {
                continue;
            }
            let pair = asked.as_mut().map(|asked| (&mut asked.pairs[row * columns + column], asked.least));
            if let Some((pair, wanted)) = &pair {
                let along = one.at.rotation * pair.direction;
                let [a, b] = [(&a.shape, &own), (&b.shape, &other)].map(|(s, at)| half_extent(s, &at.rotation, &along));
                let apart = along.dot(&between) - a - b;
                let is_known = apart >= NEARLY * pair.distance && apart - ROUNDING >= *wanted;
                if is_known || apart >= enough {
                    *least = least.min(apart);
                    continue;
                }
            }
            let (distance, direction) = gap((&a.shape, &a.solid, &own), (&b.shape, &b.solid, &other));
            if let Some((pair, _)) = pair {
                *pair = Pair { direction: one.at.rotation.inverse() * direction, distance };
            }
            *least = least.min(distance);
        }
    }
}

type Placed<'a> = (&'a Shape, &'a SharedShape, &'a Isometry3<f64>);

/// Distance of two shapes, metres, 0 where they overlap; and the direction, of length 1, from one to the other where they are nearest.
///
/// By supporting points for all pairs: the library's own query of two boxes jumps where the nearest features change.
fn gap(a: Placed<'_>, b: Placed<'_>) -> (f64, Vector3<f64>) {
    let (from, to) = (library_pose(a.2, a.0), library_pose(b.2, b.0));
    // All shapes are convex.
    let (Some(one), Some(two)) = (a.1.as_support_map(), b.1.as_support_map()) else { return (0.0, Vector3::zeros()) };
    let found = closest_points(&from.inv_mul(&to), one, two, f64::MAX, &mut VoronoiSimplex::new(), None);
    let GJKResult::ClosestPoints(first, second, _) = found else { return (0.0, Vector3::zeros()) };
    let way = from.rotation * (second - first);
    let way = Vector3::new(way.x, way.y, way.z);
    let distance = (first - second).length();
    (distance, way.try_normalize(0.0).unwrap_or_default())
}

fn half(shape: &Shape) -> Vector3<f64> {
    shape.half_extents(&nalgebra::UnitQuaternion::identity())
}

/// The greatest distance of a point of the shapes from their frame.
fn size(solids: &[Solid]) -> f64 {
    solids.iter().map(|solid| solid.body_from_shape.translation.vector.norm() + solid.radius).fold(0.0, f64::max)
}

/// How far shapes can move against those before the first of some axes per change of each of these, metres; 1 for a prismatic one.
///
/// * `fixed`: the latter; `None` if they may be anywhere.
fn levers(chain: &Chain, axes: &Range<usize>, fixed: Option<&[Solid]>, solids: &[Solid]) -> Positions {
    let mut levers = [0.0; MAX_AXES];
    let mut beyond = size(solids);
    for axis in axes.clone().rev() {
        levers[axis] = if chain.is_revolute(axis) { beyond } else { 1.0 };
        beyond += length(chain, axis);
    }
    // What is round about an axis stays where it is as that turns.
    let [first, last] = [axes.start, axes.end - 1];
    if chain.is_revolute(last) {
        levers[last] = levers[last].min(shift(&Isometry3::identity(), solids));
    }
    if let Some(fixed) = fixed.filter(|_| chain.is_revolute(first)) {
        levers[first] = levers[first].min(shift(&chain.before(first).isometry(), fixed));
    }
    levers
}

/// How far shapes move, as sets of points, per turn about the z axis of a frame, metres.
fn shift(body_from_axis: &Isometry3<f64>, solids: &[Solid]) -> f64 {
    /// Greatest sine of the angle of two directions that count as parallel.
    const PARALLEL: f64 = 1e-9;
    let one = |solid: &Solid| {
        let own = body_from_axis.inverse() * solid.body_from_shape;
        let is_round = match solid.shape {
            Shape::Cuboid(_) => false,
            Shape::Cylinder { .. } => (own.rotation * Vector3::z()).xy().norm() < PARALLEL,
            Shape::Sphere { .. } => true,
        };
        own.translation.vector.xy().norm() + if is_round { 0.0 } else { solid.radius }
    };
    solids.iter().map(one).fold(0.0, f64::max)
}

/// The same for all shapes against the base.
fn levers_of_all(chain: &Chain, bodies: &ArmBodies, hand: &Carried) -> Positions {
    let mut levers = [0.0; MAX_AXES];
    let mut beyond = size(&hand.body.solids);
    for axis in (0..chain.len()).rev() {
        beyond = beyond.max(size(&bodies.bodies[axis + 1].solids));
        levers[axis] = if chain.is_revolute(axis) { beyond } else { 1.0 };
        beyond += length(chain, axis);
    }
    levers
}

/// The greatest distance between the frames of an axis and of the one before it, metres.
fn length(chain: &Chain, axis: usize) -> f64 {
    let [lower, upper] = chain.limits(axis);
    let travel = if chain.is_revolute(axis) { 0.0 } else { lower.abs().max(upper.abs()) };
    chain.before(axis).shift.norm() + travel
}
