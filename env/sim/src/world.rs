//! The world: a template that is built once per object, and the worlds that are cloned from it, stepped and observed.

use crate::SimError;
use crate::config::{EngineKind, PhysicsConfig};
use crate::engine::{Engine, StepInput};
use crate::identity::{Identity, identity};
use crate::motion::BaseMotion;
use crate::native::Native;
use crate::object::ObjectModel;
use crate::rapier::Rapier;
use graspbox_hand::{ActuatorCommand, ActuatorState, Hand};
use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

mod observe;

pub use crate::engine::JointState;

/// What changes from step to step, beside the engine's own state.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct State {
    motion: BaseMotion,
    /// Gravity in the world's frame, m/s2.
    gravity: Vector3<f64>,
    /// Factor on the object's mass.
    mass_factor: f64,
    actuators: Vec<ActuatorState>,
    steps: u64,
}

/// A world before its first step: cloning it and posing the clone is the only reset there is.
pub struct Template {
    engine: Box<dyn Engine>,
    shared: Arc<Shared>,
}

/// What all worlds of one template share.
struct Shared {
    hand: Arc<Hand>,
    config: PhysicsConfig,
    mass: f64,
    object_from_center: Vector3<f64>,
    identity: Identity,
}

/// A table, one object and one hand, simulated in the frame of the hand's base.
pub struct World {
    engine: Box<dyn Engine>,
    shared: Arc<Shared>,
    state: State,
}

impl Template {
    /// Builds the world of `object` and `hand` once.
    ///
    /// # Errors
    /// A setting out of range, or a hand that cannot be simulated.
    pub fn new(hand: Arc<Hand>, object: &ObjectModel, config: PhysicsConfig) -> Result<Self, SimError> {
        config.validate()?;
        let engine: Box<dyn Engine> = match config.engine {
            EngineKind::Graspbox => Box::new(Native::new(Arc::clone(&hand), object, config)?),
            EngineKind::Rapier => Box::new(Rapier::new(Arc::clone(&hand), object, config)?),
        };
        let shared = Shared {
            identity: identity(&hand, object, &config)?,
            hand,
            config,
            mass: object.mass(),
            object_from_center: object.center_of_mass().coords,
        };
        Ok(Self { engine, shared: Arc::new(shared) })
    }

    /// A fresh world: the hand open at `world_from_hand` with its preshape (rad), the object at rest at `world_from_object`.
    pub fn spawn(&self, world_from_hand: &Isometry3<f64>, world_from_object: &Isometry3<f64>, preshape: f64) -> World {
        let hand = &self.shared.hand;
        let world_from_base = world_from_hand * hand.base_from_hand.inverse();
        let base_from_world = world_from_base.inverse();
        let mut engine = self.engine.duplicate();
        // A preshape that is no number gives joints that are none, which the checks of every step find.
        let joints = hand.joint_positions(&hand.open_configuration(preshape));
        let joints = joints.unwrap_or_else(|_| vec![f64::NAN; hand.joints.len()]);
        engine.pose(&base_from_world, &(base_from_world * world_from_object), &joints);
        let start = hand.actuators.iter().zip(hand.open_positions(preshape));
        let actuators = start.map(|(actuator, position)| ActuatorState::new(actuator, position)).collect();
        let state = State {
            gravity: Vector3::new(0.0, 0.0, -self.shared.config.gravity),
            motion: BaseMotion::at_rest(world_from_base),
            mass_factor: 1.0,
            actuators,
            steps: 0,
        };
        World { engine, shared: Arc::clone(&self.shared), state }
    }

    /// A world from a saved state, if that state is of an equal template.
    pub(crate) fn resume(&self, identity: &Identity, state: State, engine_state: &[u8]) -> Result<World, SimError> {
        if *identity != self.shared.identity || state.actuators.len() != self.shared.hand.actuators.len() {
            let why = "it was taken with another hand, object or physics setting".to_owned();
            return Err(SimError::BadSnapshot { why });
        }
        let mut engine = self.engine.duplicate();
        engine.load(engine_state)?;
        Ok(World { engine, shared: Arc::clone(&self.shared), state })
    }

