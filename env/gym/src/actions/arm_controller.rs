//! Motion of the hand towards its goal within limits of speed and acceleration.
//!
//! A jump of velocity would accelerate a held object by hundreds of m/s2. A goal pose is approached along a line within one control period, with
//! the speed of that line as feedforward, so a smoothly moving goal is followed without lag.

use crate::actions::guard::{Brake, Guard, ProtectiveStop, TABLE_CLEARANCE};
use graspbox_mesh::range::{OutOfRange, all_within, is_pose};
use graspbox_sim::HandLoad;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// Greatest speed of the grasp frame, m/s: that of a fast arm.
pub const LINEAR_SPEED: f64 = 0.5;
/// Greatest acceleration of the grasp frame, m/s2.
pub const LINEAR_ACCELERATION: f64 = 5.0;
/// Greatest angular speed, rad/s.
pub const ANGULAR_SPEED: f64 = 2.0;
/// Greatest angular acceleration, rad/s2.
pub const ANGULAR_ACCELERATION: f64 = 20.0;
/// Speed towards a goal per distance, 1/s, unless braking requires less.
const GAIN: f64 = 20.0;
/// Greatest distance of the reference of `delta_pose` from the hand, metres and radians: two steps at full speed.
const LEASH: [f64; 2] = [0.05, 0.2];

/// The command of one control period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Goal {
    /// A velocity in the hand's axes, m/s and rad/s.
    Twist(Vector3<f64>, Vector3<f64>),
    /// A velocity in the world's axes, m/s and rad/s.
    WorldTwist(Vector3<f64>, Vector3<f64>),
    /// A displacement from the last reference, in the hand's axes.
    Delta(Isometry3<f64>),
    /// A pose of the hand in the world.
    Pose(Isometry3<f64>),
}

/// The motion of the hand in one control period.
#[derive(Clone, Copy, Debug)]
pub enum Motion {
    /// A velocity in the hand's axes, m/s and rad/s.
    Twist(Vector3<f64>, Vector3<f64>),
    /// A velocity in the world's axes, m/s and rad/s.
    WorldTwist(Vector3<f64>, Vector3<f64>),
    /// From one reference pose to another.
    Track {
        from: Isometry3<f64>,
        to: Isometry3<f64>,
        /// Seconds that the way takes.
        period: f64,
    },
}

/// The controller of the arm, with its estimate of the hand's pose.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ArmController {
    /// Estimated pose of the hand.
    pose: Isometry3<f64>,
    /// Linear velocity, world axes, m/s.
    linear: Vector3<f64>,
    /// Angular velocity, world axes, rad/s.
    angular: Vector3<f64>,
    /// The last goal pose.
    reference: Isometry3<f64>,
    /// The true hand in the estimated one: a calibration error.
    error: Isometry3<f64>,
    pub stop: ProtectiveStop,
}

impl ArmController {
    /// A hand at rest at `world_from_hand`; `error` is its pose in the estimated one.
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

    /// Refuses states that no arm can have.
    ///
    /// # Errors
    /// [`OutOfRange`], naming the first number.
    pub(crate) fn check(&self) -> Result<(), OutOfRange> {
        /// Farther than any arm reaches, metres.
        const FARTHEST: f64 = 1e3;
        /// Far above its limits of speed, which the protective stop and the table may exceed, m/s and rad/s.
        const FASTEST: f64 = 1e3;
        for (field, pose) in [("arm.pose", &self.pose), ("arm.reference", &self.reference), ("arm.error", &self.error)]
        {
            is_pose(field, pose, FARTHEST)?;
        }
        all_within("arm.linear", self.linear.iter().copied(), FASTEST, "m/s")?;
        all_within("arm.angular", self.angular.iter().copied(), FASTEST, "rad/s")?;
        self.stop.check()
    }

    /// Moves the hand at once to the estimated pose `pose`. Returns its true pose in the world.
    pub fn teleport(&mut self, pose: &Isometry3<f64>) -> Isometry3<f64> {
        self.pose = *pose;
        self.reference = *pose;
        pose * self.error
    }

    /// Resets the controller to a hand moved externally to `world_from_hand`.
    pub fn sync(&mut self, world_from_hand: &Isometry3<f64>) {
        *self = Self::new(world_from_hand, &self.error);
    }

    /// Estimated pose of the hand in the world.
    pub fn estimated_pose(&self) -> &Isometry3<f64> {
        &self.pose
    }

    /// True pose of the hand in the world.
    pub fn world_from_hand(&self) -> Isometry3<f64> {
        self.pose * self.error
    }

    /// Estimated linear (m/s) and angular (rad/s) velocity, hand axes.
    pub fn velocity(&self) -> (Vector3<f64>, Vector3<f64>) {
        let turn = self.pose.rotation.inverse();
        (turn * self.linear, turn * self.angular)
    }

