//! Poses and Jacobians of the hand's bodies, in the frame of the base.
//!
//! A twist is the angular velocity of a body and the linear velocity of its point at a common reference point. The reference point is the
//! centre of mass of the first object, so the unknowns of this object are its twist.

use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};

use crate::model::Model;
use crate::tree::{Joint, JointKind};

/// Angular velocity, rad/s, and linear velocity at the reference point, m/s.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Twist {
    pub angular: Vector3<f64>,
    pub linear: Vector3<f64>,
}

impl Twist {
    /// Velocity of the body's point at `arm` from the reference point.
    #[inline]
    pub fn at(&self, arm: &Vector3<f64>) -> Vector3<f64> {
        self.linear + self.angular.cross(arm)
    }

    #[inline]
    pub fn add_scaled(&mut self, other: &Twist, factor: f64) {
        self.angular += other.angular * factor;
        self.linear += other.linear * factor;
    }
}

impl std::ops::Sub for Twist {
    type Output = Twist;

    #[inline]
    fn sub(self, other: Twist) -> Twist {
        Twist { angular: self.angular - other.angular, linear: self.linear - other.linear }
    }
}

/// Poses and Jacobians of the tree's bodies.
#[derive(Clone, Default)]
pub(crate) struct Kinematics {
    /// Pose of each body.
    pub pose: Vec<Isometry3<f64>>,
    /// Its rotation as a matrix.
    pub turn: Vec<Matrix3<f64>>,
    /// Axis of its joint.
    pub axis: Vec<Vector3<f64>>,
    /// A point on that axis.
    pub origin: Vec<Vector3<f64>>,
    /// Jacobian columns: twist per unit rate of each coordinate in the body's range of columns.
    pub jacobian: Vec<Twist>,
    /// Index of each body's first column in `jacobian`.
    pub first: Vec<usize>,
    /// Twist of each body from the driven coordinates.
    pub prescribed: Vec<Twist>,
    /// Number of the last bodies that are left out: they touch nothing.
    pub idle: usize,
}

impl Kinematics {
    /// Computes the poses at coordinates `q` (the driven ones last).
    pub fn place(&mut self, model: &Model, q: &[f64]) {
        self.pose.clear();
        self.turn.clear();
        self.axis.clear();
        self.origin.clear();
        let bodies = &model.tree.bodies;
        for body in &bodies[..bodies.len() - self.idle.min(bodies.len())] {
            let Some(joint) = &body.joint else {
                self.pose.push(Isometry3::identity());
                self.turn.push(Matrix3::identity());
                self.axis.push(Vector3::zeros());
                self.origin.push(Vector3::zeros());
                continue;
            };
            let frame = self.pose[body.parent] * joint.parent_from_joint;
            let pose = frame * motion(joint, q[joint.coordinate]);
            self.axis.push(frame.rotation * joint.axis.into_inner());
            self.origin.push(frame.translation.vector);
            self.turn.push(pose.rotation.to_rotation_matrix().into_inner());
            self.pose.push(pose);
        }
    }

    /// Computes the Jacobians at `reference`, and the twists due to the `rates` of the driven coordinates.
    pub fn differentiate(&mut self, model: &Model, reference: &Vector3<f64>, rates: &[f64]) {
        let free = model.tree.coordinates.len();
        self.jacobian.clear();
        self.first.clear();
        self.prescribed.clear();
        for (index, body) in model.tree.bodies.iter().enumerate().take(self.pose.len()) {
            let columns = &model.columns[index];
            let start = self.jacobian.len();
            self.first.push(start);
            let Some(joint) = &body.joint else {
                self.prescribed.push(Twist::default());
                continue;
            };
            self.jacobian.resize(start + columns.len(), Twist::default());
            let above = &model.columns[body.parent];
            let from = self.first[body.parent];
            if !above.is_empty() {
                let to = start + above.start - columns.start;
                self.jacobian.copy_within(from..from + above.len(), to);
            }
            let own = self.joint_twist(index, joint, reference);
            let mut prescribed = self.prescribed[body.parent];
            if joint.coordinate >= free {
                prescribed.add_scaled(&own, rates[joint.coordinate - free]);
            } else {
                self.jacobian[start + joint.coordinate - columns.start].add_scaled(&own, 1.0);
            }
            self.prescribed.push(prescribed);
        }
    }

    /// Twist of a body per unit rate of its joint's coordinate.
    fn joint_twist(&self, body: usize, joint: &Joint, reference: &Vector3<f64>) -> Twist {
        let axis = self.axis[body] * joint.ratio;
        match joint.kind {
            JointKind::Revolute => Twist { angular: axis, linear: axis.cross(&(reference - self.origin[body])) },
            JointKind::Prismatic => Twist { angular: Vector3::zeros(), linear: axis },
        }
    }

    /// Jacobian columns of a body.
    #[inline]
    pub fn columns<'a>(&'a self, model: &Model, body: usize) -> &'a [Twist] {
        &self.jacobian[self.first[body]..self.first[body] + model.columns[body].len()]
    }

    /// Twist of a body at the given velocities of the free coordinates.
    #[inline]
    pub fn twist(&self, model: &Model, body: usize, velocity: &[f64]) -> Twist {
        let mut twist = self.prescribed[body];
        let columns = &model.columns[body];
        for (column, v) in self.columns(model, body).iter().zip(&velocity[columns.clone()]) {
            twist.add_scaled(column, *v);
        }
        twist
    }
}

/// Motion of a joint at a value of its coordinate.
fn motion(joint: &Joint, coordinate: f64) -> Isometry3<f64> {
    let position = joint.ratio * coordinate + joint.offset;
    match joint.kind {
        JointKind::Revolute => {
            Isometry3::from_parts(Translation3::identity(), UnitQuaternion::from_axis_angle(&joint.axis, position))
        }
        JointKind::Prismatic => {
            Isometry3::from_parts(Translation3::from(joint.axis.into_inner() * position), UnitQuaternion::identity())
        }
    }
}
