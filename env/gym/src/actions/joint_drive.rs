//! Motion of the hand by the joints of an arm: rates of the axes in short periods, and the postures between.

use crate::robot_arm::{ArmSpec, LINK_CLEARANCE};
use graspbox_arm::AxesState;
use graspbox_arm::chain::{Frames, Positions};
use graspbox_arm::room::way::{Hung, Measured};
use graspbox_episode::approach::{FORCE_TIME, STOP_FORCE};
use graspbox_mesh::range::{OutOfRange, all_within, in_range};
use graspbox_sim::{ARM_IS_FAR, World};
use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};

/// Longest time between two decisions about the rates, seconds.
const PERIOD: f64 = 0.02;
/// Share of [`STOP_FORCE`] below which links that were stopped by a force move on.
const RELAXED: f64 = 0.8;
/// Rate at which links yield to a force of twice [`STOP_FORCE`], rad/s.
const YIELD: f64 = 0.2;

/// The axes of the arm, their next rates, and the force on its links.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointDrive {
    axes: AxesState,
    /// Rates at the end of the period.
    next: Positions,
    /// Time steps until then, and of a whole period.
    left: u32,
    steps: u32,
    /// The velocity (m/s) and angular velocity (rad/s) of the hand that is wanted, world axes.
    pub wanted: (Vector3<f64>, Vector3<f64>),
    /// Filtered sum of the normal forces on the links, N, and rates that yield to them, up to a factor.
    force: f64,
    yielding: Positions,
    /// The force stops the links.
    pressed: bool,
    /// The links are far from all objects in this period.
    far: bool,
    /// Something in the way has stopped the arm since the flag was cleared.
    pub blocked: bool,
    #[serde(skip)]
    known: Known,
}

/// Distances that were measured, of links and of the palm; they save time and change no result, so they are no part of the state.
#[derive(Clone, Debug, Default)]
struct Known {
    distances: Measured,
    /// Frames of the present posture.
    frames: Option<Frames>,
}

impl PartialEq for Known {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl JointDrive {
    /// At rest at positions of the axes.
    pub fn new(positions: &Positions) -> Self {
        let zero = [0.0; graspbox_arm::chain::MAX_AXES];
        Self {
            axes: AxesState { positions: *positions, rates: zero },
            next: zero,
            left: 0,
            steps: 1,
            wanted: (Vector3::zeros(), Vector3::zeros()),
            force: 0.0,
            yielding: zero,
            pressed: false,
            far: false,
            blocked: false,
            known: Known::default(),
        }
    }

    /// Positions (rad or m) and rates of the axes.
    pub fn axes(&self) -> &AxesState {
        &self.axes
    }

    /// Refuses states that no arm can have.
    ///
    /// # Errors
    /// [`OutOfRange`], naming the first number.
    pub(crate) fn check(&self) -> Result<(), OutOfRange> {
        all_within("arm.positions", self.axes.positions, 1e3, "rad or m")?;
        all_within("arm.rates", self.axes.rates.into_iter().chain(self.next), 1e3, "rad/s or m/s")?;
        all_within("arm.wanted", self.wanted.0.iter().chain(&self.wanted.1).copied(), 1e3, "m/s or rad/s")?;
        all_within("arm.force", self.yielding.into_iter().chain([self.force]), 1e9, "N or N m")?;
        in_range("arm.steps", f64::from(self.steps), 1.0..=1e6, "")?;
        in_range("arm.left", f64::from(self.left), 0.0..=f64::from(self.steps), "")
    }

    /// True if the rates of the next period are to be decided.
    ///
    /// * `dt`: the time step, seconds.
    /// * `most`: time steps of a control period.
    pub fn begins_period(&mut self, dt: f64, most: u32) -> bool {
        if self.left == 0 {
            self.steps = ((PERIOD / dt).round() as u32).clamp(1, most.max(1));
            self.left = self.steps;
            return true;
        }
        false
    }

    /// Length of the present period, seconds.
    pub fn period(&self, dt: f64) -> f64 {
        f64::from(self.steps) * dt
    }

    /// Frames of the axes.
    pub fn frames(&mut self, arm: &ArmSpec) -> Frames {
        *self.known.frames.get_or_insert_with(|| arm.follower.chain().frames(&self.axes.positions))
    }

    /// Takes over the distances that another copy has measured.
    pub fn take_measured(&mut self, from: &mut Self) {
        self.known.distances = std::mem::take(&mut from.known.distances);
    }

