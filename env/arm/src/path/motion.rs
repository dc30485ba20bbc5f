//! A straight motion between two postures, checked by the distance that bodies move.
//!
//! At a posture, a body that is farther from everything than any of its points moves until the ends of an interval touches nothing in the
//! interval. Where it is nearer, what remains on both sides is checked in its own middle. Nearer than its clearance it touches; between the
//! postures that are looked at it comes no nearer than half of that.
//!
//! A point of a body moves, per rad of an axis, by its distance from the axis at most: that in the middle, and what later axes add to it until the
//! ends.

use crate::bodies::{ArmBodies, Body, Carried, Solid, library, library_pose};
use crate::chain::{Chain, MAX_AXES, Positions};
use crate::scene::{Scene, Touched};
use graspbox_plan::collision::distance_within;
use nalgebra::Isometry3;
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::shape::SharedShape;
use std::collections::VecDeque;

/// Distance that bodies of the robot keep from each other, metres: their shapes enclose the real links.
const SELF_CLEARANCE: f64 = 0.001;

/// Halvings by which the end of a cleared interval is found, from below.
const HALVINGS: usize = 10;

/// What moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mover {
    /// A body of the arm.
    Arm(usize),
    Hand,
    /// What the hand carries.
    Thing,
}

/// What a mover touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum With {
    Itself(Mover),
    World(Touched),
}

/// Two things that touch.
pub type Contact = (Mover, With);

/// A convex shape in the frame of its body.
struct Convex {
    shape: SharedShape,
    body_from_shape: Pose,
    /// Centre of a sphere around it, frame of the body, and its radius.
    center: Vector,
    radius: f64,
}

impl Convex {
    fn of(solid: &Solid) -> Self {
        let body_from_shape = library_pose(&solid.body_from_shape, &solid.shape);
        Self { shape: solid.solid.clone(), body_from_shape, center: body_from_shape.translation, radius: solid.radius }
    }

    fn sphere(&self, world_from_body: &Pose) -> (Vector, f64) {
        (*world_from_body * self.center, self.radius)
    }
}

/// Shapes that move together.
struct Group {
    mover: Mover,
    /// Body that carries them: 0 is the base, `i + 1` is moved by axis `i`.
    body: usize,
    shapes: Vec<Convex>,
    center: Vector,
    radius: f64,
}

impl Group {
    fn new(mover: Mover, body: usize, shapes: Vec<Convex>) -> Self {
        let count = shapes.len().max(1) as f64;
        let center = shapes.iter().fold(Vector::ZERO, |sum, shape| sum + shape.center) / count;
        let radius = shapes.iter().map(|shape| (shape.center - center).length() + shape.radius).fold(0.0, f64::max);
        Self { mover, body, shapes, center, radius }
    }
}

/// Frames of a posture in the world.
struct Posed {
    bodies: [Pose; MAX_AXES + 1],
    /// A point and the direction of each axis.
    axes: [(Vector, Vector); MAX_AXES],
}

/// The robot and its surroundings, for motions.
pub(crate) struct Motions<'a> {
    chain: &'a Chain,
    scene: &'a Scene,
    groups: Vec<Group>,
    /// Pairs of groups that may touch, the one nearer to the base first.
    pairs: Vec<[usize; 2]>,
}

/// A part of a motion, and what is still open there: groups against the world, and pairs of them.
struct Interval {
    from: f64,
    to: f64,
    groups: Vec<usize>,
    pairs: Vec<[usize; 2]>,
}

impl<'a> Motions<'a> {
    /// * `hands`: the hand in all configurations that it may have.
    /// * `thing`: the convex parts of what it carries, with the pose of the thing in the frame of the last body.
    pub fn new(
        chain: &'a Chain,
        bodies: &ArmBodies,
        scene: &'a Scene,
        hands: &[Carried],
        thing: Option<(Vec<SharedShape>, Isometry3<f64>)>,
    ) -> Self {
        let last = bodies.count() - 1;
        let own = |(index, body): (usize, &Body)| {
            Group::new(Mover::Arm(index), index, body.solids.iter().map(Convex::of).collect())
        };
        let mut groups: Vec<Group> = bodies.bodies.iter().enumerate().map(own).collect();
        let mut pairs = bodies.pairs.clone();
        let mut solids: Vec<&Solid> = Vec::new();
        for solid in hands.iter().flat_map(|hand| &hand.body.solids) {
            // The palm is the same in all configurations.
            if !solids.iter().any(|s| s.shape == solid.shape && s.body_from_shape == solid.body_from_shape) {
                solids.push(solid);
            }
        }
        let hand: Vec<Convex> = solids.into_iter().map(Convex::of).collect();
        let meets = hands.first().map_or(&[][..], |hand| &hand.meets);
        pairs.extend(meets.iter().map(|body| [*body, groups.len()]));
        groups.push(Group::new(Mover::Hand, last, hand));
        if let Some((parts, last_from_thing)) = thing {
            let at = library(&last_from_thing);
            let convex = |shape: SharedShape| {
                let sphere = shape.compute_local_bounding_sphere();
                Convex { shape, body_from_shape: at, center: at * sphere.center, radius: sphere.radius }
            };
            pairs.extend(meets.iter().map(|body| [*body, groups.len()]));
            groups.push(Group::new(Mover::Thing, last, parts.into_iter().map(convex).collect()));
        }
        groups.iter_mut().for_each(|group| group.radius += f64::EPSILON);
        Self { chain, scene, groups, pairs }
    }

