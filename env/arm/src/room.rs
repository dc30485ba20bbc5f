//! How much room a posture leaves: the distances between links that may touch, and from the links to table and walls.
//!
//! One distance is true for a neighbourhood: it shrinks by no more than what moves, and that is bounded by the change of each axis between the two
//! bodies times the length beyond it. So a motion in steps measures a distance anew only where the two come near each other. And two shapes are most
//! often still apart along the direction in which they were nearest: that costs no query.

use crate::bodies::{ArmBodies, Body, Carried, Solid, frame, half_extent, half_height, library_pose, library_shape};
use crate::chain::{Chain, Frames, MAX_AXES, Positions};
use graspbox_hand::Shape;
use nalgebra::{Isometry3, Point3, Vector3};
use parry3d_f64::query::details::closest_points_support_map_support_map_with_params as closest_points;
use parry3d_f64::query::gjk::{GJKResult, VoronoiSimplex};
use parry3d_f64::shape::SharedShape;

/// Greatest distance, metres: that of what no obstacle is near.
const FAR: f64 = 1.0;
/// From here on the distance of the spheres about two things, which is less than theirs, is enough, metres: it costs no query.
const ENOUGH: f64 = 0.03;
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

/// Two things that must not touch: a body and what it moves towards.
#[derive(Clone, Copy, Debug)]
enum Meeting {
    Bodies(usize, usize),
    /// The hand and a body.
    Hand(usize),
    /// A body, and table and walls.
    Surroundings(usize),
}

/// What the links of an arm must keep away from.
pub struct Room {
    bodies: ArmBodies,
    hand: Carried,
    world_from_base: Isometry3<f64>,
    walls: Vec<Fixed>,
    meetings: Vec<Meeting>,
    /// For each of them, how far one can move against the other per change of each axis, metres.
    levers: Vec<Positions>,
    /// The same for anything against the base.
    most: Positions,
    count: usize,
}

impl std::fmt::Debug for Room {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Room({} meetings, {} walls)", self.meetings.len(), self.walls.len())
    }
}

/// Distances that were measured, each with the posture; they change no answer, but the time that it takes.
#[derive(Clone, Debug, Default)]
pub struct Measured(Vec<Known>);