    /// Height of the lowest point of the collision geometry above the table when the object is posed at `world_from_object`, metres.
    pub fn lowest_point(&self, world_from_object: &Isometry3<f64>) -> f64 {
        self.engine.lowest_point(world_from_object)
    }

    /// The hand of this template.
    pub fn hand(&self) -> &Arc<Hand> {
        &self.shared.hand
    }

    /// The physics settings of this template.
    pub fn config(&self) -> &PhysicsConfig {
        &self.shared.config
    }
}

impl Clone for World {
    fn clone(&self) -> Self {
        Self { engine: self.engine.duplicate(), shared: Arc::clone(&self.shared), state: self.state.clone() }
    }
}

impl World {
    /// Advances by one time step: the hand reaches `world_from_hand` at its end, the actuators follow their commands.
    ///
    /// `commands` has one entry per actuator, in the order of the hand's actuators; missing ones hold still.
    ///
    /// # Errors
    /// [`SimError::BadCommand`] for a command that is not finite; nothing moves then.
    pub fn step(&mut self, world_from_hand: &Isometry3<f64>, commands: &[ActuatorCommand]) -> Result<(), SimError> {
        let dt = self.shared.config.dt;
        self.drive_actuators(commands, dt)?;
        let base_from_world = self.state.motion.world_from_base.inverse();
        let target = world_from_hand * self.shared.hand.base_from_hand.inverse();
        let frame = self.state.motion.advance(target, dt, &self.state.gravity);
        let base_from_world_after = target.inverse();
        self.engine.step(&StepInput {
            base_from_world,
            base_from_world_after,
            frame,
            actuators: &self.state.actuators,
        });
        self.state.steps += 1;
        Ok(())
    }

    fn drive_actuators(&mut self, commands: &[ActuatorCommand], dt: f64) -> Result<(), SimError> {
        let hand = &self.shared.hand;
        // All are checked before the first moves.
        if let Some(actuator) = commands.iter().take(hand.actuators.len()).position(|command| !command.is_finite()) {
            return Err(SimError::BadCommand { actuator });
        }
        for (index, (actuator, command)) in hand.actuators.iter().zip(commands).enumerate() {
            let load = self.load(index);
            if !load.is_finite() {
                // The simulation diverged, which `has_diverged` says; no command is to blame.
                continue;
            }
            let state = &mut self.state.actuators[index];
            state.step(actuator, *command, load, dt).map_err(|_| SimError::BadCommand { actuator: index })?;
        }
        Ok(())
    }

    /// Sets gravity in the world's frame, m/s2: a tilted table, or none.
    pub fn set_gravity(&mut self, gravity: &Vector3<f64>) {
        self.state.gravity = *gravity;
    }

    /// Sets the object's velocity in the world's frame, for tests of physics and for thrown objects.
    pub fn set_object_velocity(&mut self, linear: &Vector3<f64>, angular: &Vector3<f64>) {
        let base_from_world = self.state.motion.world_from_base.rotation.inverse();
        let arm = self.object_center() - Point3::from(self.state.motion.world_from_base.translation.vector);
        let frame = self.state.motion.linear + self.state.motion.angular.cross(&arm);
        let (linear, angular) =
            (base_from_world * (linear - frame), base_from_world * (angular - self.state.motion.angular));
        self.engine.set_object_velocity(&linear, &angular);
    }

    /// Multiplies the object's friction factor and its mass (with its inertia), for a world that varies from its template.
    ///
    /// * `friction`, `mass`: positive factors; another value counts as 1.
    pub fn scale_object(&mut self, friction: f64, mass: f64) {
        let factor = |factor: f64| if factor.is_finite() && factor > 0.0 { factor } else { 1.0 };
        let (friction, mass) = (factor(friction), factor(mass));
        self.engine.scale_object(friction, mass);
        self.state.mass_factor *= mass;
    }

    pub(crate) fn engine(&self) -> &dyn Engine {
        &*self.engine
    }

    pub(crate) fn state(&self) -> &State {
        &self.state
    }

    pub(crate) fn identity(&self) -> &Identity {
        &self.shared.identity
    }
}
