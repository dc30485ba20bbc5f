//! Limits of every command: the palm stays off the table and inside the workspace, and does not crush obstacles.
//!
//! The simulated root of the hand moves with unlimited force. Like a real arm, this one brakes before its geometry meets the table, and stops if the
//! force at its wrist exceeds a limit.

use crate::EnvError;
use crate::actions::workspace::{WORKSPACE_HIGH, WORKSPACE_LOW};
use graspbox_episode::approach::{FORCE_TIME, STOP_FORCE};
use graspbox_hand::{Hand, Shape};
use graspbox_mesh::range::{OutOfRange, all_within};
use graspbox_sim::HandLoad;
use nalgebra::{Isometry3, Point3, Vector3};

/// Least distance between the palm's shell and the table, metres.
pub const TABLE_CLEARANCE: f64 = 0.002;
/// Share of [`STOP_FORCE`] below which the stop is released; until then the hand backs off.
const RELAXED: f64 = 0.8;
/// Multiple of [`STOP_FORCE`] that stops the hand at once; smaller forces are filtered first, since a brief impact does no harm.
const AT_ONCE: f64 = 2.5;
/// Greatest speed at which a stopped hand backs off, m/s.
const BACK_OFF: f64 = 0.1;
/// Acceleration while backing off, m/s2: more than the arm's own, which may act in the other direction.
const BACK_OFF_ACCELERATION: f64 = 10.0;
/// Greatest deceleration of the protective stop, m/s2 and rad/s2: ten times the arm's, as in a collision. The world is simulated in the hand's
/// frame, in which more would shake objects on the table.
const STOP_DECELERATION: [f64; 2] = [50.0, 200.0];

/// Shapes of the hand's base, as points in the hand frame with a radius, metres.
#[derive(Clone, Debug)]
pub struct Guard {
    corners: Vec<(Point3<f64>, f64)>,
    /// Radius of a sphere about the hand's origin that contains them all, metres.
    reach: f64,
}

impl Guard {
    /// Collects the shapes of a hand's base.
    ///
    /// # Errors
    /// [`EnvError::BadHand`] for a hand whose kinematics fail.
    pub fn new(hand: &Hand) -> Result<Self, EnvError> {
        let shapes = hand
            .shapes_at(&hand.open_configuration(hand.preshape_limits()[0]))
            .map_err(|source| EnvError::BadHand { source })?;
        let mut corners = Vec::new();
        for shape in shapes.iter().filter(|s| hand.chain_of_link(s.link).is_none()) {
            let half = match shape.collider.shape {
                Shape::Cuboid(half) => half,
                Shape::Cylinder { radius, half_length } => Vector3::new(radius, radius, half_length),
                Shape::Sphere { radius } => {
                    corners.push((Point3::from(shape.hand_from_shape.translation.vector), radius));
                    continue;
                }
            };
            for i in 0..8 {
                let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
                let corner = Vector3::new(sign(0), sign(1), sign(2)).component_mul(&half);
                corners.push((shape.hand_from_shape * Point3::from(corner), 0.0));
            }
        }
        let reach = corners.iter().map(|(corner, radius)| corner.coords.norm() + radius).fold(0.0, f64::max);
        Ok(Self { corners, reach })
    }

    /// Radius of a sphere about the hand's origin that contains the base, metres.
    pub fn reach(&self) -> f64 {
        self.reach
    }

    /// A lower bound of [`Guard::lowest`].
    pub fn at_least(&self, world_from_hand: &Isometry3<f64>) -> f64 {
        world_from_hand.translation.vector.z - self.reach
    }

    /// Height of the lowest point of the base above the table, metres.
    pub fn lowest(&self, world_from_hand: &Isometry3<f64>) -> f64 {
        let heights = self.corners.iter().map(|(c, radius)| (world_from_hand * c).z - radius);
        heights.fold(f64::INFINITY, f64::min)
    }

    /// Limits a velocity (m/s and rad/s, world axes) to one from which the hand can stop before the table and the borders of the workspace.
    pub fn limit(&self, pose: &Isometry3<f64>, linear: &mut Vector3<f64>, angular: &Vector3<f64>, brake: &Brake) {
        for axis in 0..3 {
            let at = pose.translation.vector[axis];
            let (below, above) = (at - WORKSPACE_LOW[axis], WORKSPACE_HIGH[axis] - at);
            if !brake.surely_stops(linear[axis].abs(), below.min(above)) {
                linear[axis] = linear[axis].max(-brake.speed(below)).min(brake.speed(above));
            }
        }
        if brake.surely_stops(linear.z.abs() + angular.norm() * self.reach, self.at_least(pose) - TABLE_CLEARANCE) {
            return;
        }
        let mut lift = 0.0_f64;
        for (corner, radius) in &self.corners {
            let arm = pose.rotation * corner.coords;
            let height = pose.translation.vector.z + arm.z - radius - TABLE_CLEARANCE;
            let falls = linear.z + angular.cross(&arm).z;
            lift = lift.max(-brake.speed(height) - falls);
        }
        linear.z += lift;
    }
}