    fn posed(&self, positions: &Positions) -> Posed {
        let frames = self.chain.frames(positions);
        let base = library(self.scene.world_from_base());
        let mut posed = Posed { bodies: [base; MAX_AXES + 1], axes: [(Vector::ZERO, Vector::Z); MAX_AXES] };
        for axis in 0..self.chain.len() {
            let frame = base * library(&frames.axes[axis].isometry());
            posed.bodies[axis + 1] = frame;
            posed.axes[axis] = (frame.translation, frame.rotation * Vector::Z);
        }
        posed
    }

    /// How far a point of a group moves at most against a body nearer to the base while the axes move by `change`, metres.
    fn moved(&self, posed: &Posed, group: &Group, against: usize, change: &Positions) -> f64 {
        let center = posed.bodies[group.body] * group.center;
        let mut moved = 0.0;
        for axis in (against..group.body).rev() {
            let (point, along) = posed.axes[axis];
            moved += if self.chain.is_revolute(axis) {
                let arm = (center - point).cross(along).length() + group.radius + moved;
                change[axis].abs() * arm
            } else {
                change[axis].abs()
            };
        }
        moved
    }

    /// How far a group is from the world, up to `most`, beyond half the clearance; and what it touches.
    fn room(
        &self,
        posed: &Posed,
        group: &Group,
        most: f64,
        ignored: &dyn Fn(Mover, Touched) -> bool,
    ) -> (f64, Option<Touched>) {
        let (frame, mut least) = (&posed.bodies[group.body], most);
        let near = self.scene.near((*frame * group.center, group.radius), most);
        for convex in &group.shapes {
            let at = *frame * convex.body_from_shape;
            let ignored = |what| ignored(group.mover, what);
            let (room, touched) = self.scene.room(&convex.shape, &at, convex.sphere(frame), least, &near, ignored);
            if touched.is_some() {
                return (0.0, touched);
            }
            least = least.min(room);
        }
        (least, None)
    }

    /// Distance between two groups, up to `most`, metres.
    fn gap(&self, posed: &Posed, [a, b]: [usize; 2], most: f64) -> f64 {
        let (a, b) = (&self.groups[a], &self.groups[b]);
        let (one, two) = (&posed.bodies[a.body], &posed.bodies[b.body]);
        let apart = (*one * a.center - *two * b.center).length();
        let mut least = most;
        if apart - a.radius - b.radius >= least {
            return least;
        }
        for first in &a.shapes {
            let (center, radius) = first.sphere(one);
            let at = *one * first.body_from_shape;
            for second in &b.shapes {
                let (other, reach) = second.sphere(two);
                if (center - other).length() - radius - reach < least {
                    let place = at.inv_mul(&(*two * second.body_from_shape));
                    least = least.min(distance_within(&place, &first.shape, &second.shape, least));
                }
            }
        }
        least
    }

    /// What a posture touches.
    pub fn contact_at(&self, positions: &Positions, ignored: &dyn Fn(Mover, Touched) -> bool) -> Option<Contact> {
        self.contact(&[*positions], ignored)
    }

    /// Everything that a mover is nearer to than its clearance at a posture.
    pub fn touched_by(&self, mover: Mover, positions: &Positions) -> Vec<Touched> {
        let posed = self.posed(positions);
        let mut all: Vec<Touched> = Vec::new();
        for group in self.groups.iter().filter(|group| group.mover == mover) {
            while let (_, Some(touched)) = self.room(&posed, group, 0.0, &|_, what| all.contains(&what)) {
                all.push(touched);
            }
        }
        all
    }

