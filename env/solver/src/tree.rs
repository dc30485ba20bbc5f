//! The hand as the engine models it: a tree of rigid bodies, its coordinates, and the springs, stops and cables that act on them.
//!
//! Body 0 is the base, which is at rest in the frame of the simulation. A joint connects every other body to an earlier one. The position of a
//! joint is `ratio * q[coordinate] + offset`, so several joints may follow one coordinate (mimic joints). The first [`Tree::coordinates`]
//! are free; the [`Tree::driven`] after them follow prescribed motion (a self-locking gear).

use nalgebra::{Isometry3, Matrix3, Point3, Unit, Vector3};

use crate::error::ModelError;

/// Kind of motion that a joint allows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointKind {
    /// Rotation about the axis, radians.
    Revolute,
    /// Translation along the axis, metres.
    Prismatic,
}

/// The joint between a body and its parent.
#[derive(Clone, Debug)]
pub struct Joint {
    /// Rotation or translation.
    pub kind: JointKind,
    /// The joint's frame in the parent at position 0.
    pub parent_from_joint: Isometry3<f64>,
    /// Axis, joint's frame.
    pub axis: Unit<Vector3<f64>>,
    /// Index of its coordinate: free, or `coordinates.len() + i` for driven coordinate `i`.
    pub coordinate: usize,
    /// Position per unit of the coordinate.
    pub ratio: f64,
    /// Position where the coordinate is 0, radians or metres.
    pub offset: f64,
}

/// A collision primitive, lengths in metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Primitive {
    /// A box by its half extents.
    Cuboid(Vector3<f64>),
    /// A cylinder about its z axis.
    Cylinder {
        /// Radius, metres.
        radius: f64,
        /// Half its length, metres.
        half_length: f64,
    },
    /// A ball.
    Sphere {
        /// Radius, metres.
        radius: f64,
    },
}

/// One collision shape of a body.
#[derive(Clone, Copy, Debug)]
pub struct BodyShape {
    pub primitive: Primitive,
    /// Its pose in the body's frame.
    pub body_from_shape: Isometry3<f64>,
    /// Friction factor; the coefficient of a pair is the product of its two factors.
    pub friction: f64,
}

/// A rigid body of the hand.
#[derive(Clone, Debug)]
pub struct Body {
    /// Index of the parent body, less than the body's own; ignored for the base.
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

/// Passive forces on one free coordinate (rad and N m, or m and N).
#[derive(Clone, Copy, Debug)]
pub struct Coordinate {
    /// Reflected inertia of rotor and gear, kg m2 (kg).
    pub armature: f64,
    /// Damping, N m s/rad (N s/m).
    pub damping: f64,
    /// Stiffness of the spring, N m/rad (N/m).
    pub stiffness: f64,
    /// Rest position of the spring, rad (m).
    pub spring_reference: f64,
    /// Least and greatest position, rad (m).
    pub limits: [f64; 2],
    /// Stiffness of the soft stops at the limits, N m/rad (N/m).
    pub stop_stiffness: f64,
}

/// A force along a length that several coordinates take up, `l = sum arm * q`: a tendon on a spool, or a servo with series elasticity.
///
/// With the stretch `e = commanded length - l` the force is `stiffness * e + damping * de/dt`. A cable that pushes as well clamps it to
/// `[-max_force, max_force]`. A unilateral cable clamps it to `[0, max_force]`, is slack for `e <= 0`, and limits it to 20 times its
/// elastic part, so that a barely taut cable does not pull by damping.
#[derive(Clone, Debug)]
pub struct Cable {
    /// Free coordinates that it acts on, and their moment arms, metres (servo: ratios).
    pub arms: Vec<(usize, f64)>,
    /// Stiffness, N/m (servo: N m/rad).
    pub stiffness: f64,
    /// Damping, N s/m (servo: N m s/rad).
    pub damping: f64,
    /// Greatest force, N (servo: N m).
    pub max_force: f64,
    /// True for a cable that only pulls.
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
    /// Shapes of such pairs that pass through each other, each by its body and its index within it.
    pub apart: Vec<[(usize, usize); 2]>,
}

/// Most free coordinates of a tree: beyond that, sparse methods are faster than dense matrices.
pub const MAX_COORDINATES: usize = 64;

impl Tree {
    /// Checks the tree against the rules in this module's documentation.
    ///
    /// # Errors
    /// [`ModelError::BadTree`], with the rule that is broken and the index of the element.
    pub fn check(&self) -> Result<(), ModelError> {
        let bad = |why: &'static str, index: usize| Err(ModelError::BadTree { why, index });
        let count = self.coordinates.len() + self.driven;
        if self.coordinates.len() > MAX_COORDINATES {
            return bad("the tree has more than 64 free coordinates", self.coordinates.len());
        }
        for (index, body) in self.bodies.iter().enumerate() {
            match &body.joint {
                None if index > 0 => return bad("a body other than the base has no joint", index),
                Some(_) if index == 0 => return bad("the base has a joint", index),
                Some(_) if body.parent >= index => return bad("a body comes before its parent", index),
                Some(joint) if joint.coordinate >= count => {
                    return bad("a joint refers to a coordinate that does not exist", index);
                }
                _ => {}
            }
        }
        if self.bodies.is_empty() {
            return bad("the tree has no base", 0);
        }
        let moved = |i: usize| self.bodies.iter().filter_map(|b| b.joint.as_ref()).any(|j| j.coordinate == i);
        if let Some(index) = (0..self.coordinates.len()).find(|i| !moved(*i)) {
            return bad("a coordinate has no joint", index);
        }
        let beyond = |c: &Cable| c.arms.iter().any(|(i, _)| *i >= self.coordinates.len());
        if let Some(index) = self.cables.iter().position(beyond) {
            return bad("a cable acts on a coordinate that is not free", index);
        }
        let exists = |(body, shape): &(usize, usize)| self.bodies.get(*body).is_some_and(|b| *shape < b.shapes.len());
        if let Some(index) = self.apart.iter().position(|pair| !pair.iter().all(exists)) {
            return bad("a pair of shapes without contact refers to one that does not exist", index);
        }
        match self.pairs.iter().position(|(a, b)| a == b || (*a).max(*b) >= self.bodies.len()) {
            Some(index) => bad("a pair repeats a body, or refers to one that does not exist", index),
            None => Ok(()),
        }
    }
}