    /// True if the links are far from all objects in this period.
    pub fn is_far(&self) -> bool {
        self.far
    }

    /// True if a force on its links stops the arm.
    pub fn is_pressed(&self) -> bool {
        self.pressed
    }

    /// Finds out whether an object is near a link as a period begins.
    pub fn look_around(&mut self, world: &World, arm: &ArmSpec) {
        let (frames, base_from_world) = (self.frames(arm), arm.robot.world_from_base.inverse());
        self.far = (0..world.object_count()).all(|object| {
            let center = base_from_world * world.center_of(object);
            arm.robot.bodies.are_beyond(&frames, &center, world.radius_of(object) + ARM_IS_FAR)
        });
    }

    /// Updates the force on the links with the contacts of the last step of `dt` seconds.
    pub fn feel(&mut self, world: &World, arm: &ArmSpec, dt: f64) {
        if self.far && self.force < 1e-3 && !self.pressed {
            self.force = 0.0;
            return;
        }
        let (mut force, mut yielding) = (0.0, [0.0; graspbox_arm::chain::MAX_AXES]);
        let mut frames: Option<Frames> = None;
        let (chain, base_from_world) = (arm.follower.chain(), arm.robot.world_from_base.inverse());
        world.each_arm_contact(|contact| {
            // The base does not move.
            let Some(axis) = (chain.len() - 1).checked_sub(contact.body) else { return };
            let frames = frames.get_or_insert_with(|| chain.frames(&self.axes.positions));
            let (point, push) = (base_from_world * contact.point, base_from_world.rotation * contact.force);
            force += push.norm();
            let own = arm.follower.yielding(frames, axis, &point.coords, &push);
            yielding.iter_mut().zip(own).for_each(|(sum, more)| *sum += more);
        });
        if !force.is_finite() {
            return;
        }
        let share = dt / (FORCE_TIME + dt);
        self.force += (force - self.force) * share;
        self.yielding.iter_mut().zip(yielding).for_each(|(own, now)| *own += (now - *own) * share);
        self.pressed = self.force > STOP_FORCE || (self.pressed && self.force > RELAXED * STOP_FORCE);
        self.blocked |= self.pressed;
    }

    /// Removes motion against the force on the links, and yields to it.
    fn yielded(&self, rates: &mut Positions) {
        let size = self.yielding.iter().map(|rate| rate * rate).sum::<f64>().sqrt();
        if !self.pressed || size <= 1e-9 {
            return;
        }
        let along: f64 = rates.iter().zip(&self.yielding).map(|(rate, own)| rate * own / size).sum();
        let floor = YIELD * (self.force / STOP_FORCE - RELAXED).clamp(0.0, 1.0);
        if along < floor {
            let more = (floor - along) / size;
            rates.iter_mut().zip(&self.yielding).for_each(|(rate, own)| *rate += more * own);
        }
    }

    /// Decides the rates of the period that begins.
    ///
    /// * `palm`: must stay above the table.
    pub fn decide(&mut self, arm: &ArmSpec, mut rates: Positions, dt: f64, palm: &Hung<'_>) {
        self.yielded(&mut rates);
        let (follower, period, known) = (&arm.follower, self.period(dt), &mut self.known.distances);
        let is_free = |way: &[Positions]| arm.room.is_clear(follower.chain(), way, LINK_CLEARANCE, palm, known);
        let next = follower.next(&self.axes, &rates, period, is_free);
        self.next = next.rates;
        self.blocked |= next.blocked;
    }

    /// True if this number of time steps ends within a period.
    pub fn fits(&self, ticks: u32) -> bool {
        self.left == 0 || self.left >= ticks
    }

    /// Advances by `ticks` time steps of `dt` seconds, all in one period. Returns the hand's pose in the world by forward kinematics.
    pub fn advance(&mut self, arm: &ArmSpec, dt: f64, ticks: u32) -> Isometry3<f64> {
        for _ in 0..ticks {
            let share = 1.0 / f64::from(self.left.max(1));
            let mut rates = self.axes.rates;
            rates.iter_mut().zip(self.next).for_each(|(rate, next)| *rate += (next - *rate) * share);
            self.axes = arm.follower.after(&self.axes, &rates, dt);
            self.left = self.left.saturating_sub(1);
        }
        let frames = arm.follower.chain().frames(&self.axes.positions);
        self.known.frames = Some(frames);
        arm.robot.world_from_hand_at(&frames)
    }
}
