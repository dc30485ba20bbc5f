//! How far the open hand pushes other objects aside on its approach, and how far into their support.
//!
//! Depths are measured between the hand's swept shapes and the convex parts of the neighbours, with which the simulation computes contacts too.
//! What is pushed sideways gives way, what is pressed onto the table stops the hand: so the rank depends on [`Touch::press`] alone
//! (`docs/notebook/clutter.md` has the success by depth, measured by `scripts/measure_touches.py`).

use super::{CollisionScene, Neighbour};
use crate::open_hand::{OpenHand, SweptShape, pose, vector};
use nalgebra::{Isometry3, Translation3, UnitVector3, Vector3};
use parry3d_f64::math::{Pose, Vector};
use parry3d_f64::query::{ShapeCastOptions, cast_shapes, contact};
use parry3d_f64::shape::SharedShape;
use serde::{Deserialize, Serialize};

/// Greatest mass of an object that gives way, kilograms: a hand that stops at 60 N slides 6 kg on a surface with a friction of 1.
const HEAVIEST: f64 = 6.0;

/// How far the open hand pushes free neighbours on its approach; 0 where it touches none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Touch {
    /// Deepest penetration of a neighbour, metres.
    pub depth: f64,
    /// Greatest depth along which a neighbour is pushed down, so that its support resists, metres: a penetration times the cosine between down and
    /// the normal of the first contact, 0 for a push sideways or up.
    pub press: f64,
}

impl Touch {
    fn max(self, other: Self) -> Self {
        Self { depth: self.depth.max(other.depth), press: self.press.max(other.press) }
    }
}

/// A shape of the hand on its approach, in the frame of a neighbour.
struct Path<'a> {
    shape: &'a SweptShape,
    /// Pose of the swept volume.
    swept: Pose,
    /// Pose of the shape where the approach begins.
    begin: Pose,
    /// The whole approach, metres.
    way: Vector,
    /// Unit vector.
    down: Vector,
}

impl Path<'_> {
    /// Touch of a convex part of the neighbour.
    fn touch(&self, part: &SharedShape) -> Touch {
        let found = contact(&self.swept, &*self.shape.swept.0, &Pose::IDENTITY, &*part.0, 0.0);
        // Unsupported pairs do not occur: all shapes are convex.
        let Some(deepest) = found.ok().flatten().filter(|contact| contact.dist < 0.0) else {
            return Touch::default();
        };
        let whole_way = ShapeCastOptions::with_max_time_of_impact(1.0);
        let (hand, part) = (&*self.shape.shape.0, &*part.0);
        let first = cast_shapes(&self.begin, self.way, hand, &Pose::IDENTITY, Vector::ZERO, part, whole_way);
        // Within rounding of touching there may be no first contact.
        let push = first.ok().flatten().map_or(deepest.normal1, |hit| self.begin.rotation * hit.normal1);
        let depth = -deepest.dist;
        Touch { depth, press: depth * push.dot(self.down).max(0.0) }
    }
}

impl Neighbour {
    /// True if a hand can push it: an object of at most 6 kg with convex parts.
    fn gives_way(&self) -> bool {
        self.mass.is_some_and(|mass| mass <= HEAVIEST) && !self.obstacle.parts.is_empty()
    }

    /// Touch of the open hand on its straight approach; `None` if nothing can be pushed there.
    fn touch(&self, hand: &OpenHand, from_hand: &Isometry3<f64>, down: UnitVector3<f64>) -> Option<Touch> {
        let place = pose(from_hand);
        if !hand.shapes.iter().any(|s| self.obstacle.hits(&s.swept, &(place * s.hand_from_swept))) {
            return Some(Touch::default());
        }
        let begin = pose(&(from_hand * Translation3::new(0.0, 0.0, -hand.standoff)));
        let no_room = || hand.shapes.iter().any(|s| self.obstacle.hits(&s.shape, &(begin * s.hand_from_shape)));
        if !self.gives_way() || no_room() {
            return None;
        }
        let paths = hand.shapes.iter().map(|shape| Path {
            shape,
            swept: place * shape.hand_from_swept,
            begin: begin * shape.hand_from_shape,
            way: vector(&(from_hand * Vector3::z() * hand.standoff)),
            down: vector(&down),
        });
        let touches = paths.flat_map(|path| self.obstacle.parts.iter().map(move |(part, _)| path.touch(part)));
        Some(touches.fold(Touch::default(), Touch::max))
    }
}

impl CollisionScene {
    /// How far the open hand pushes its neighbours on its straight approach to `object_from_hand`; `None` if something there cannot be pushed:
    /// a wall, an object of more than 6 kg or without convex parts, or one that is where the approach begins. Object and table are not tested.
    pub fn touch(&self, hand: &OpenHand, object_from_hand: &Isometry3<f64>) -> Option<Touch> {
        let touches = self.neighbours.iter().zip(&self.neighbours_from_object).map(|(neighbour, from_object)| {
            neighbour.touch(hand, &(from_object * object_from_hand), -(from_object * self.up))
        });
        touches.into_iter().try_fold(Touch::default(), |all, touch| Some(all.max(touch?)))
    }
}