    /// What straight motions from posture to posture touch first, in no particular order.
    ///
    /// * `ignored`: what a mover may touch.
    pub fn contact(&self, postures: &[Positions], ignored: &dyn Fn(Mover, Touched) -> bool) -> Option<Contact> {
        let moving = (0..self.groups.len()).filter(|group| {
            let group = &self.groups[*group];
            group.body > 0 && !group.shapes.is_empty()
        });
        let course = Course::new(postures);
        let to = course.end();
        let whole = Interval { from: 0.0, to, groups: moving.collect(), pairs: self.pairs.clone() };
        let mut open = VecDeque::from([whole]);
        while let Some(interval) = open.pop_front() {
            match self.look(&course, interval, ignored) {
                Err(contact) => return Some(contact),
                Ok(rest) => open.extend(rest.into_iter().flatten()),
            }
        }
        None
    }

    /// Looks at the middle of an interval; returns what remains on both sides.
    fn look(
        &self,
        course: &Course<'_>,
        interval: Interval,
        ignored: &dyn Fn(Mover, Touched) -> bool,
    ) -> Result<Option<[Interval; 2]>, Contact> {
        let middle = 0.5 * (interval.from + interval.to);
        let change = course.change(middle, [interval.from, interval.to]);
        let posed = self.posed(&course.at(middle));
        // The share of these changes that all that is left has cleared.
        let mut cleared: f64 = 1.0;
        let (mut groups, mut pairs) = (Vec::new(), Vec::new());
        for index in interval.groups {
            let group = &self.groups[index];
            let moved = self.moved(&posed, group, 0, &change);
            let (room, touched) = self.room(&posed, group, moved, ignored);
            if let Some(touched) = touched {
                return Err((group.mover, With::World(touched)));
            }
            if room < moved {
                cleared = cleared.min(room / moved);
                groups.push(index);
            }
        }
        for [a, b] in interval.pairs {
            let moved = self.moved(&posed, &self.groups[b], self.groups[a].body, &change);
            let gap = self.gap(&posed, [a, b], (moved + 0.5 * SELF_CLEARANCE).max(SELF_CLEARANCE));
            if gap < SELF_CLEARANCE {
                return Err((self.groups[b].mover, With::Itself(self.groups[a].mover)));
            }
            let room = gap - 0.5 * SELF_CLEARANCE;
            if room < moved {
                cleared = cleared.min(room / moved);
                pairs.push([a, b]);
            }
        }
        if groups.is_empty() && pairs.is_empty() {
            return Ok(None);
        }
        // A point moves by a share of its bound while the axes move by that share of their changes.
        let limit = change.map(|change| cleared * change);
        let [before, after] = [interval.from, interval.to].map(|end| course.within(middle, end, &limit));
        let (more, other) = (groups.clone(), pairs.clone());
        let before = Interval { from: interval.from, to: before, groups: more, pairs: other };
        Ok(Some([before, Interval { from: after, to: interval.to, groups, pairs }]))
    }
}

/// Straight motions from posture to posture; a place on it is the number of the posture before, and the share of the way to the next.
struct Course<'a> {
    postures: &'a [Positions],
    /// How far each axis has moved until each posture, in all.
    moved: Vec<Positions>,
}

impl<'a> Course<'a> {
    fn new(postures: &'a [Positions]) -> Self {
        let mut all = [0.0; MAX_AXES];
        let mut moved = vec![all];
        for pair in postures.windows(2) {
            all = std::array::from_fn(|axis| all[axis] + (pair[1][axis] - pair[0][axis]).abs());
            moved.push(all);
        }
        Self { postures, moved }
    }

    fn end(&self) -> f64 {
        (self.postures.len() - 1) as f64
    }

    fn between(rows: &[Positions], place: f64) -> Positions {
        let before = (place as usize).min(rows.len().saturating_sub(2));
        let (from, share) = (&rows[before], place - before as f64);
        let to = rows.get(before + 1).unwrap_or(from);
        std::array::from_fn(|axis| from[axis] + share * (to[axis] - from[axis]))
    }

    fn at(&self, place: f64) -> Positions {
        Self::between(self.postures, place)
    }

    /// How far each axis moves at most from a place to one of two others.
    fn change(&self, from: f64, to: [f64; 2]) -> Positions {
        let here = Self::between(&self.moved, from);
        let ends = to.map(|end| Self::between(&self.moved, end));
        std::array::from_fn(|axis| ends.iter().map(|end| (end[axis] - here[axis]).abs()).fold(0.0, f64::max))
    }

    /// The farthest place towards `to` until which no axis moves by more than its limit.
    fn within(&self, from: f64, to: f64, limit: &Positions) -> f64 {
        let keeps = |place: f64| self.change(from, [place; 2]).iter().zip(limit).all(|(moved, limit)| moved <= limit);
        let [mut inside, mut outside] = [from, to];
        for _ in 0..HALVINGS {
            let middle = 0.5 * (inside + outside);
            if keeps(middle) { inside = middle } else { outside = middle }
        }
        inside
    }
}