/// What is known of a meeting.
#[derive(Clone, Debug)]
struct Known {
    at: Positions,
    room: f64,
    /// Of each pair of shapes of the two bodies.
    pairs: Vec<Pair>,
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

/// The pairs of shapes of two bodies, and the distance that is asked for, metres.
struct Asked<'a> {
    pairs: &'a mut Vec<Pair>,
    least: f64,
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
        let last = bodies.bodies.len() - 1;
        let own = bodies.pairs.iter().map(|&[a, b]| Meeting::Bodies(a, b));
        let meetings: Vec<Meeting> = own
            .chain(hand.meets.iter().map(|body| Meeting::Hand(*body)))
            .chain((1..=last).filter(|body| !bodies.bodies[*body].solids.is_empty()).map(Meeting::Surroundings))
            .collect();
        let levers = meetings.iter().map(|meeting| match *meeting {
            Meeting::Bodies(a, b) => levers(chain, a, b, &bodies.bodies[b].solids),
            Meeting::Hand(body) => levers(chain, body, last, &hand.body.solids),
            Meeting::Surroundings(body) => levers(chain, 0, body, &bodies.bodies[body].solids),
        });
        let levers: Vec<Positions> = levers.collect();
        let mut most = levers_of_all(chain, bodies, &hand);
        most[chain.len()..].fill(0.0);
        let walls = walls.iter().map(fixed).collect();
        let mut room =
            Self { bodies: bodies.clone(), hand, world_from_base, walls, meetings, levers, most, count: chain.len() };
        room.forget_what_never_meets(chain);
        room
    }

    /// Leaves out what keeps [`NEVER`] in all postures within the limits, of meetings on which at most two axes have an influence.
    fn forget_what_never_meets(&mut self, chain: &Chain) {
        let mut kept = Vec::new();
        for index in 0..self.meetings.len() {
            let axes: Vec<usize> = (0..self.count).filter(|axis| self.levers[index][*axis] > 0.0).collect();
            if axes.len() > 2 || !self.never_meet(chain, index, &axes) {
                kept.push(index);
            }
        }
        self.levers = kept.iter().map(|index| self.levers[*index]).collect();
        self.meetings = kept.iter().map(|index| self.meetings[*index]).collect();
    }

    /// Divides the ranges of the axes until each part is proven by the distance at its middle, which is true for a neighbourhood.
    fn never_meet(&self, chain: &Chain, index: usize, axes: &[usize]) -> bool {
        let (meeting, levers) = (self.meetings[index], &self.levers[index]);
        let mut parts = vec![axes.iter().map(|axis| chain.limits(*axis)).collect::<Vec<_>>()];
        for _ in 0..PROOF {
            let Some(part) = parts.pop() else { return true };
            let mut middle = [0.0; MAX_AXES];
            axes.iter().zip(&part).for_each(|(axis, [low, high])| middle[*axis] = 0.5 * (low + high));
            let moved = |at: usize| 0.5 * (part[at][1] - part[at][0]) * levers[axes[at]];
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

    /// The bodies, to name them.
    #[must_use]
    pub fn bodies(&self) -> &ArmBodies {
        &self.bodies
    }

    /// An upper bound of how far anything moves between two postures, metres.
    #[must_use]
    pub fn motion(&self, from: &Positions, to: &Positions) -> f64 {
        (0..self.count).map(|axis| (from[axis] - to[axis]).abs() * self.most[axis]).sum()
    }

    /// True if a posture leaves at least `least` metres.
    pub fn leaves(&self, chain: &Chain, positions: &Positions, least: f64, known: &mut Measured) -> bool {
        if known.0.len() != self.meetings.len() {
            let nothing = Known { at: [0.0; MAX_AXES], room: f64::NEG_INFINITY, pairs: Vec::new() };
            known.0 = vec![nothing; self.meetings.len()];
        }
        let mut frames: Option<Frames> = None;
        for ((meeting, levers), own) in self.meetings.iter().zip(&self.levers).zip(&mut known.0) {
            let moved: f64 = (0..self.count).map(|axis| (own.at[axis] - positions[axis]).abs() * levers[axis]).sum();
            if own.room - moved - ROUNDING >= least {
                continue;
            }
            let frames = frames.get_or_insert_with(|| chain.frames(positions));
            own.at = *positions;
            own.room = self.distance(*meeting, frames, Some(Asked { pairs: &mut own.pairs, least }));
            if own.room < least {
                return false;
            }
        }
        true
    }

    /// Distance of a meeting, metres, or less than it beyond [`ENOUGH`] or what is asked for; 0 where they touch.
    fn distance(&self, meeting: Meeting, frames: &Frames, asked: Option<Asked<'_>>) -> f64 {
        let mut least = FAR;
        let pose = |body: usize| frame(frames, body);
        let last = self.bodies.bodies.len() - 1;
        match meeting {
            Meeting::Bodies(a, b) => {
                let (one, two) = (pose(a), pose(b));
                let [one, two] = [(a, &one), (b, &two)].map(|(body, at)| Posed { body: &self.bodies.bodies[body], at });
                apart(&one, &two, &mut least, asked);
            }
            Meeting::Hand(body) => {
                let (own, other) = (pose(last), pose(body));
                let hand = Posed { body: &self.hand.body, at: &own };
                apart(&hand, &Posed { body: &self.bodies.bodies[body], at: &other }, &mut least, asked);
            }
            Meeting::Surroundings(body) => {
                let (own, at) = (&self.bodies.bodies[body], pose(body));
                self.near_surroundings(own, &at, &(at * own.center), &mut least);
            }
        }
        least.max(0.0)
    }

    /// The least distance, metres, or less than it beyond `ENOUGH`; 0 where something touches.
    #[must_use]
    pub fn measure(&self, frames: &Frames) -> f64 {
        self.meetings.iter().map(|meeting| self.distance(*meeting, frames, None)).fold(FAR, f64::min)
    }

    /// Lowers `least` to the distance of a body from the table and the walls.
    fn near_surroundings(&self, body: &Body, at: &Isometry3<f64>, center: &Point3<f64>, least: &mut f64) {
        let height = (self.world_from_base * center).z - body.radius;
        let far = |wall: &Fixed| {
            (wall.at.inverse_transform_point(center).coords.abs() - half(&wall.shape)).max() - body.radius
        };
        let nearest = self.walls.iter().map(far).fold(f64::INFINITY, f64::min);
        if height.min(nearest) >= ENOUGH {
            *least = least.min(height.min(nearest));
            return;
        }
        for solid in &body.solids {
            let own = at * solid.body_from_shape;
            if height < ENOUGH {
                let world = self.world_from_base * own;
                *least = least.min(world.translation.z - half_height(&solid.shape, &world.rotation));
            }
            for wall in self.walls.iter().filter(|wall| far(wall) < ENOUGH) {
                *least = least.min(gap((&solid.shape, &solid.solid, &own), (&wall.shape, &wall.solid, &wall.at)).0);
            }
        }
        // What is not near, but not nothing.
        for beyond in [height, nearest].into_iter().filter(|beyond| *beyond >= ENOUGH) {
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
    if beyond >= ENOUGH {
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
            if near >= ENOUGH {
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
                if apart >= NEARLY * pair.distance && apart - ROUNDING >= *wanted {
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

/// How far shapes on body `to` can move against body `from` per change of each axis between them, metres; 1 for a prismatic one.
fn levers(chain: &Chain, from: usize, to: usize, solids: &[Solid]) -> Positions {
    let mut levers = [0.0; MAX_AXES];
    let mut beyond = size(solids);
    for axis in (from..to).rev() {
        levers[axis] = if chain.is_revolute(axis) { beyond } else { 1.0 };
        beyond += length(chain, axis);
    }
    levers
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
