//! Motion of the hand towards its goal within limits of speed and acceleration.
//!
//! A jump of velocity would accelerate a held object by hundreds of m/s2. A goal pose is approached along a line within one control period, with
//! the speed of that line as feedforward, so a smoothly moving goal is followed without lag.

use crate::actions::guard::{Brake, Guard, ProtectiveStop, TABLE_CLEARANCE};
use crate::actions::joint_drive::JointDrive;
use crate::robot_arm::{ArmSpec, RobotArm};
use graspbox_arm::AxesState;
use graspbox_arm::chain::{Frames, MAX_AXES, Positions};
use graspbox_arm::room::way::Hung;
use graspbox_mesh::range::{OutOfRange, all_within, is_pose};
use graspbox_sim::{HandLoad, World};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
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
/// Greatest accelerations of the grasp frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// m/s2.
    pub linear: f64,
    /// rad/s2.
    pub angular: f64,
}

/// Those of a hand without an arm.
pub const FREE: Limits = Limits { linear: LINEAR_ACCELERATION, angular: ANGULAR_ACCELERATION };

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
    /// Speeds of the arm's joints, as shares of the greatest.
    Joints(Positions),
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
    /// Speeds of the arm's joints, as shares of the greatest.
    Joints(Positions),
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
    /// The joints of the arm that carries the hand; `None` for a hand that moves freely.
    drive: Option<Box<JointDrive>>,
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
            drive: None,
        }
    }

    /// The same on an arm whose joints are at `positions`.
    #[must_use]
    pub fn on_arm(self, positions: &Positions) -> Self {
        Self { drive: Some(Box::new(JointDrive::new(positions))), ..self }
    }

    /// Positions of the joints of the arm; `None` without one.
    pub fn positions(&self) -> Option<&Positions> {
        self.drive.as_ref().map(|drive| &drive.axes().positions)
    }

    /// Positions and speeds of the joints of the arm; empty without one.
    pub fn joints(&self) -> (&[f64], &[f64]) {
        self.drive.as_ref().map_or((&[], &[]), |drive| (&drive.axes().positions, &drive.axes().rates))
    }

    /// True if the links of the arm are far from all objects; without an arm, too.
    pub(crate) fn links_are_far(&self) -> bool {
        self.drive.as_ref().is_none_or(|drive| drive.is_far())
    }

    /// True if something in the way, or a force on its links, stopped the arm since [`ArmController::unblock`].
    pub fn blocked(&self) -> bool {
        self.drive.as_ref().is_some_and(|drive| drive.blocked)
    }

    pub fn unblock(&mut self) {
        self.drive.iter_mut().for_each(|drive| drive.blocked = false);
    }

    /// True if the hand is where the arm's joints put it; without an arm, if there are no joints.
    pub(crate) fn fits(&self, arm: Option<&ArmSpec>) -> bool {
        /// Rounding, metres and radians.
        const NEAR: f64 = 1e-6;
        let (Some(drive), Some(arm)) = (&self.drive, arm) else { return self.drive.is_none() && arm.is_none() };
        let apart = arm.robot.world_from_hand(&drive.axes().positions).inv_mul(&self.pose);
        apart.translation.vector.norm() < NEAR && apart.rotation.angle() < NEAR
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
        self.drive.as_ref().map_or(Ok(()), |drive| drive.check())?;
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

    /// Puts the arm at rest at `positions`, and the hand where they put it.
    pub fn rest_at(&mut self, positions: &Positions, robot: &RobotArm) {
        *self = Self::new(&(robot.world_from_hand(positions) * self.error), &self.error).on_arm(positions);
    }

    /// Goes back to what it was, but keeps the distances that were measured since.
    pub fn undo(&mut self, mut before: Self) {
        if let (Some(drive), Some(own)) = (&mut before.drive, &mut self.drive) {
            drive.take_measured(own);
        }
        *self = before;
    }

    /// Notes that the arm found no path.
    pub fn block(&mut self) {
        self.drive.iter_mut().for_each(|drive| drive.blocked = true);
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
            Goal::Joints(shares) => {
                self.reference = self.pose;
                Motion::Joints(*shares)
            }
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
        let (linear, angular) = self.wanted(motion, time, dt, &FREE);
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
        let hand = self.world_from_hand();
        if guard.at_least(&hand) >= TABLE_CLEARANCE {
            return hand;
        }
        // Corrects the error of the linearized limit: fractions of a micrometre.
        let sunk = TABLE_CLEARANCE - guard.lowest(&hand);
        if sunk > 0.0 {
            self.pose.translation.vector.z += sunk;
        }
        self.world_from_hand()
    }

    /// As [`ArmController::advance`] for a hand on an arm, by `ticks` time steps: the posture changes, and the pose of the hand follows from it.
    ///
    /// * `ticks`: as many as [`ArmController::coasts`] allows; 1 with a load.
    /// * `most`: time steps of a control period.
    /// * `world`: before these steps.
    pub fn follow(
        &mut self,
        arm: &ArmSpec,
        (motion, time): (&Motion, f64),
        (guard, load, world, most): (&Guard, &HandLoad, &World, u32),
        ticks: u32,
    ) -> Isometry3<f64> {
        let (dt, truth) = (world.dt(), self.world_from_hand());
        let Some(mut drive) = self.drive.take() else { return truth };
        drive.feel(world, arm, f64::from(ticks) * dt);
        let begins = drive.begins_period(dt, most);
        if begins {
            drive.look_around(world, arm);
            let rates = self.rates(&mut drive, arm, motion, time, dt, guard);
            let (robot, error) = (&arm.robot, &self.error);
            let height =
                |frames: &Frames| guard.lowest(&(robot.world_from_hand_at(frames) * error)) - 0.5 * TABLE_CLEARANCE;
            let center = Point3::from((robot.flange_from_hand * error).translation.vector);
            drive.decide(arm, rates, dt, &Hung { height: &height, center, radius: guard.reach() });
        }
        for _ in 0..ticks {
            self.stop.feel(load, &truth, (&drive.wanted.0, &drive.wanted.1), dt);
        }
        // The velocity is that of the last time step.
        let before = if ticks > 1 { drive.advance(arm, dt, ticks - 1) } else { self.pose };
        let pose = drive.advance(arm, dt, 1);
        self.linear = (pose.translation.vector - before.translation.vector) / dt;
        self.angular = (pose.rotation * before.rotation.inverse()).scaled_axis() / dt;
        self.pose = pose;
        self.drive = Some(drive);
        self.world_from_hand()
    }

    /// True if nothing that the next `ticks` time steps bring changes the motion of a hand that touches nothing.
    pub fn coasts(&self, ticks: u32) -> bool {
        !self.stop.active && self.drive.as_ref().is_none_or(|drive| drive.fits(ticks) && !drive.is_pressed())
    }

    /// Rates of the joints for a motion, before their own limits.
    fn rates(
        &self,
        drive: &mut JointDrive,
        arm: &ArmSpec,
        motion: &Motion,
        time: f64,
        dt: f64,
        guard: &Guard,
    ) -> Positions {
        let (follower, to_base) = (&arm.follower, arm.robot.world_from_base.rotation.inverse());
        let frames = drive.frames(arm);
        let point = (frames.flange.isometry() * arm.robot.flange_from_hand).translation.vector;
        let period = drive.period(dt);
        if let Motion::Joints(shares) = motion {
            let mut rates = [0.0; MAX_AXES];
            (0..follower.chain().len()).for_each(|axis| rates[axis] = shares[axis] * follower.speed(axis));
            let (linear, angular) = follower.twist(&frames, &point, &rates);
            let wanted = (to_base.inverse() * linear, to_base.inverse() * angular);
            drive.wanted = wanted;
            let (mut linear, mut angular) = wanted;
            self.stop.limit(&mut linear, &mut angular, period);
            let (less, turn) = (to_base * (linear - wanted.0), to_base * (angular - wanted.1));
            if self.stop.active {
                let still = AxesState { rates: [0.0; MAX_AXES], ..*drive.axes() };
                let change = follower.rates(&still, &frames, &point, (&less, &turn), period);
                rates.iter_mut().zip(change).for_each(|(rate, change)| *rate += change);
            }
            return rates;
        }
        let wanted = self.wanted(motion, time, period, &arm.limits);
        drive.wanted = wanted;
        let mut linear = self.linear + capped(&(wanted.0 - self.linear), arm.limits.linear * period);
        let mut angular = self.angular + capped(&(wanted.1 - self.angular), arm.limits.angular * period);
        self.stop.limit(&mut linear, &mut angular, period);
        let lever = angular.cross(&(self.pose.rotation * self.error.translation.vector));
        linear += lever;
        let brake = Brake { deceleration: arm.limits.linear, dt: period };
        guard.limit(&self.world_from_hand(), &mut linear, &angular, &brake);
        linear -= lever;
        follower.rates(drive.axes(), &frames, &point, (&(to_base * linear), &(to_base * angular)), period)
    }

    fn wanted(&self, motion: &Motion, time: f64, dt: f64, limits: &Limits) -> (Vector3<f64>, Vector3<f64>) {
        let (linear, angular) = match motion {
            Motion::Twist(linear, angular) => (self.pose.rotation * linear, self.pose.rotation * angular),
            Motion::WorldTwist(linear, angular) => (*linear, *angular),
            Motion::Joints(_) => (Vector3::zeros(), Vector3::zeros()),
            Motion::Track { from, to, period } => {
                let share = ((time + dt) / period).min(1.0);
                let path = to.translation.vector - from.translation.vector;
                let turn = (to.rotation * from.rotation.inverse()).scaled_axis();
                let ahead = from.translation.vector + path * share - self.pose.translation.vector;
                let facing = UnitQuaternion::from_scaled_axis(turn * share) * from.rotation;
                let astray = (facing * self.pose.rotation.inverse()).scaled_axis();
                let linear_brake = Brake { deceleration: limits.linear, dt };
                let angular_brake = Brake { deceleration: limits.angular, dt };
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
