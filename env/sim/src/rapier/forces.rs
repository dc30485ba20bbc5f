//! The fictitious accelerations of the base's frame, as rapier's gravity and as forces on its bodies.

use super::frames;
use crate::motion::FrameMotion;
use rapier3d::math::Vector;
use rapier3d::prelude::RigidBody;

/// Fictitious accelerations during one step, base axes, rapier's units.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FrameForces {
    /// Gravity less the acceleration of the base's origin.
    pub gravity: Vector,
    /// Angular velocity of the frame, rad/s.
    omega: Vector,
    /// Angular acceleration of the frame, rad/s2.
    alpha: Vector,
}

impl FrameForces {
    pub(crate) fn new(frame: &FrameMotion) -> Self {
        Self {
            gravity: frames::lengths(&frame.gravity),
            omega: frames::vector(&frame.omega),
            alpha: frames::vector(&frame.alpha),
        }
    }

    /// True while the frame rotates: fictitious forces are then more than a uniform acceleration.
    pub(crate) fn turning(&self) -> bool {
        self.omega != Vector::ZERO || self.alpha != Vector::ZERO
    }

    /// Sets the Coriolis, centrifugal and Euler force and torque on `body`; a translating frame needs none.
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
        // Euler's equation I dw/dt = -w x (I w) for w = spin + omega; rapier itself integrates -spin x (I spin).
        let inertia = body.mass_properties().effective_angular_inertia();
        let total = spin + omega;
        let gyroscopic = total.cross(inertia * total) - spin.cross(inertia * spin);
        body.add_torque(inertia * spin.cross(omega) - inertia * alpha - gyroscopic, false);
    }
}
