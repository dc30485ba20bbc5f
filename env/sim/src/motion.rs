//! The moving frame: where the hand's base is in the world, how it moves, and the accelerations that its frame adds.

pub(crate) use graspbox_solver::FrameMotion;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
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

impl BaseMotion {
    pub(crate) fn at_rest(world_from_base: Isometry3<f64>) -> Self {
        Self { world_from_base, linear: Vector3::zeros(), angular: Vector3::zeros() }
    }

    /// Moves on to `target` within `dt` seconds (`gravity` in world axes); returns the motion as bodies in the base's frame feel it.
    pub(crate) fn advance(&mut self, target: Isometry3<f64>, dt: f64, gravity: &Vector3<f64>) -> FrameMotion {
        let linear = (target.translation.vector - self.world_from_base.translation.vector) / dt;
        let turn: UnitQuaternion<f64> = target.rotation * self.world_from_base.rotation.inverse();
        // Rounding makes a turn of some 1e-16 rad out of none; a frame that only translates needs no further forces.
        let angular = if turn.angle() < NO_TURN { Vector3::zeros() } else { turn.scaled_axis() / dt };
        let acceleration = (linear - self.linear) / dt;
        let angular_acceleration = (angular - self.angular) / dt;
        let base_from_world = self.world_from_base.rotation.inverse();
        let motion = FrameMotion {
            gravity: base_from_world * (gravity - acceleration),
            omega: base_from_world * angular,
            alpha: base_from_world * angular_acceleration,
        };
        *self = Self { world_from_base: target, linear, angular };
        motion
    }
}
