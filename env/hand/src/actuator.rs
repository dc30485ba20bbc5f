//! Actuators: position, velocity and force commands, and the resulting position.
//!
//! Positions and speeds are on the joint's side of the gear: at the spool, or at the joints; positive speeds close the hand. The gear is
//! self-locking: without a command to move, or with a load at its limit, the actuator does not move.

use serde::{Deserialize, Serialize};

use crate::error::HandError;
use crate::model::Actuator;

/// A command to one actuator.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ActuatorCommand {
    /// Go to a position and stay there.
    Position {
        /// Target, rad or m; clipped to the travel.
        target: f64,
        /// Speed, rad/s or m/s; clipped to the maximum speed. `None`: the default speed.
        speed: Option<f64>,
    },
    /// Move with this speed until the travel ends, rad/s or m/s; positive closes; clipped to the maximum speed.
    Velocity(f64),
    /// Close with this load and hold it: N at a tendon, N m or N at joints; clipped to `[0, load_limit]`.
    Force(f64),
}

impl ActuatorCommand {
    /// False for a command that holds NaN or infinity.
    pub fn is_finite(&self) -> bool {
        self.numbers().iter().all(|x| x.is_finite())
    }

    fn numbers(&self) -> [f64; 2] {
        match *self {
            Self::Position { target, speed } => [target, speed.unwrap_or(0.0)],
            Self::Velocity(value) | Self::Force(value) => [value, 0.0],
        }
    }
}

/// Why a commanded actuator does not move.
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

/// State of one actuator; part of a snapshot.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ActuatorState {
    /// Position, rad or m.
    pub position: f64,
    /// Its mean speed over the last step, rad/s or m/s.
    pub velocity: f64,
    /// Load at the last step: N at a tendon, N m or N at joints; 0 where the joints are driven rigidly.
    pub load: f64,
    pub hold: Hold,
}

impl ActuatorState {
    /// An actuator at rest.
    ///
    /// * `position`: rad or m, clipped to the travel.
    #[must_use]
    pub fn new(actuator: &Actuator, position: f64) -> Self {
        let position = position.max(actuator.travel[0]).min(actuator.travel[1]);
        Self { position, velocity: 0.0, load: 0.0, hold: Hold::Free }
    }

    /// Moves the actuator through one step; returns its position, rad or m.
    ///
    /// Speeds are reached at once: the rotor's inertia is part of the joints' `armature`. A load at its limit stops closing but never
    /// opening; when it falls, the command resumes.
    ///
    /// * `load`: its present load: tension of its tendon, N, or force on its joints, N m or N.
    /// * `dt`: seconds, greater than 0.
    ///
    /// # Errors
    /// [`HandError::NotFinite`] for a command or load that is NaN or infinite, [`HandError::TimeStep`] for a step
    /// that is not greater than 0; the state does not change.
    pub fn step(
        &mut self,
        actuator: &Actuator,
        command: ActuatorCommand,
        load: f64,
        dt: f64,
    ) -> Result<f64, HandError> {
        check(command, load, dt)?;
        let [lower, upper] = actuator.travel;
        let mut speed = wanted_speed(actuator, command, self.position, load, dt);
        self.hold = Hold::Free;
        if speed > 0.0 && load >= actuator.load_limit {
            (speed, self.hold) = (0.0, Hold::Load);
        }
        let wanted = self.position + speed * dt;
        let next = wanted.max(lower).min(upper);
        // Not for a position command: its target is inside the travel, and a rounding error is not a stop.
        if next != wanted && !matches!(command, ActuatorCommand::Position { .. }) {
            self.hold = Hold::Travel;
        }
        self.velocity = (next - self.position) / dt;
        self.load = load;
        self.position = next;
        Ok(next)
    }
}

fn check(command: ActuatorCommand, load: f64, dt: f64) -> Result<(), HandError> {
    let [first, second] = command.numbers();
    if let Some(value) = [first, second, load].into_iter().find(|x| !x.is_finite()) {
        return Err(HandError::NotFinite { what: "actuator command or load", value });
    }
    if !(dt.is_finite() && dt > 0.0) {
        return Err(HandError::TimeStep(dt));
    }
    Ok(())
}

/// Commanded speed, before limits and stops.
fn wanted_speed(actuator: &Actuator, command: ActuatorCommand, position: f64, load: f64, dt: f64) -> f64 {
    match command {
        ActuatorCommand::Position { target, speed } => {
            let speed = speed.unwrap_or(actuator.default_speed).abs().min(actuator.max_speed);
            let target = target.max(actuator.travel[0]).min(actuator.travel[1]);
            ((target - position) / dt).clamp(-speed, speed)
        }
        ActuatorCommand::Velocity(speed) => speed.clamp(-actuator.max_speed, actuator.max_speed),
        ActuatorCommand::Force(force) => {
            let error = force.clamp(0.0, actuator.load_limit) - load;
            (actuator.force_gain * error).clamp(-actuator.default_speed, actuator.default_speed)
        }
    }
}
