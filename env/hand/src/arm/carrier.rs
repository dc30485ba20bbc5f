//! The arm that carries a hand, as a simulation of the hand sees it: bodies in a chain from the hand's base to the base of the arm.
//!
//! `graspbox_arm::carrier` makes it of an arm and a mount. A hand alone has none.

use crate::model::{JointKind, Shape};
use nalgebra::Isometry3;

/// A rigid body of the arm. Its joint connects it to the body before it, which is nearer to the hand.
#[derive(Clone, Debug, PartialEq)]
pub struct CarrierBody {
    /// Name of its first link.
    pub name: String,
    /// About or along the joint's z axis; fixed for the body that bears the hand.
    pub kind: JointKind,
    /// The joint in the frame of the body before it; for the first body, in the frame of the hand's base.
    pub before_from_joint: Isometry3<f64>,
    /// Its collision shapes.
    pub shapes: Vec<(Shape, Isometry3<f64>)>,
}

/// An axis of the arm.
#[derive(Clone, Debug, PartialEq)]
pub struct CarrierAxis {
    /// Name of its joint.
    pub name: String,
    pub kind: JointKind,
    /// Least and greatest position, rad or m.
    pub limits: [f64; 2],
    /// Greatest speed, rad/s or m/s.
    pub speed: f64,
}

/// An arm that carries a hand. At position `q` of an axis, the joint that leads from its body to the one before the axis is at `-q`.
#[derive(Clone, Debug, PartialEq)]
pub struct Carrier {
    /// Name of the arm.
    pub arm: String,
    /// Friction factor of its surfaces.
    pub friction: f64,
    /// Its axes, from the base on.
    pub axes: Vec<CarrierAxis>,
    /// Its bodies: first the one that bears the hand, last the base. One more than it has axes.
    pub bodies: Vec<CarrierBody>,
}

impl Carrier {
    /// Least and greatest number of all axes.
    #[must_use]
    pub fn range(&self, of: impl Fn(&CarrierAxis) -> [f64; 2]) -> [f64; 2] {
        let wider = |[low, high]: [f64; 2], [a, b]: [f64; 2]| [low.min(a), high.max(b)];
        self.axes.iter().map(of).reduce(wider).unwrap_or([0.0, 0.0])
    }

    /// One of three words: where all axes turn, where all slide, and else.
    #[must_use]
    pub fn unit(&self, [turns, slides, mixed]: [&'static str; 3]) -> &'static str {
        match self.axes.iter().filter(|axis| axis.kind == JointKind::Prismatic).count() {
            0 => turns,
            n if n == self.axes.len() => slides,
            _ => mixed,
        }
    }
}
