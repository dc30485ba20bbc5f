//! What can be read off a world: poses, velocities, fingers, motors, and whether it went wrong.

use super::World;
use crate::scenery::{GROUND_SIDE, TABLE_HEIGHT};
use graspbox_hand::{Hand, MotorState};
use nalgebra::{Isometry3, Point3, Vector3};
use std::sync::Arc;

/// One finger as an outside observer knows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FingerState {
    /// Proximal angle, rad.
    pub proximal: f64,
    /// Distal angle, rad.
    pub distal: f64,
    /// Proximal speed, rad/s.
    pub proximal_speed: f64,
    /// Distal speed, rad/s.
    pub distal_speed: f64,
    /// Spool angle, rad.
    pub spool: f64,
    /// Tendon tension, N.
    pub tension: f64,
}

/// No object rises higher than this above the table, metres: an arm's reach over the highest lift.
const HIGHEST: f64 = 3.0;
/// No object moves faster than this in the hand's frame, m/s: a fall from [`HIGHEST`], seen from the fastest lift (19 m/s).
const FASTEST: f64 = 30.0;
/// No finger's joint is bent further beyond its stop than this, radians.
const BEYOND_STOP: f64 = 1.0;

impl World {
    /// Seconds since the world was spawned.
    pub fn time(&self) -> f64 {
        self.state.steps as f64 * self.shared.config.dt
    }

    /// Seconds per step.
    pub fn dt(&self) -> f64 {
        self.shared.config.dt
    }

    /// The hand in this world.
    pub fn hand(&self) -> &Arc<Hand> {
        &self.shared.hand
    }

    /// Mass of the object, kg.
    pub fn object_mass(&self) -> f64 {
        self.shared.mass
    }

    /// Grasp frame in the world.
    pub fn world_from_hand(&self) -> Isometry3<f64> {
        self.state.motion.world_from_base * self.shared.hand.base_from_hand
    }

    /// Object in the world.
    pub fn world_from_object(&self) -> Isometry3<f64> {
        self.state.motion.world_from_base * self.engine.base_from_object()
    }

    /// Object in the grasp frame.
    pub fn hand_from_object(&self) -> Isometry3<f64> {
        self.shared.hand.base_from_hand.inverse() * self.engine.base_from_object()
    }

    /// Centre of mass of the object in the world, metres.
    pub fn object_center(&self) -> Point3<f64> {
        self.world_from_object() * Point3::from(self.shared.object_from_center)
    }

    /// Linear (m/s, of the centre of mass) and angular (rad/s) velocity of the object in the moving hand frame.
    pub fn object_velocity_in_hand(&self) -> (Vector3<f64>, Vector3<f64>) {
        let hand_from_base = self.shared.hand.base_from_hand.rotation.inverse();
        let (linear, angular) = self.engine.object_velocity();
        (hand_from_base * linear, hand_from_base * angular)
    }

    /// State of every motor, in the order of the hand's motors.
    pub fn motors(&self) -> &[MotorState] {
        &self.state.motors
    }

    /// State of finger `finger`.
    pub fn finger(&self, finger: usize) -> FingerState {
        let description = &self.shared.hand.fingers[finger];
        let (proximal, distal) = (self.engine.joint(description.proximal), self.engine.joint(description.distal));
        FingerState {
            proximal: proximal.angle,
            distal: distal.angle,
            proximal_speed: proximal.speed,
            distal_speed: distal.speed,
            spool: self.state.motors[description.motor].position,
            tension: self.engine.tension(finger),
        }
    }

    /// Angle of the preshape motor, rad.
    pub fn preshape(&self) -> f64 {
        self.shared.hand.preshape_motor().map_or(0.0, |motor| self.state.motors[motor].position)
    }

    /// True once the simulation went wrong: a number that is not finite, or a motion that no table-top scene can have.
    ///
    /// The bounds leave ample room: the object's centre of mass falls no deeper than the ground under the table, rises no higher than
    /// `HIGHEST`, leaves the table's middle by no more than half the ground, moves slower than `FASTEST` in the hand's frame, and
    /// no finger's joint is further beyond its stop than `BEYOND_STOP`.
    pub fn has_diverged(&self) -> bool {
        let center = self.object_center();
        let away = center.coords.xy().norm() > GROUND_SIDE / 2.0 || !(-TABLE_HEIGHT..=HIGHEST).contains(&center.z);
        let fast = self.object_velocity_in_hand().0.norm() > FASTEST;
        let hand = &self.shared.hand;
        let bent = |index: usize| {
            let (finger, state) = (&hand.fingers[index], self.finger(index));
            [(finger.proximal, state.proximal), (finger.distal, state.distal)].into_iter().any(|(joint, angle)| {
                let [lower, upper] = hand.joints[joint].limits;
                !(lower - BEYOND_STOP..=upper + BEYOND_STOP).contains(&angle)
            })
        };
        !self.is_finite() || away || fast || (0..hand.fingers.len()).any(bent)
    }

    /// False once anything in the world is no longer a finite number.
    pub fn is_finite(&self) -> bool {
        self.engine.is_finite()
    }

    /// Steps since the world was spawned in which the engine's solver stopped before it converged; rapier does not measure it (0).
    pub fn unconverged_steps(&self) -> u64 {
        self.engine.unconverged_steps()
    }
}
