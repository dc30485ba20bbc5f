//! Limits of every command: the palm stays off the table and inside the workspace, and crushes nothing in its way.
//!
//! The hand's root moves with infinite force in the simulation. A real arm brakes before its own geometry meets the table, and
//! stops when the force at its wrist passes a limit; so does this one.

use crate::AgentError;
use crate::workspace::{WORKSPACE_HIGH, WORKSPACE_LOW};
use graspbox_hand::{Hand, Shape};
use graspbox_sim::HandLoad;
use nalgebra::{Isometry3, Point3, Vector3};

/// Room that stays between the palm's shell and the table, metres.
pub const TABLE_CLEARANCE: f64 = 0.002;
/// Net contact force above which the hand moves no further against it, N: a heavy object weighs 15 N, and collaborative arms stop at
/// 60 to 140 N.
pub const STOP_FORCE: f64 = 60.0;
/// The hand backs off, and the stop holds, until the force has fallen to this share of [`STOP_FORCE`].
const RELAXED: f64 = 0.8;
/// A force of this many times [`STOP_FORCE`] stops the hand at once; smaller ones are filtered first, since a knock is not a crush.
const AT_ONCE: f64 = 2.5;
/// Time constant of the force sensor's filter, seconds.
const FORCE_TIME: f64 = 0.02;
/// Greatest speed at which a stopped hand backs off, m/s.
const BACK_OFF: f64 = 0.1;
/// How fast it takes up that speed, m/s2: more than the arm's own acceleration, which may pull the other way.
const BACK_OFF_ACCELERATION: f64 = 10.0;
/// Greatest deceleration of the protective stop, m/s2 and rad/s2: ten times the arm's, as in a collision. The world is
/// simulated in the hand's frame, where more of it would shake what lies on the table.
const STOP_DECELERATION: [f64; 2] = [50.0, 200.0];

/// Shapes that the root carries, as points in the hand frame with a rounding, metres.
#[derive(Clone, Debug)]
pub struct Guard {
    corners: Vec<(Point3<f64>, f64)>,
}

impl Guard {
    /// Takes the shapes of a hand's base.
    ///
    /// # Errors
    /// [`AgentError::BadHand`] for a hand whose kinematics fail.
    pub fn new(hand: &Hand) -> Result<Self, AgentError> {
        let shapes = hand
            .shapes_at(&hand.open_configuration(hand.preshape_limits()[0]))
            .map_err(|source| AgentError::BadHand { source })?;
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
        Ok(Self { corners })
    }

    /// Height of the lowest point of the base above the table, metres.
    pub fn lowest(&self, world_from_hand: &Isometry3<f64>) -> f64 {
        let heights = self.corners.iter().map(|(c, radius)| (world_from_hand * c).z - radius);
        heights.fold(f64::INFINITY, f64::min)
    }

    /// Limits a velocity (m/s and rad/s, world axes) to one from which the hand can still stop before table and walls.
    pub fn limit(&self, pose: &Isometry3<f64>, linear: &mut Vector3<f64>, angular: &Vector3<f64>, brake: &Brake) {
        for axis in 0..3 {
            let at = pose.translation.vector[axis];
            let down = brake.speed(at - WORKSPACE_LOW[axis]);
            let up = brake.speed(WORKSPACE_HIGH[axis] - at);
            linear[axis] = linear[axis].max(-down).min(up);
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
    /// m/s2 or rad/s2.
    pub deceleration: f64,
    /// Seconds.
    pub dt: f64,
}

impl Brake {
    /// Greatest speed from which the hand can stop within `distance`; 0 for a negative one.
    pub fn speed(&self, distance: f64) -> f64 {
        if distance <= 0.0 {
            return 0.0;
        }
        // Moving at v this step and less by deceleration * dt at each further one covers v dt / 2 + v^2 / (2 deceleration).
        let half = self.dt / 2.0;
        let speed = self.deceleration * ((half * half + 2.0 * distance / self.deceleration).sqrt() - half);
        speed.min(distance / self.dt)
    }
}

/// The protective stop: watches the force on the hand and takes away motion against it.
///
/// It holds until the force has relaxed and the command no longer points against it: otherwise a persistent command would hammer on
/// whatever is in the way.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct ProtectiveStop {
    /// Filtered net force on the hand, world axes, N.
    force: Vector3<f64>,
    /// From the hand to where it acts, world axes, metres.
    arm: Vector3<f64>,
    /// Direction of the force that stopped the hand, world.
    away: Vector3<f64>,
    /// True while motion is blocked.
    pub active: bool,
}

impl ProtectiveStop {
    /// Takes the load of the last step of `dt` seconds, and the velocity that is wanted now (world axes).
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

    /// Filtered net force on the hand, N.
    pub fn force(&self) -> f64 {
        self.force.norm()
    }

    /// Takes motion against the force out of a velocity (world axes) while the stop is active.
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
