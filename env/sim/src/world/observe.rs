//! What can be read off a world: poses, velocities, joints, actuators, and whether it went wrong.

use super::World;
use crate::engine::JointState;
use crate::scenery::{GROUND_SIDE, TABLE_HEIGHT};
use graspbox_hand::{ActuatorState, Drive, DrivenJoint, Hand, JointKind, Transmission};
use nalgebra::{Isometry3, Point3, Vector3};
use std::sync::Arc;

/// No object rises higher than this above the table, metres: an arm's reach over the highest lift.
const HIGHEST: f64 = 3.0;
/// No object moves faster than this in the hand's frame, m/s: a fall from [`HIGHEST`], seen from the fastest lift (19 m/s).
const FASTEST: f64 = 30.0;
/// No joint is further beyond its stop than this, radians.
const BEYOND_STOP: f64 = 1.0;
/// The same for a prismatic joint, metres.
const BEYOND_STOP_METRES: f64 = 0.05;

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

    /// Mass of the object as it is simulated, with the factors of [`World::scale_object`], kg.
    pub fn object_mass(&self) -> f64 {
        self.shared.mass * self.state.mass_factor
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

    /// State of every actuator, in the order of the hand's actuators.
    pub fn actuators(&self) -> &[ActuatorState] {
        &self.state.actuators
    }

    /// State of joint `joint` of the hand; zero for a fixed one.
    pub fn joint(&self, joint: usize) -> JointState {
        self.engine.joint(joint)
    }

    /// Positions of the independent joints, in the order of [`Hand::coordinates`], rad or m: those of the actuators for joints that these
    /// drive rigidly.
    pub fn configuration(&self) -> Vec<f64> {
        let hand = &self.shared.hand;
        let rigid = |joint| hand.rigid_position(joint, |actuator| self.state.actuators[actuator].position);
        hand.coordinates().map(|joint| rigid(joint).unwrap_or_else(|| self.engine.joint(joint).position)).collect()
    }

    /// Tension of tendon `tendon` in the last step, N.
    pub fn tension(&self, tendon: usize) -> f64 {
        self.engine.tension(tendon)
    }

    /// What an actuator pulls against now: tension of its tendon, N, or the greatest force on one of its joints towards closing, N m or N.
    /// A gear that drives joints rigidly holds against any load of a grasp: 0.
    pub fn load(&self, actuator: usize) -> f64 {
        let hand = &self.shared.hand;
        let (description, position) = (&hand.actuators[actuator], self.state.actuators[actuator].position);
        match &description.transmission {
            Transmission::Spool { tendon, .. } => self.engine.tension(*tendon),
            Transmission::Joints { drive: Drive::Rigid, .. } => 0.0,
            Transmission::Joints { joints, drive: Drive::Servo { stiffness, damping } } => {
                let force = |driven: &DrivenJoint| {
                    let joint = self.engine.joint(driven.joint);
                    let force = stiffness * (hand.led(driven, position) - joint.position) - damping * joint.speed;
                    force.clamp(-description.load_limit, description.load_limit) * driven.ratio.signum()
                };
                joints.iter().map(force).fold(0.0, f64::max)
            }
        }
    }

    /// Position of the actuator that is the preshape coordinate, rad or m; 0 for a hand without one.
    pub fn preshape(&self) -> f64 {
        self.shared.hand.grasp.coordinate.map_or(0.0, |coordinate| self.state.actuators[coordinate.actuator].position)
    }

    /// True once the simulation went wrong: a number that is not finite, or a motion that no table-top scene can have.
    ///
    /// The bounds leave ample room: the object's centre of mass falls no deeper than the ground under the table, rises no higher than
    /// `HIGHEST`, leaves the table's middle by no more than half the ground, moves slower than `FASTEST` in the hand's frame, and
    /// no joint is further beyond its stop than `BEYOND_STOP`.
    pub fn has_diverged(&self) -> bool {
        let center = self.object_center();
        let away = center.coords.xy().norm() > GROUND_SIDE / 2.0 || !(-TABLE_HEIGHT..=HIGHEST).contains(&center.z);
        let fast = self.object_velocity_in_hand().0.norm() > FASTEST;
        let hand = &self.shared.hand;
        let bent = |joint: usize| {
            let [lower, upper] = hand.joints[joint].limits;
            let beyond = if hand.joints[joint].kind == JointKind::Prismatic { BEYOND_STOP_METRES } else { BEYOND_STOP };
            !(lower - beyond..=upper + beyond).contains(&self.engine.joint(joint).position)
        };
        !self.is_finite() || away || fast || hand.coordinates().any(bent)
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