/// Braking with a constant deceleration in discrete steps.
#[derive(Clone, Copy, Debug)]
pub struct Brake {
    /// Deceleration, m/s2 or rad/s2.
    pub deceleration: f64,
    /// Time step, seconds.
    pub dt: f64,
}

impl Brake {
    /// Greatest speed from which the hand can stop within `distance`; 0 for a negative distance.
    pub fn speed(&self, distance: f64) -> f64 {
        if distance <= 0.0 {
            return 0.0;
        }
        // Speed v in this step, and less by deceleration * dt in each later one, covers v dt / 2 + v^2 / (2 deceleration).
        let half = self.dt / 2.0;
        let speed = self.deceleration * ((half * half + 2.0 * distance / self.deceleration).sqrt() - half);
        speed.min(distance / self.dt)
    }

    /// True only if `speed` is less than that of [`Brake::speed`]: nearly always the faster answer.
    #[inline]
    fn surely_stops(&self, speed: f64, distance: f64) -> bool {
        /// Less than 1 by more than rounding.
        const SURE: f64 = 0.99;
        let within = SURE * distance;
        speed * self.dt <= within && 0.5 * speed * (self.dt + speed / self.deceleration) <= within
    }
}

/// The protective stop: monitors the force on the hand and removes motion against it.
///
/// It holds until the force has fallen and the command no longer points against it: otherwise a persistent command would hit the obstacle
/// repeatedly.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ProtectiveStop {
    /// Filtered net force on the hand, world axes, N.
    force: Vector3<f64>,
    /// Vector from the hand to its point of application, world axes, metres.
    arm: Vector3<f64>,
    /// Direction of the force that stopped the hand, world axes.
    away: Vector3<f64>,
    /// True while motion is blocked.
    pub active: bool,
}

impl ProtectiveStop {
    /// Updates the stop with the load of the last step of `dt` seconds and the commanded velocity (world axes).
    pub fn feel(
        &mut self,
        load: &HandLoad,
        pose: &Isometry3<f64>,
        (linear, angular): (&Vector3<f64>, &Vector3<f64>),
        dt: f64,
    ) {
        let force = pose.rotation * load.force;
        if !force.iter().all(|f| f.is_finite()) {
            return;
        }
        self.force += (force - self.force) * (dt / (FORCE_TIME + dt));
        if force != Vector3::zeros() {
            self.arm = pose.rotation * load.at.coords;
        }
        let size = self.force();
        if size > STOP_FORCE {
            self.active = true;
            self.away = self.force / size;
        } else if !self.active && force.norm() > AT_ONCE * STOP_FORCE {
            self.active = true;
            self.away = force.normalize();
        } else if self.active && size < RELAXED * STOP_FORCE {
            self.active = (linear + angular.cross(&self.arm)).dot(&self.away) < 0.0;
        }
    }

    /// Refuses states that no stop can have.
    ///
    /// # Errors
    /// [`OutOfRange`], naming the first number.
    pub(crate) fn check(&self) -> Result<(), OutOfRange> {
        all_within("arm.stop.force", self.force.iter().copied(), 1e9, "N")?;
        all_within("arm.stop.arm", self.arm.iter().copied(), 1e3, "m")?;
        // A direction, to rounding.
        all_within("arm.stop.away", self.away.iter().copied(), 1.001, "")
    }

    /// Filtered net force on the hand, N.
    pub fn force(&self) -> f64 {
        self.force.norm()
    }

    /// Removes motion against the force from a velocity (world axes) while the stop is active.
    pub fn limit(&self, linear: &mut Vector3<f64>, angular: &mut Vector3<f64>, dt: f64) {
        if !self.active {
            return;
        }
        let rate = angular.norm();
        if angular.cross(&self.arm).dot(&self.away) < 0.0 {
            *angular *= 1.0 - (STOP_DECELERATION[1] * dt / rate).min(1.0);
        }
        let along = linear.dot(&self.away);
        if along < 0.0 {
            *linear += self.away * (-along).min(STOP_DECELERATION[0] * dt);
        }
        let floor = BACK_OFF * (self.force() / STOP_FORCE - RELAXED).clamp(0.0, 1.0);
        let missing = floor - along.max(0.0);
        if missing > 0.0 {
            *linear += self.away * missing.min(BACK_OFF_ACCELERATION * dt);
        }
    }
}
