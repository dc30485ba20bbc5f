//! Islands: sets of bodies that touch each other, directly or through others. The equations of a step fall apart into those of its islands.
//!
//! Bodies that cannot move join nothing: the scenery, sleepers, and bodies of the hand without free coordinates. All other bodies of the hand count as one.

use std::ops::Range;

use super::ordering::{Set, only, order};
use super::sides::Side;
use super::{Patch, Problem, Touching};
use crate::kinematics::Kinematics;
use crate::model::{BodyKind, LEVER, Model};

/// An island: ranges of the lists in [`Islands`].
#[derive(Clone, Debug, Default)]
pub(crate) struct Island {
    /// Whether the hand's free coordinates are among its unknowns.
    pub hand: bool,
    objects: Range<usize>,
    patches: Range<usize>,
}

/// The islands of a step; buffers are kept from step to step.
#[derive(Clone, Default)]
pub(crate) struct Islands {
    pub all: Vec<Island>,
    /// Objects, island by island.
    objects: Vec<usize>,
    /// Indices of patches, island by island.
    patches: Vec<usize>,
    /// By node: an earlier node of the same island, or itself. Nodes are the objects, then the hand.
    earlier: Vec<usize>,
    /// Root of each patch.
    roots: Vec<usize>,
    /// By object: the objects that it touches.
    neighbours: Vec<Set>,
    /// The objects that touch the hand's movable bodies.
    touch_hand: Set,
}

impl Islands {
    /// Finds the islands that the patches connect: the hand's first, then by their first object. Sleepers are in none.
    pub fn find(&mut self, model: &Model, patches: &[Patch], asleep: &[bool]) {
        let objects = model.object_count();
        let hand = objects;
        self.earlier.clear();
        self.earlier.extend(0..=hand);
        self.roots.clear();
        self.neighbours.clear();
        self.neighbours.resize(objects, 0);
        self.touch_hand = 0;
        for patch in patches {
            let [a, b] = patch.sides.map(|side| node(model, side, asleep));
            if let (Some(a), Some(b)) = (a, b) {
                self.join(a, b);
                self.note_contact(a, b);
            }
            self.roots.push(a.or(b).unwrap_or(hand));
        }
        self.all.clear();
        self.objects.clear();
        self.patches.clear();
        let of_hand = self.root(hand);
        self.collect(model, of_hand, true);
        for (object, asleep) in asleep.iter().enumerate() {
            if self.root(object) == object && object != of_hand && !asleep {
                self.collect(model, object, false);
            }
        }
    }

    /// Objects of an island, in the order of their unknowns.
    pub fn objects(&self, island: &Island) -> &[usize] {
        &self.objects[island.objects.clone()]
    }

    /// Indices of an island's patches, in their order.
    pub fn patches(&self, island: &Island) -> &[usize] {
        &self.patches[island.patches.clone()]
    }

    fn collect(&mut self, model: &Model, root: usize, hand: bool) {
        let (objects, patches) = (self.objects.len(), self.patches.len());
        for object in 0..model.object_count() {
            if self.root(object) == root {
                self.objects.push(object);
            }
        }
        for index in 0..self.roots.len() {
            if self.root(self.roots[index]) == root {
                self.patches.push(index);
            }
        }
        order(&mut self.objects[objects..], &self.neighbours, if hand { self.touch_hand } else { 0 });
        self.all.push(Island { hand, objects: objects..self.objects.len(), patches: patches..self.patches.len() });
    }

    /// Nodes `a` and `b` touch; the last node is the hand.
    fn note_contact(&mut self, a: usize, b: usize) {
        let hand = self.neighbours.len();
        for (one, other) in [(a, b), (b, a)] {
            match (one == hand, other == hand) {
                (false, false) => self.neighbours[one] |= only(other),
                (false, true) => self.touch_hand |= only(one),
                _ => {}
            }
        }
    }

    fn root(&self, mut node: usize) -> usize {
        while self.earlier[node] != node {
            node = self.earlier[node];
        }
        node
    }

