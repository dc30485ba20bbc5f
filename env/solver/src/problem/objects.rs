//! The objects among the unknowns of a step: their inertia, and their twists and wrenches moved to the reference point.
//!
//! The unknowns of an object are the velocity of its centre of mass and its angular velocity. With the lever `d` from the centre of mass to the
//! reference point, its twist there is
//!
//! ```text
//! linear = v + omega x d,   angular = omega
//! ```
//!
//! and a force `f` with moment `m` about the reference point has the moment `m + d x f` about the centre of mass. The reference point is the
//! centre of mass of the first object, whose lever is `None`: a single object costs no such products.

use nalgebra::{Matrix3, Vector3};

use crate::kinematics::Twist;

/// An object during one step; frame of the base.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ObjectTerms {
    /// kg.
    pub mass: f64,
    /// About the centre of mass, axes of the base, kg m2.
    pub inertia: Matrix3<f64>,
    /// Centre of mass at the beginning of the step.
    pub center: Vector3<f64>,
    /// From the centre of mass to the reference point, metres; `None` if they are the same.
    pub lever: Option<Vector3<f64>>,
    /// Momentum at the end of the step without contacts: linear, then angular.
    pub momentum: [f64; 6],
    /// Velocity at the beginning of the step, and once the step is solved at its end: linear, then angular.
    pub velocity: [f64; 6],
}

impl Default for ObjectTerms {
    fn default() -> Self {
        let (center, inertia) = (Vector3::zeros(), Matrix3::identity());
        Self { mass: 1.0, inertia, center, lever: None, momentum: [0.0; 6], velocity: [0.0; 6] }
    }
}

impl ObjectTerms {
    /// Velocities of the object that moves with a twist at the reference point.
    pub fn velocity_of(&self, twist: &Twist) -> [f64; 6] {
        let mut linear = twist.linear;
        if let Some(lever) = &self.lever {
            linear -= twist.angular.cross(lever);
        }
        let angular = &twist.angular;
        [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z]
    }
}

/// Twist at the centre of mass.
#[inline(always)]
pub(crate) fn own_twist(v: &[f64]) -> Twist {
    Twist { linear: Vector3::new(v[0], v[1], v[2]), angular: Vector3::new(v[3], v[4], v[5]) }
}
