//! Moves the hand towards its goal within limits of speed and acceleration.
//!
//! A jump of velocity would accelerate what the hand holds by hundreds of m/s2. A goal pose is approached along a line in one
//! control period, with the speed of that line fed forward: a goal that moves smoothly is followed without lag.

use crate::control::CONTROL_PERIOD;
use crate::guard::{Brake, Guard, ProtectiveStop, TABLE_CLEARANCE};
use graspbox_sim::HandLoad;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Greatest speed of the grasp frame, m/s: a brisk arm.
pub const LINEAR_SPEED: f64 = 0.5;
/// Greatest acceleration of the grasp frame, m/s2.
pub const LINEAR_ACCELERATION: f64 = 5.0;
/// Greatest angular speed, rad/s.
pub const ANGULAR_SPEED: f64 = 2.0;
/// Greatest angular acceleration, rad/s2.
pub const ANGULAR_ACCELERATION: f64 = 20.0;
/// Speed towards a goal for each metre (radian) of distance, 1/s, as far as braking allows.
const GAIN: f64 = 20.0;
/// The reference of `delta_pose` never runs further ahead of the hand than this, metres and radians: two steps at full speed.
const LEASH: [f64; 2] = [0.05, 0.2];

/// The command of one control period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Goal {
    /// A velocity in the hand's axes, m/s and rad/s.
    Twist(Vector3<f64>, Vector3<f64>),
    /// A step from the last reference, in the hand's axes.
    Delta(Isometry3<f64>),
    /// A pose of the hand in the world.
    Pose(Isometry3<f64>),
}

/// How the hand moves in one control period.
#[derive(Clone, Copy, Debug)]
pub enum Motion {
    /// A velocity in the hand's axes, m/s and rad/s.
    Twist(Vector3<f64>, Vector3<f64>),
    /// From one reference pose to another.
    Track(Isometry3<f64>, Isometry3<f64>),
}

/// The hand as its arm knows it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ArmController {
    /// Where the arm believes the hand is.
    pose: Isometry3<f64>,
    /// World axes, m/s.
    linear: Vector3<f64>,
    /// World axes, rad/s.
    angular: Vector3<f64>,
    /// Where the last goal was.
    reference: Isometry3<f64>,
    /// The true hand in the believed one: an error of calibration.
    error: Isometry3<f64>,
    /// The protective stop.
    pub stop: ProtectiveStop,
}

impl ArmController {
    /// A hand at rest, truly at `world_from_hand`; the arm believes it `error` away.
    pub fn new(world_from_hand: &Isometry3<f64>, error: &Isometry3<f64>) -> Self {
        let pose = world_from_hand * error.inverse();
        Self {
            pose,
            linear: Vector3::zeros(),
            angular: Vector3::zeros(),
            reference: pose,
            error: *error,
            stop: ProtectiveStop::default(),
        }
    }

    /// Moves the hand at once to where the arm believes `pose` is; returns its true pose in the world.
    pub fn teleport(&mut self, pose: &Isometry3<f64>) -> Isometry3<f64> {
        self.pose = *pose;
        self.reference = *pose;
        pose * self.error
    }

    /// Resets the controller to a hand moved externally to `world_from_hand`.
    pub fn sync(&mut self, world_from_hand: &Isometry3<f64>) {
        *self = Self::new(world_from_hand, &self.error);
    }

    /// Where the arm believes the hand is, in the world.
    pub fn believed(&self) -> &Isometry3<f64> {
        &self.pose
    }

    /// Where the hand is, in the world.
    pub fn world_from_hand(&self) -> Isometry3<f64> {
        self.pose * self.error
    }

    /// Linear (m/s) and angular (rad/s) velocity in the hand's axes, as the arm believes.
    pub fn velocity(&self) -> (Vector3<f64>, Vector3<f64>) {
        let turn = self.pose.rotation.inverse();
        (turn * self.linear, turn * self.angular)
    }

    /// Takes a goal for the coming control period.
    pub fn begin(&mut self, goal: &Goal) -> Motion {
        match goal {
            Goal::Twist(linear, angular) => {
                self.reference = self.pose;
                Motion::Twist(*linear, *angular)
            }
            Goal::Delta(step) => {
                let from = self.leashed();
                let to = Isometry3::from_parts(
                    Translation3::from(from.translation.vector + from.rotation * step.translation.vector),
                    from.rotation * step.rotation,
                );
                self.reference = to;
                Motion::Track(from, to)
            }
            Goal::Pose(to) => {
                let from = self.leashed();
                self.reference = *to;
                Motion::Track(from, *to)
            }
        }
    }

