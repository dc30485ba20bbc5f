//! Islands: sets of bodies that touch each other, directly or through others. The equations of a step fall apart into those of its islands.
//!
//! Bodies that cannot move join nothing: the scenery, and bodies of the hand without free coordinates. All other bodies of the hand count as one.
//! A single object is always solved with the hand.

use std::ops::Range;

use super::Patch;
use crate::model::{BodyKind, Model};

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
}

impl Islands {
    /// Finds the islands that the patches connect: the hand's first, then by their first object.
    pub fn find(&mut self, model: &Model, patches: &[Patch]) {
        let objects = model.object_count();
        let hand = objects;
        self.earlier.clear();
        self.earlier.extend(0..=hand);
        if objects == 1 {
            self.join(0, hand);
        }
        self.roots.clear();
        for patch in patches {
            let [a, b] = patch.sides.map(|side| node(model, side));
            if let (Some(a), Some(b)) = (a, b) {
                self.join(a, b);
            }
            self.roots.push(a.or(b).unwrap_or(hand));
        }
        self.all.clear();
        self.objects.clear();
        self.patches.clear();
        let of_hand = self.root(hand);
        self.collect(model, of_hand, true);
        for object in 0..objects {
            if self.root(object) == object && object != of_hand {
                self.collect(model, object, false);
            }
        }
    }

    /// Objects of an island, in their order.
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
        self.all.push(Island { hand, objects: objects..self.objects.len(), patches: patches..self.patches.len() });
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

/// Node of a body; `None` if it cannot move.
fn node(model: &Model, body: BodyKind) -> Option<usize> {
    match body {
        BodyKind::Object(object) => Some(object),
        BodyKind::Hand(body) => (!model.columns[body].is_empty()).then_some(model.object_count()),
        BodyKind::Scenery => None,
    }
}
