//! Measurements of a world: poses, velocities, joints, actuators, and whether the simulation diverged.

use super::World;
use crate::engine::JointState;
use crate::scenery::{GROUND_SIDE, TABLE_HEIGHT};
use graspbox_hand::{ActuatorState, Drive, DrivenJoint, Hand, JointKind, Transmission};
use nalgebra::{Isometry3, Point3, Vector3};
use std::sync::Arc;

/// Greatest height of an object above the table, metres: an arm's reach above the highest lift.
const HIGHEST: f64 = 3.0;
/// Greatest speed of an object in the hand's frame, m/s: a fall from [`HIGHEST`] (8 m/s) relative to the fastest lift (19 m/s), rounded up.
const FASTEST: f64 = 30.0;
/// Greatest distance of a joint beyond its stop, radians: soft stops yield by far less.
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

    pub fn hand(&self) -> &Arc<Hand> {
        &self.shared.hand
    }

    pub fn object_count(&self) -> usize {
        self.shared.masses.len()
    }

    /// Index of the target object, to which the other methods refer as "the object".
    pub fn target(&self) -> usize {
        self.state.target
    }

    /// Every object in the world.
    pub fn world_from_objects(&self) -> impl ExactSizeIterator<Item = Isometry3<f64>> {
        let world_from_base = self.state.motion.world_from_base;
        (0..self.object_count()).map(move |object| world_from_base * self.engine.base_from_object(object))
    }

    /// Simulated mass of the object, with the factors of [`World::scale_object`], kg.
    pub fn object_mass(&self) -> f64 {
        self.shared.masses[self.target()] * self.state.mass_factors[self.target()]
    }

    /// Grasp frame in the world.
    pub fn world_from_hand(&self) -> Isometry3<f64> {
        self.state.motion.world_from_base * self.shared.hand.base_from_hand
    }

    pub fn world_from_object(&self) -> Isometry3<f64> {
        self.state.motion.world_from_base * self.engine.base_from_object(self.target())
    }

    /// Object in the grasp frame.
    pub fn hand_from_object(&self) -> Isometry3<f64> {
        self.hand_from(self.target())
    }

    /// An object, by its index, in the grasp frame.
    pub fn hand_from(&self, object: usize) -> Isometry3<f64> {
        self.shared.hand_from_base * self.engine.base_from_object(object)
    }

    /// Centre of mass of the object in the world, metres.
    pub fn object_center(&self) -> Point3<f64> {
        self.center_of(self.target())
    }

    /// Centre of mass of an object, by its index, in the world, metres.
    pub fn center_of(&self, object: usize) -> Point3<f64> {
        let world_from_object = self.state.motion.world_from_base * self.engine.base_from_object(object);
        world_from_object * Point3::from(self.shared.objects_from_centers[object])
    }

    /// Velocity of the object's centre of mass (m/s) and its angular velocity (rad/s), relative to the moving hand frame.
    pub fn object_velocity_in_hand(&self) -> (Vector3<f64>, Vector3<f64>) {
        self.velocity_in_hand(self.target())
    }

    /// The same of another object, by its index.
    pub fn velocity_in_hand(&self, object: usize) -> (Vector3<f64>, Vector3<f64>) {
        let hand_from_base = &self.shared.hand_from_base.rotation;
        let (linear, angular) = self.engine.object_velocity(object);
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

    /// Positions of the independent joints, in the order of [`Hand::coordinates`], rad or m. Joints that actuators drive rigidly are at the
    /// actuators' positions.
    pub fn configuration(&self) -> Vec<f64> {
        let hand = &self.shared.hand;
        let rigid = |joint| hand.rigid_position(joint, |actuator| self.state.actuators[actuator].position);
        hand.coordinates().map(|joint| rigid(joint).unwrap_or_else(|| self.engine.joint(joint).position)).collect()
    }

    /// Tension of tendon `tendon` in the last step, N.
    pub fn tension(&self, tendon: usize) -> f64 {
        self.engine.tension(tendon)
    }

    /// Load of an actuator: the tension of its tendon, N, or the greatest closing force on one of its joints, N m or N. 0 for a gear that drives
    /// joints rigidly, which holds any load of a grasp.
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

    /// True if the simulation diverged: a number that is not finite, or a state beyond the bounds of any table-top scene.
    ///
    /// The bounds are wide: the object's centre of mass is between the ground and `HIGHEST`, over the ground, and slower than `FASTEST` in the
    /// hand's frame; no joint is farther than `BEYOND_STOP` beyond its stop.
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

    /// True while every number of the world is finite.
    pub fn is_finite(&self) -> bool {
        self.engine.is_finite()
    }

    /// Steps since the world was spawned in which the solver did not converge; 0 for rapier, which does not measure convergence.
    pub fn unconverged_steps(&self) -> u64 {
        self.engine.unconverged_steps()
    }
}
