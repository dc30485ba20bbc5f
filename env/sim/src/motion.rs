//! The moving frame: pose and velocity of the hand's base, and the fictitious accelerations in its frame.

pub(crate) use graspbox_solver::FrameMotion;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Rotations within one step below this count as none, radians: far above rounding, far below any motion.
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

    /// Moves to `target` within `dt` seconds (`gravity` in world axes). Returns the motion of the frame, with which bodies are simulated in it.
    pub(crate) fn advance(&mut self, target: Isometry3<f64>, dt: f64, gravity: &Vector3<f64>) -> FrameMotion {
        let linear = (target.translation.vector - self.world_from_base.translation.vector) / dt;
        let turn: UnitQuaternion<f64> = target.rotation * self.world_from_base.rotation.inverse();
        // Rounding turns no rotation into about 1e-16 rad; a frame that only translates needs no further forces.
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
