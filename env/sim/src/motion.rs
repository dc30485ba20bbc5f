//! The moving frame: where the hand's base is in the world, how it moves, and the accelerations that its frame adds.

use crate::frames;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rapier3d::math::Vector;
use rapier3d::prelude::RigidBody;
use serde::{Deserialize, Serialize};

/// Turns below this within one step are none, radians.
const NO_TURN: f64 = 1e-12;

/// Pose and velocity of the hand's base in the world.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct BaseMotion {
    pub world_from_base: Isometry3<f64>,
    /// Velocity of the base's origin, world axes, m/s.
    pub linear: Vector3<f64>,
    /// Angular velocity, world axes, rad/s.
    pub angular: Vector3<f64>,
}

/// What the frame's motion adds during one step, in the base's axes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FrameForces {
    /// Gravity less the acceleration of the base's origin, m/s2.
    pub gravity: Vector,
    /// Angular velocity of the frame, rad/s.
    omega: Vector,
    /// Angular acceleration of the frame, rad/s2.
    alpha: Vector,
}

impl BaseMotion {
    pub(crate) fn at_rest(world_from_base: Isometry3<f64>) -> Self {
        Self { world_from_base, linear: Vector3::zeros(), angular: Vector3::zeros() }
    }

    /// Moves on to `target` within `dt` seconds; returns what that adds to the bodies in the base's frame.
    pub(crate) fn advance(&mut self, target: Isometry3<f64>, dt: f64, gravity: &Vector3<f64>) -> FrameForces {
        let linear = (target.translation.vector - self.world_from_base.translation.vector) / dt;
        let turn: UnitQuaternion<f64> = target.rotation * self.world_from_base.rotation.inverse();
        // Rounding makes a turn of some 1e-16 rad out of none; a frame that only translates needs no further forces.
        let angular = if turn.angle() < NO_TURN { Vector3::zeros() } else { turn.scaled_axis() / dt };
        let acceleration = (linear - self.linear) / dt;
        let angular_acceleration = (angular - self.angular) / dt;
        let base_from_world = self.world_from_base.rotation.inverse();
        let forces = FrameForces {
            gravity: frames::lengths(&(base_from_world * (gravity - acceleration))),
            omega: frames::vector(&(base_from_world * angular)),
            alpha: frames::vector(&(base_from_world * angular_acceleration)),
        };
        *self = Self { world_from_base: target, linear, angular };
        forces
    }
}

impl FrameForces {
    /// True while the frame turns, so that bodies feel more than a uniform gravity.
    pub(crate) fn turning(&self) -> bool {
        self.omega != Vector::ZERO || self.alpha != Vector::ZERO
    }

    /// Sets the Coriolis, centrifugal and Euler force and torque on `body` (a pure translation needs none).
    pub(crate) fn apply(&self, body: &mut RigidBody) {
        body.reset_forces(false);
        body.reset_torques(false);
        if !self.turning() {
            return;
        }
        let (omega, alpha) = (self.omega, self.alpha);
        let (arm, velocity, spin) = (body.center_of_mass(), body.linvel(), body.angvel());
        let linear = -(2.0 * omega.cross(velocity) + omega.cross(omega.cross(arm)) + alpha.cross(arm));
        body.add_force(linear * body.mass(), false);
        // d/dt (I w_abs) + omega x (I w_abs) = torque, with w_abs = spin + omega; the engine handles spin x (I spin) itself.
        let inertia = body.mass_properties().effective_angular_inertia();
        let total = spin + omega;
        let gyroscopic = total.cross(inertia * total) - spin.cross(inertia * spin);
        body.add_torque(inertia * spin.cross(omega) - inertia * alpha - gyroscopic, false);
    }
}
