//! The seam between a world and the engine that moves it: what a world asks of an engine, and what it gets back.
//!
//! An engine simulates one hand, one object and the scenery in the frame of the hand's base: the hand's root is fixed, table and ground
//! move. Actuators are no part of it; it sees where they are at the end of a step. Units are metres, kilograms, seconds,
//! radians and newtons throughout. Equal calls on equal engines give equal bits, on any thread.

use crate::SimError;
use crate::motion::FrameMotion;
use graspbox_hand::ActuatorState;
use nalgebra::{Isometry3, Point3, Vector3};

/// A part of the world that touches and is touched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Part {
    Object,
    Table,
    Ground,
    /// Index of the hand's link, and of the collider within it.
    Link {
        link: usize,
        shape: usize,
    },
}

impl Part {
    pub(crate) fn is_scenery(self) -> bool {
        matches!(self, Part::Table | Part::Ground)
    }

    pub(crate) fn is_link(self) -> bool {
        matches!(self, Part::Link { .. })
    }
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
    /// State of every actuator at the end of the step, in the order of the hand's actuators.
    pub actuators: &'a [ActuatorState],
}

/// One of the two sides of a contact point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ContactSide {
    pub part: Part,
    /// Contact point on the surface of the part, metres. Frame: the object's, the link's (not the collider's), the world's for scenery.
    pub point: Point3<f64>,
    /// Unit normal in the same frame, pointing into the part.
    pub normal: Vector3<f64>,
}

/// One contact point of the last step, pressing or merely near.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contact {
    pub sides: [ContactSide; 2],
    /// Where, frame of the hand's base, metres.
    pub point: Point3<f64>,
    /// Unit normal from the first part to the second, frame of the hand's base.
    pub normal: Vector3<f64>,
    /// Distance of the surfaces, metres; negative where they overlap.
    pub distance: f64,
    /// Normal force, N, averaged over the step; 0 where it does not press.
    pub force: f64,
    /// Coefficient of friction of the pair.
    pub friction: f64,
}

/// Position (rad or m) and speed (rad/s or m/s) of one joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointState {
    /// Position.
    pub position: f64,
    /// Speed.
    pub speed: f64,
}

/// A physics engine. "Base" is the frame of the hand's base; velocities are those that an observer in that frame measures.
pub(crate) trait Engine: Send + Sync {
    /// A copy that goes on with the same bits.
    fn duplicate(&self) -> Box<dyn Engine>;

    /// Poses an engine that has not stepped yet: every joint of the hand at its position in `joints` (rad or m), the object at rest.
    fn pose(&mut self, base_from_world: &Isometry3<f64>, base_from_object: &Isometry3<f64>, joints: &[f64]);

    /// Advances by one time step.
    fn step(&mut self, input: &StepInput);

    /// Tension of tendon `tendon` in the last step, N; 0 before the first.
    fn tension(&self, tendon: usize) -> f64;

    /// State of the hand's joint `joint`; zero for a fixed one.
    fn joint(&self, joint: usize) -> JointState;

    fn base_from_object(&self) -> Isometry3<f64>;

    /// Linear (of the centre of mass, m/s) and angular (rad/s) velocity of the object, base axes.
    fn object_velocity(&self) -> (Vector3<f64>, Vector3<f64>);

    /// Sets what [`Engine::object_velocity`] returns.
    fn set_object_velocity(&mut self, linear: &Vector3<f64>, angular: &Vector3<f64>);

    /// Multiplies the object's friction factor and its mass with its inertia; both factors are finite and positive.
    fn scale_object(&mut self, friction: f64, mass: f64);

    /// Height of the lowest point of the object's collision geometry when it is posed at `from_object`, along z of that frame, metres.
    fn lowest_point(&self, from_object: &Isometry3<f64>) -> f64;

    /// Visits the contact points of the last step whose pair of parts is `wanted`, always in the same order.
    ///
    /// Points further apart than the prediction distance may be left out.
    fn contacts(&self, wanted: &dyn Fn([Part; 2]) -> bool, visit: &mut dyn FnMut(&Contact));

    /// False once a pose or velocity is no longer a finite number.
    fn is_finite(&self) -> bool;

    /// Steps since the engine was posed in which the solver stopped before it converged; 0 for an engine that does not measure it.
    fn unconverged_steps(&self) -> u64;

    /// The whole state as bytes.
    ///
    /// # Errors
    /// [`SimError::BadSnapshot`] if it cannot be written.
    fn save(&self) -> Result<Vec<u8>, SimError>;

    /// Replaces the state by one that [`Engine::save`] wrote for an equal template.
    ///
    /// # Errors
    /// [`SimError::BadSnapshot`] for bytes of something else; the state is unchanged then.
    fn load(&mut self, bytes: &[u8]) -> Result<(), SimError>;
}