    /// The reference, no further from the hand than the leash allows.
    fn leashed(&self) -> Isometry3<f64> {
        let ahead = self.reference.translation.vector - self.pose.translation.vector;
        let turn = (self.reference.rotation * self.pose.rotation.inverse()).scaled_axis();
        let turn = UnitQuaternion::from_scaled_axis(capped(&turn, LEASH[1]));
        Isometry3::from_parts(
            Translation3::from(self.pose.translation.vector + capped(&ahead, LEASH[0])),
            turn * self.pose.rotation,
        )
    }

    /// One time step of `dt` seconds, at `time` seconds after the control period began; returns where the hand is then.
    ///
    /// * `load`: what pressed on the hand in the last step.
    pub fn advance(&mut self, motion: &Motion, time: f64, dt: f64, guard: &Guard, load: &HandLoad) -> Isometry3<f64> {
        let truth = self.world_from_hand();
        let (linear, angular) = self.wanted(motion, time, dt);
        self.stop.feel(load, &truth, (&linear, &angular), dt);
        self.linear += capped(&(linear - self.linear), LINEAR_ACCELERATION * dt);
        self.angular += capped(&(angular - self.angular), ANGULAR_ACCELERATION * dt);
        self.stop.limit(&mut self.linear, &mut self.angular, dt);
        let brake = Brake { deceleration: LINEAR_ACCELERATION, dt };
        // The walls are for the true hand, which a turn moves more than the believed one.
        let lever = self.angular.cross(&(self.pose.rotation * self.error.translation.vector));
        let mut linear = self.linear + lever;
        guard.limit(&truth, &mut linear, &self.angular, &brake);
        self.linear = linear - lever;
        self.pose = Isometry3::from_parts(
            Translation3::from(self.pose.translation.vector + self.linear * dt),
            turned(&self.pose.rotation, &(self.angular * dt)),
        );
        // What the linearised limit leaves: fractions of a micrometre.
        let sunk = TABLE_CLEARANCE - guard.lowest(&self.world_from_hand());
        if sunk > 0.0 {
            self.pose.translation.vector.z += sunk;
        }
        self.world_from_hand()
    }

    fn wanted(&self, motion: &Motion, time: f64, dt: f64) -> (Vector3<f64>, Vector3<f64>) {
        let (linear, angular) = match motion {
            Motion::Twist(linear, angular) => (self.pose.rotation * linear, self.pose.rotation * angular),
            Motion::Track(from, to) => {
                let share = ((time + dt) / CONTROL_PERIOD).min(1.0);
                let path = to.translation.vector - from.translation.vector;
                let turn = (to.rotation * from.rotation.inverse()).scaled_axis();
                let ahead = from.translation.vector + path * share - self.pose.translation.vector;
                let facing = UnitQuaternion::from_scaled_axis(turn * share) * from.rotation;
                let astray = (facing * self.pose.rotation.inverse()).scaled_axis();
                let linear_brake = Brake { deceleration: LINEAR_ACCELERATION, dt };
                let angular_brake = Brake { deceleration: ANGULAR_ACCELERATION, dt };
                (
                    capped(&(path / CONTROL_PERIOD), LINEAR_SPEED) + approach(&ahead, &linear_brake),
                    capped(&(turn / CONTROL_PERIOD), ANGULAR_SPEED) + approach(&astray, &angular_brake),
                )
            }
        };
        (capped(&linear, LINEAR_SPEED), capped(&angular, ANGULAR_SPEED))
    }
}

/// Velocity towards a goal at `distance`: in proportion, but never faster than one can brake.
fn approach(distance: &Vector3<f64>, brake: &Brake) -> Vector3<f64> {
    let length = distance.norm();
    if length == 0.0 {
        return Vector3::zeros();
    }
    distance * (brake.speed(length).min(GAIN * length) / length)
}

/// `vector`, no longer than `length`.
pub(crate) fn capped(vector: &Vector3<f64>, length: f64) -> Vector3<f64> {
    let norm = vector.norm();
    if norm > length { vector * (length / norm) } else { *vector }
}

/// `rotation` turned by `turn` (world axes), of unit length again.
fn turned(rotation: &UnitQuaternion<f64>, turn: &Vector3<f64>) -> UnitQuaternion<f64> {
    if *turn == Vector3::zeros() {
        return *rotation;
    }
    UnitQuaternion::new_normalize((UnitQuaternion::from_scaled_axis(*turn) * rotation).into_inner())
}