    /// Sets the goal of the next control period of `period` seconds.
    pub fn begin(&mut self, goal: &Goal, period: f64) -> Motion {
        match goal {
            Goal::Twist(linear, angular) => {
                self.reference = self.pose;
                Motion::Twist(*linear, *angular)
            }
            Goal::WorldTwist(linear, angular) => {
                self.reference = self.pose;
                Motion::WorldTwist(*linear, *angular)
            }
            Goal::Delta(step) => {
                let from = self.limited_reference();
                let to = Isometry3::from_parts(
                    Translation3::from(from.translation.vector + from.rotation * step.translation.vector),
                    from.rotation * step.rotation,
                );
                self.reference = to;
                Motion::Track { from, to, period }
            }
            Goal::Pose(to) => {
                let from = self.limited_reference();
                self.reference = *to;
                Motion::Track { from, to: *to, period }
            }
        }
    }

    /// The reference, limited to [`LEASH`] from the hand.
    fn limited_reference(&self) -> Isometry3<f64> {
        let ahead = self.reference.translation.vector - self.pose.translation.vector;
        let turn = (self.reference.rotation * self.pose.rotation.inverse()).scaled_axis();
        let turn = UnitQuaternion::from_scaled_axis(capped(&turn, LEASH[1]));
        Isometry3::from_parts(
            Translation3::from(self.pose.translation.vector + capped(&ahead, LEASH[0])),
            turn * self.pose.rotation,
        )
    }

    /// Advances by one time step of `dt` seconds, at `time` seconds after the control period began. Returns the true pose of the hand.
    ///
    /// * `load`: contact load on the hand in the last step.
    pub fn advance(&mut self, motion: &Motion, time: f64, dt: f64, guard: &Guard, load: &HandLoad) -> Isometry3<f64> {
        let truth = self.world_from_hand();
        let (linear, angular) = self.wanted(motion, time, dt);
        self.stop.feel(load, &truth, (&linear, &angular), dt);
        self.linear += capped(&(linear - self.linear), LINEAR_ACCELERATION * dt);
        self.angular += capped(&(angular - self.angular), ANGULAR_ACCELERATION * dt);
        self.stop.limit(&mut self.linear, &mut self.angular, dt);
        let brake = Brake { deceleration: LINEAR_ACCELERATION, dt };
        // The limits hold for the true hand, which a rotation moves more than the estimated one.
        let lever = self.angular.cross(&(self.pose.rotation * self.error.translation.vector));
        let mut linear = self.linear + lever;
        guard.limit(&truth, &mut linear, &self.angular, &brake);
        self.linear = linear - lever;
        self.pose = Isometry3::from_parts(
            Translation3::from(self.pose.translation.vector + self.linear * dt),
            turned(&self.pose.rotation, &(self.angular * dt)),
        );
        // Corrects the error of the linearized limit: fractions of a micrometre.
        let sunk = TABLE_CLEARANCE - guard.lowest(&self.world_from_hand());
        if sunk > 0.0 {
            self.pose.translation.vector.z += sunk;
        }
        self.world_from_hand()
    }

    fn wanted(&self, motion: &Motion, time: f64, dt: f64) -> (Vector3<f64>, Vector3<f64>) {
        let (linear, angular) = match motion {
            Motion::Twist(linear, angular) => (self.pose.rotation * linear, self.pose.rotation * angular),
            Motion::WorldTwist(linear, angular) => (*linear, *angular),
            Motion::Track { from, to, period } => {
                let share = ((time + dt) / period).min(1.0);
                let path = to.translation.vector - from.translation.vector;
                let turn = (to.rotation * from.rotation.inverse()).scaled_axis();
                let ahead = from.translation.vector + path * share - self.pose.translation.vector;
                let facing = UnitQuaternion::from_scaled_axis(turn * share) * from.rotation;
                let astray = (facing * self.pose.rotation.inverse()).scaled_axis();
                let linear_brake = Brake { deceleration: LINEAR_ACCELERATION, dt };
                let angular_brake = Brake { deceleration: ANGULAR_ACCELERATION, dt };
                (
                    capped(&(path / *period), LINEAR_SPEED) + approach(&ahead, &linear_brake),
                    capped(&(turn / *period), ANGULAR_SPEED) + approach(&astray, &angular_brake),
                )
            }
        };
        (capped(&linear, LINEAR_SPEED), capped(&angular, ANGULAR_SPEED))
    }
}

/// Velocity towards a goal at `distance`: proportional, but never faster than braking allows.
fn approach(distance: &Vector3<f64>, brake: &Brake) -> Vector3<f64> {
    let length = distance.norm();
    if length == 0.0 {
        return Vector3::zeros();
    }
    distance * (brake.speed(length).min(GAIN * length) / length)
}

/// `vector`, limited to `length`.
pub(crate) fn capped(vector: &Vector3<f64>, length: f64) -> Vector3<f64> {
    let norm = vector.norm();
    if norm > length { vector * (length / norm) } else { *vector }
}

/// `rotation` rotated by `turn` (world axes), normalized.
fn turned(rotation: &UnitQuaternion<f64>, turn: &Vector3<f64>) -> UnitQuaternion<f64> {
    if *turn == Vector3::zeros() {
        return *rotation;
    }
    UnitQuaternion::new_normalize((UnitQuaternion::from_scaled_axis(*turn) * rotation).into_inner())
}