    /// Joins two islands under the earlier of their first nodes.
    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.earlier[a.max(b)] = a.min(b);
    }
}

impl Problem {
    /// Makes the velocities of an island the unknowns, and starts at those of the beginning of the step.
    pub fn enter(
        &mut self,
        model: &Model,
        kinematics: &Kinematics,
        (with_hand, objects, patches): (bool, &[usize], &[usize]),
    ) {
        let free = if with_hand { self.hand.q.len() } else { 0 };
        if self.free != free || self.members != objects {
            self.set_unknowns(model, free, objects);
        }
        self.v.clear();
        self.momentum.clear();
        self.v.extend(&self.hand.velocity[..free]);
        self.momentum.extend(&self.hand.momentum[..free]);
        for &object in objects {
            self.v.extend(&self.objects[object].velocity);
            self.momentum.extend(&self.objects[object].momentum);
        }
        self.touching.clear();
        for &patch in patches {
            let sides = self.patches[patch].sides.map(|body| self.side(model, kinematics, body));
            self.touching.push(Touching { patch, sides });
        }
    }

    /// Makes the hand's coordinates, all or none, and these objects the unknowns.
    fn set_unknowns(&mut self, model: &Model, free: usize, objects: &[usize]) {
        self.free = free;
        self.members.clear();
        self.members.extend(objects);
        self.levers.clear();
        self.levers.extend(&model.levers[..free]);
        self.start.fill(usize::MAX);
        for &object in objects {
            self.start[object] = self.levers.len();
            self.levers.extend([1.0, 1.0, 1.0, LEVER, LEVER, LEVER]);
        }
        self.residual.resize(self.levers.len(), 0.0);
        self.derivative.resize(self.levers.len());
    }

    /// The unknowns that move a body.
    fn side(&self, model: &Model, kinematics: &Kinematics, body: BodyKind) -> Side {
        match body {
            // A sleeper, which is no member.
            BodyKind::Object(object) if self.start[object] == usize::MAX => Side::Scenery,
            BodyKind::Object(object) => Side::Object { start: self.start[object], lever: self.objects[object].lever },
            BodyKind::Hand(body) => {
                let first = kinematics.first[body];
                Side::Hand { start: model.columns[body].start, first, last: first + model.columns[body].len() }
            }
            BodyKind::Scenery => Side::Scenery,
        }
    }

    /// Hands the island's velocities back to hand and objects.
    pub fn leave(&mut self) {
        self.hand.velocity[..self.free].copy_from_slice(&self.v[..self.free]);
        for &object in &self.members {
            let start = self.start[object];
            self.objects[object].velocity.copy_from_slice(&self.v[start..start + 6]);
        }
    }

    /// Whether several objects are among the unknowns.
    pub fn has_several_objects(&self) -> bool {
        self.members.len() > 1
    }

    /// Keeps the friction bounds for [`Problem::restore_bounds`].
    pub fn keep_bounds(&mut self) {
        self.kept_bounds.clear();
        for touching in &self.touching {
            let patch = &self.patches[touching.patch];
            self.kept_bounds.extend(self.points[patch.first..patch.last].iter().map(|point| point.bound));
        }
    }

    /// Restores the friction bounds that were kept last for this island.
    pub fn restore_bounds(&mut self) {
        let mut kept = self.kept_bounds.iter();
        for touching in &self.touching {
            let patch = &self.patches[touching.patch];
            for (point, bound) in self.points[patch.first..patch.last].iter_mut().zip(&mut kept) {
                point.bound = *bound;
            }
        }
    }
}

/// Node of a body; `None` if it cannot move.
fn node(model: &Model, body: BodyKind, asleep: &[bool]) -> Option<usize> {
    match body {
        BodyKind::Object(object) => (!asleep[object]).then_some(object),
        BodyKind::Hand(body) => (!model.columns[body].is_empty()).then_some(model.object_count()),
        BodyKind::Scenery => None,
    }
}
