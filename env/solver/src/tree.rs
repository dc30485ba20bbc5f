//! The hand as the solver sees it: a tree of rigid bodies, its coordinates, and the springs, stops and cables that act on them.
//!
//! Body 0 is the base, which stands still in the frame of the simulation. Every other body hangs on an earlier one by a joint. A joint's
//! position is `ratio * q[coordinate] + offset`, so that several joints may follow one coordinate (a mimic joint). The first
//! [`Tree::coordinates`] are free; [`Tree::driven`] more follow a given motion (a self-locking gear).

use nalgebra::{Isometry3, Matrix3, Point3, Unit, Vector3};

use crate::error::ModelError;

/// What a joint lets its body do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// A turn about the axis, radians.
    Revolute,
    /// A shift along the axis, metres.
    Prismatic,
}

/// How a body hangs on its parent.
#[derive(Clone, Debug)]
pub struct Joint {
    /// Turn or shift.
    pub kind: JointKind,
    /// The joint's frame in the parent at position 0.
    pub parent_from_joint: Isometry3<f64>,
    /// Axis, joint's frame.
    pub axis: Unit<Vector3<f64>>,
    /// The coordinate that it follows: a free one, or `coordinates.len() + i` for the driven one `i`.
    pub coordinate: usize,
    /// Its position per unit of the coordinate.
    pub ratio: f64,
    /// Its position where the coordinate is 0.
    pub offset: f64,
}

/// A collision primitive, lengths in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Primitive {
    /// A box by its half extents.
    Cuboid(Vector3<f64>),
    /// A cylinder about its z axis.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Half its length.
        half_length: f64,
    },
    /// A ball.
    Sphere {
        /// Radius.
        radius: f64,
    },
}

/// One collision shape of a body.
#[derive(Clone, Copy, Debug)]
pub struct BodyShape {
    /// The primitive.
    pub primitive: Primitive,
    /// Its pose in the body's frame.
    pub body_from_shape: Isometry3<f64>,
    /// Friction factor; the coefficient of a pair is the product of its two factors.
    pub friction: f64,
}

/// A rigid body of the hand.
#[derive(Clone, Debug)]
pub struct Body {
    /// Index of the body that it hangs on, less than its own; ignored for the base.
    pub parent: usize,
    /// Its joint; `None` for the base only.
    pub joint: Option<Joint>,
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass, body frame, metres.
    pub center: Point3<f64>,
    /// Inertia about the centre of mass, axes of the body, kg m2.
    pub inertia: Matrix3<f64>,
    /// Collision shapes.
    pub shapes: Vec<BodyShape>,
}

/// What acts on one free coordinate (rad and N m, or m and N).
#[derive(Clone, Copy, Debug)]
pub struct Coordinate {
    /// Inertia added to the coordinate: rotor and gear, kg m2 (kg).
    pub armature: f64,
    /// Damping, N m s/rad (N s/m).
    pub damping: f64,
    /// Stiffness of the spring, N m/rad (N/m).
    pub stiffness: f64,
    /// Position where that spring is at rest.
    pub spring_reference: f64,
    /// Least and greatest position.
    pub limits: [f64; 2],
    /// Stiffness of the soft stops at the limits, N m/rad (N/m).
    pub stop_stiffness: f64,
}

/// A force along a length that several coordinates take up, `l = sum arm * q`: a tendon on a spool, or a servo with a spring in it.
///
/// With the stretch `e = given - l` the force is `stiffness * e + damping * de/dt`, clamped to `[0, max_force]` for a cable that can only
/// pull (then 0 where it is slack, `e <= 0`), or to `[-max_force, max_force]` for one that also pushes.
#[derive(Clone, Debug)]
pub struct Cable {
    /// Free coordinates that it runs over, and their moment arms, metres (for a servo: ratios).
    pub arms: Vec<(usize, f64)>,
    /// N/m (servo: N m/rad).
    pub stiffness: f64,
    /// N s/m (servo: N m s/rad).
    pub damping: f64,
    /// Greatest force, N (servo: N m).
    pub max_force: f64,
    /// True where it only pulls.
    pub unilateral: bool,
}

/// The whole hand.
#[derive(Clone, Debug, Default)]
pub struct Tree {
    /// Bodies; the base first, parents before children.
    pub bodies: Vec<Body>,
    /// Free coordinates.
    pub coordinates: Vec<Coordinate>,
    /// Number of driven coordinates.
    pub driven: usize,
    /// Tendons and servos.
    pub cables: Vec<Cable>,
    /// Pairs of bodies that may touch each other.
    pub pairs: Vec<(usize, usize)>,
}

/// Most unknown velocities that a tree may have: a dense solve of more is slower than other methods.
pub const MAX_COORDINATES: usize = 64;

impl Tree {
    /// Checks that the tree is as its description says.
    ///
    /// # Errors
    /// [`ModelError::BadTree`], saying what is wrong.
    pub fn check(&self) -> Result<(), ModelError> {
        let bad = |why: &'static str, index: usize| Err(ModelError::BadTree { why, index });
        let count = self.coordinates.len() + self.driven;
        if self.coordinates.len() > MAX_COORDINATES {
            return bad("there are more than 64 free coordinates", self.coordinates.len());
        }
        for (index, body) in self.bodies.iter().enumerate() {
            match &body.joint {
                None if index > 0 => return bad("a body beside the base has no joint", index),
                Some(_) if index == 0 => return bad("the base has a joint", index),
                Some(_) if body.parent >= index => return bad("a body comes before its parent", index),
                Some(joint) if joint.coordinate >= count => return bad("a joint follows no coordinate", index),
                _ => {}
            }
        }
        if self.bodies.is_empty() {
            return bad("there is no base", 0);
        }
        let moved = |i: usize| self.bodies.iter().filter_map(|b| b.joint.as_ref()).any(|j| j.coordinate == i);
        if let Some(index) = (0..self.coordinates.len()).find(|i| !moved(*i)) {
            return bad("no joint follows a coordinate", index);
        }
        let beyond = |c: &Cable| c.arms.iter().any(|(i, _)| *i >= self.coordinates.len());
        if let Some(index) = self.cables.iter().position(beyond) {
            return bad("a cable runs over a coordinate that is not free", index);
        }
        match self.pairs.iter().position(|(a, b)| a == b || (*a).max(*b) >= self.bodies.len()) {
            Some(index) => bad("a pair names a body twice, or one that does not exist", index),
            None => Ok(()),
        }
    }
}
