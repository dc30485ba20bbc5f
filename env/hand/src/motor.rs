//! Motors: position, velocity and force commands, and the resulting angle of the spool.
//!
//! Positions and speeds are on the joint's side of the gear: at the spool, or at the swivel. The gear is self-locking: without a
//! command to move, or with a load at its limit, the spool does not move.

use serde::{Deserialize, Serialize};

use crate::error::HandError;
use crate::model::{Hand, Motor};

/// A command to one motor, as the real driver offers them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum MotorCommand {
    /// Go to a position and stay there.
    Position {
        /// Target, radians; clipped to the travel.
        target: f64,
        /// Speed, rad/s; clipped to the maximum speed. `None`: the default speed.
        speed: Option<f64>,
    },
    /// Turn with this speed until the travel ends, rad/s; positive closes; clipped to the maximum speed.
    Velocity(f64),
    /// Pull with this load and hold it: N at a tendon, N m at the preshape; clipped to `[0, load_limit]`.
    Force(f64),
}

/// Why a commanded motor does not move.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Hold {
    /// It moves, or has arrived.
    Free,
    /// The load is at its limit.
    Load,
    /// It is at the end of its travel.
    Travel,
}

/// State of one motor; part of a snapshot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotorState {
    /// Angle of the spool (or swivel), radians.
    pub position: f64,
    /// Its mean speed over the last step, rad/s.
    pub velocity: f64,
    /// Load at the last step: N at a tendon, N m at the preshape.
    pub load: f64,
    /// Why it does not move.
    pub hold: Hold,
}

impl MotorState {
    /// A motor at rest.
    ///
    /// * `position`: radians, clipped to the travel.
    #[must_use]
    pub fn new(motor: &Motor, position: f64) -> Self {
        let position = position.max(motor.travel[0]).min(motor.travel[1]);
        Self { position, velocity: 0.0, load: 0.0, hold: Hold::Free }
    }

    /// Moves the motor through one step; returns the spool's angle, radians.
    ///
    /// Speeds are reached at once: the rotor's inertia is part of the joints' `armature`. A load at its limit stops closing but never
    /// opening; when it falls, the command resumes.
    ///
    /// * `load`: tension of the tendon now, N (torque on the swivel, N m, for the preshape).
    /// * `dt`: seconds, greater than 0.
    ///
    /// # Errors
    /// [`HandError::NotFinite`] for a command or load that is NaN or infinite, [`HandError::TimeStep`] for a step
    /// that is not greater than 0; the state does not change.
    pub fn step(&mut self, motor: &Motor, command: MotorCommand, load: f64, dt: f64) -> Result<f64, HandError> {
        check(command, load, dt)?;
        let [lower, upper] = motor.travel;
        let mut speed = wanted_speed(motor, command, self.position, load, dt);
        self.hold = Hold::Free;
        if speed > 0.0 && load >= motor.load_limit {
            (speed, self.hold) = (0.0, Hold::Load);
        }
        let wanted = self.position + speed * dt;
        let next = wanted.max(lower).min(upper);
        // Not for a position command: its target is inside the travel, and a rounding error is not a stop.
        if next != wanted && !matches!(command, MotorCommand::Position { .. }) {
            self.hold = Hold::Travel;
        }
        self.velocity = (next - self.position) / dt;
        self.load = load;
        self.position = next;
        Ok(next)
    }
}

fn check(command: MotorCommand, load: f64, dt: f64) -> Result<(), HandError> {
    let numbers = match command {
        MotorCommand::Position { target, speed } => [target, speed.unwrap_or(0.0), load],
        MotorCommand::Velocity(value) | MotorCommand::Force(value) => [value, 0.0, load],
    };
    if let Some(&value) = numbers.iter().find(|x| !x.is_finite()) {
        return Err(HandError::NotFinite { what: "motor command or load", value });
    }
    if !(dt.is_finite() && dt > 0.0) {
        return Err(HandError::TimeStep(dt));
    }
    Ok(())
}

/// Commanded speed, before limits and stops.
fn wanted_speed(motor: &Motor, command: MotorCommand, position: f64, load: f64, dt: f64) -> f64 {
    match command {
        MotorCommand::Position { target, speed } => {
            let speed = speed.unwrap_or(motor.default_speed).abs().min(motor.max_speed);
            let target = target.max(motor.travel[0]).min(motor.travel[1]);
            ((target - position) / dt).clamp(-speed, speed)
        }
        MotorCommand::Velocity(speed) => speed.clamp(-motor.max_speed, motor.max_speed),
        MotorCommand::Force(force) => {
            let error = force.clamp(0.0, motor.load_limit) - load;
            (motor.force_gain * error).clamp(-motor.default_speed, motor.default_speed)
        }
    }
}

impl Hand {
    /// Preshape angle for a position of the preshape motor, radians: the motor can travel further than the joint.
    #[must_use]
    pub fn preshape_angle(&self, position: f64) -> f64 {
        position.max(self.preshape_limits[0]).min(self.preshape_limits[1])
    }
}
