//! The interface between a world and its physics engine.
//!
//! An engine simulates one hand, objects and the scenery in the frame of the hand's base: the hand's root is fixed, table and ground
//! move. Actuators belong to the world; the engine gets their states at the end of each step. Units are metres, kilograms, seconds, radians
//! and newtons. Equal calls on equal engines give equal bits, on any thread.

use crate::SimError;
use crate::config::PhysicsConfig;
use crate::motion::FrameMotion;
use crate::object::ObjectModel;
use crate::scenery::Wall;
use graspbox_hand::{ActuatorState, Hand};
use nalgebra::{Isometry3, Point3, Vector3};
use std::sync::Arc;

/// A part of the world that has contacts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    Object(usize),
    Table,
    Ground,
    Wall,
    /// Index of a body of the arm that carries the hand.
    Arm(usize),
    /// Index of a link of the hand, and of the collider within it.
    Link {
        link: usize,
        shape: usize,
    },
}

impl Part {
    pub(crate) fn is_scenery(self) -> bool {
        matches!(self, Part::Table | Part::Ground | Part::Wall)
    }

    pub(crate) fn is_object(self) -> bool {
        matches!(self, Part::Object(_))
    }

    pub(crate) fn is_link(self) -> bool {
        matches!(self, Part::Link { .. })
    }
}

/// Contents and settings of a world.
#[derive(Clone, Copy)]
pub(crate) struct WorldSpec<'a> {
    pub hand: &'a Arc<Hand>,
    pub objects: &'a [ObjectModel],
    pub walls: &'a [Wall],
    pub config: &'a PhysicsConfig,
}

/// Inputs of one step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct StepInput<'a> {
    /// Pose of the world in the base's frame before the step.
    pub base_from_world: Isometry3<f64>,
    /// The same at the end of the step.
    pub base_from_world_after: Isometry3<f64>,
    /// Gravity and motion of the base during the step, axes of the base before the step.
    pub frame: FrameMotion,
    /// Force on each object at its centre of mass during the step, N, axes of the base before the step.
    pub forces: &'a [Vector3<f64>],
    /// State of every actuator at the end of the step, in the order of the hand's actuators.
    pub actuators: &'a [ActuatorState],
    /// Coordinates of the arm that carries the hand at the end of the step, see [`crate::world::carrier`]; empty without one.
    pub arm: &'a [f64],
    /// The arm is far from every object.
    pub arm_is_far: bool,
}

/// One of the two sides of a contact point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ContactSide {
    pub part: Part,
    /// Contact point on the surface of the part, metres, in the frame of its object or link (not the collider), for scenery the world's.
    pub point: Point3<f64>,
    /// Unit normal in the same frame, into the part.
    pub normal: Vector3<f64>,
}

/// A contact point of the last step; one across a gap has no force.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contact {
    pub sides: [ContactSide; 2],
    /// Position, frame of the hand's base, metres.
    pub point: Point3<f64>,
    /// Unit normal from the first part to the second, frame of the hand's base.
    pub normal: Vector3<f64>,
    /// Signed distance of the surfaces, metres; negative where they overlap.
    pub distance: f64,
    /// Normal force, mean over the step, N; 0 where it does not press.
    pub force: f64,
    /// Friction on the second part, mean over the step, frame of the hand's base, N.
    pub friction_force: Vector3<f64>,
    /// Coefficient of friction of the pair.
    pub friction: f64,
}

/// Position (rad or m) and speed (rad/s or m/s) of one joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointState {
    pub position: f64,
    pub speed: f64,
}

/// A physics engine. "Base" is the frame of the hand's base; velocities are relative to that frame.
pub(crate) trait Engine: Send + Sync {
    /// A copy that continues with the same bits.
    fn duplicate(&self) -> Box<dyn Engine>;

    /// Poses an engine before its first step: every joint of the hand at its position in `joints` (rad or m), the objects at rest.
    ///
    /// * `base_from_objects`: one per object.
    fn pose(&mut self, base_from_world: &Isometry3<f64>, base_from_objects: &[Isometry3<f64>], joints: &[f64]);

    /// Poses the arm that carries the hand, at rest in the hand's frame.
    fn place_arm(&mut self, arm: &[f64]);

    /// Advances by one time step.
    fn step(&mut self, input: &StepInput);

    /// Advances by `steps` time steps at once, if the objects rest and nothing comes within reach in that time. Returns whether it did; if not,
    /// poses and velocities are as before.
    ///
    /// * `input`: as for one step of that duration.
    fn step_freely(&mut self, _input: &StepInput, _steps: u32) -> bool {
        false
    }

    /// False if [`Engine::step_freely`] is sure to return false.
    fn is_free(&self) -> bool {
        false
    }

    /// Tension of tendon `tendon` in the last step, N; 0 before the first.
    fn tension(&self, tendon: usize) -> f64;

    /// State of the hand's joint `joint`; zero for a fixed one.
    fn joint(&self, joint: usize) -> JointState;

    /// Pose of an object.
    fn base_from_object(&self, object: usize) -> Isometry3<f64>;

    /// Velocity of an object's centre of mass (m/s) and its angular velocity (rad/s), base axes.
    fn object_velocity(&self, object: usize) -> (Vector3<f64>, Vector3<f64>);

    /// Sets the velocities that [`Engine::object_velocity`] returns.
    fn set_object_velocity(&mut self, object: usize, linear: &Vector3<f64>, angular: &Vector3<f64>);

    /// Takes all objects for at rest: those that stay slow for some steps then cost nothing until something touches them.
    fn expect_rest(&mut self) {}

    /// Wakes all objects that sleep: what acts on them has changed.
    fn wake(&mut self) {}

    /// Multiplies an object's friction factor, and its mass and inertia; both factors are finite and positive.
    fn scale_object(&mut self, object: usize, friction: f64, mass: f64);

    /// Height of the lowest point of an object's collision geometry at pose `from_object`, along z of that frame, metres.
    fn lowest_point(&self, object: usize, from_object: &Isometry3<f64>) -> f64;

    /// Visits the contact points of the last step between `wanted` parts, in a reproducible order.
    ///
    /// Points farther apart than the prediction distance may be missing.
    fn contacts(&self, wanted: &dyn Fn([Part; 2]) -> bool, visit: &mut dyn FnMut(&Contact));

    /// True while all poses and velocities are finite.
    fn is_finite(&self) -> bool;

    /// Steps since the engine was posed in which the solver did not converge; 0 for an engine that does not measure convergence.
    fn unconverged_steps(&self) -> u64;

    /// The complete state as bytes.
    ///
    /// # Errors
    /// [`SimError::BadSnapshot`] if it cannot be written.
    fn save(&self) -> Result<Vec<u8>, SimError>;

    /// Restores a state that [`Engine::save`] wrote for an equal template.
    ///
    /// # Errors
    /// [`SimError::BadSnapshot`] for other bytes; the state is then unchanged.
    fn load(&mut self, bytes: &[u8]) -> Result<(), SimError>;
}
