//! Templates, built once per hand and set of objects, and the worlds that are cloned from them.
//!
//! One object of a world is its target, the first one unless [`World::set_target`] names another: "the object" of the other methods.

use crate::SimError;
use crate::config::{EngineKind, PhysicsConfig};
use crate::engine::{Engine, StepInput, WorldSpec};
use crate::identity::{Identity, identity};
use crate::implicit::Implicit;
use crate::motion::BaseMotion;
use crate::object::ObjectModel;
use crate::rapier::Rapier;
use crate::scenery::{self, Wall};
use graspbox_hand::{ActuatorCommand, ActuatorState, Hand};
use graspbox_mesh::range::{OutOfRange, all_within, in_range, is_pose};
use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;

pub mod carrier;
mod observe;

pub use crate::engine::JointState;

/// Longest step while nothing is in reach, seconds: joints differ by less than 0.03 rad from those of short steps, fingers that swing by most
/// (`tests/rust/long_steps.rs`).
const FREE_TIME: f64 = 0.01;

/// The part of a world's state that is not the engine's.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct State {
    motion: BaseMotion,
    /// Gravity in the world's frame, m/s2.
    gravity: Vector3<f64>,
    /// Force on each object, world's axes, N.
    forces: Vec<Vector3<f64>>,
    /// Factor on the mass of each object.
    mass_factors: Vec<f64>,
    /// Index of the target object.
    target: usize,
    actuators: Vec<ActuatorState>,
    /// Coordinates of the arm that carries the hand, see [`carrier`]; empty without one.
    arm: Vec<f64>,
    /// The arm is far from every object, see [`World::drive_arm`].
    arm_is_far: bool,
    steps: u64,
}

impl State {
    /// Refuses states that no world of this hand can have: a checksum shows damage, not the author.
    fn check(&self, hand: &Hand) -> Result<(), OutOfRange> {
        /// Farther than any hand moves, metres.
        const FARTHEST: f64 = 1e3;
        /// Faster than any hand moves, m/s and rad/s: a kilometre within a step.
        const FASTEST: f64 = 1e6;
        /// More gravity than any planet has, m/s2.
        const HEAVIEST: f64 = 1e3;
        /// More force than any object of a hand bears, N.
        const STRONGEST: f64 = 1e6;
        is_pose("motion.world_from_base", &self.motion.world_from_base, FARTHEST)?;
        all_within("motion.linear", self.motion.linear.iter().copied(), FASTEST, "m/s")?;
        all_within("motion.angular", self.motion.angular.iter().copied(), FASTEST, "rad/s")?;
        all_within("gravity", self.gravity.iter().copied(), HEAVIEST, "m/s2")?;
        all_within("forces", self.forces.iter().flatten().copied(), STRONGEST, "N")?;
        self.mass_factors.iter().try_for_each(|factor| in_range("mass_factors", *factor, 1e-6..=1e6, ""))?;
        in_range("target", self.target as f64, 0.0..=(self.forces.len().max(1) - 1) as f64, "")?;
        in_range("steps", self.steps as f64, 0.0..=1e15, "")?;
        all_within("arm", self.arm.iter().copied(), 1e3, "rad or m")?;
        for (state, actuator) in self.actuators.iter().zip(&hand.actuators) {
            let [low, high] = actuator.travel;
            in_range("actuators.position", state.position, low..=high, "rad or m")?;
            all_within("actuators.velocity", [state.velocity], FASTEST, "rad/s or m/s")?;
            all_within("actuators.load", [state.load], 1e9, "N or N m")?;
        }
        Ok(())
    }
}

/// A world before its first step. A reset clones it and poses the clone.
pub struct Template {
    engine: Box<dyn Engine>,
    shared: Arc<Shared>,
}

/// Data shared by all worlds of one template.
struct Shared {
    hand: Arc<Hand>,
    hand_from_base: Isometry3<f64>,
    config: PhysicsConfig,
    /// By object.
    masses: Vec<f64>,
    objects_from_centers: Vec<Vector3<f64>>,
    /// Radii of spheres about these centres that contain the objects.
    radii: Vec<f64>,
    identity: Identity,
}

/// A table, objects and one hand, simulated in the frame of the hand's base.
pub struct World {
    engine: Box<dyn Engine>,
    shared: Arc<Shared>,
    state: State,
    /// Forces on the objects in the base's frame, kept from step to step.
    forces: Vec<Vector3<f64>>,
    /// The actuators before a long step that may not be taken.
    kept: Vec<ActuatorState>,
}

impl Template {
    /// Builds the world of one object and `hand`.
    ///
    /// # Errors
    /// As [`Template::of_objects`].
    pub fn new(hand: Arc<Hand>, object: &ObjectModel, config: PhysicsConfig) -> Result<Self, SimError> {
        Self::of_objects(hand, std::slice::from_ref(object), &[], config)
    }

    /// Builds the world of `objects`, `walls` and `hand`.
    ///
    /// # Errors
    /// [`SimError`] for a setting or a wall out of range, an object or a hand that cannot be simulated, no object, too many objects or walls.
    pub fn of_objects(
        hand: Arc<Hand>,
        objects: &[ObjectModel],
        walls: &[Wall],
        config: PhysicsConfig,
    ) -> Result<Self, SimError> {
        config.validate()?;
        scenery::check(walls)?;
        if objects.is_empty() {
            return Err(SimError::NoObjects);
        }
        let spec = WorldSpec { hand: &hand, objects, walls, config: &config };
        let engine: Box<dyn Engine> = match config.engine {
            EngineKind::Implicit => Box::new(Implicit::new(spec)?),
            EngineKind::Rapier => Box::new(Rapier::new(spec)?),
        };
        let shared = Shared {
            identity: identity(spec)?,
            hand_from_base: hand.base_from_hand.inverse(),
            hand,
            config,
            masses: objects.iter().map(ObjectModel::mass).collect(),
            objects_from_centers: objects.iter().map(|object| object.center_of_mass().coords).collect(),
            radii: objects.iter().map(ObjectModel::radius).collect(),
        };
        Ok(Self { engine, shared: Arc::new(shared) })
    }

    /// A new world: the hand open at `world_from_hand` with its preshape (rad), the first object at rest at `world_from_object`, all others at
    /// the origin.
    pub fn spawn(&self, world_from_hand: &Isometry3<f64>, world_from_object: &Isometry3<f64>, preshape: f64) -> World {
        let mut poses = vec![Isometry3::identity(); self.object_count()];
        poses[0] = *world_from_object;
        self.place(world_from_hand, &poses, preshape)
    }

    /// A new world: the hand open at `world_from_hand` with its preshape (rad), every object at rest at its pose.
    ///
    /// # Errors
    /// [`SimError::WrongPoses`] if there is not one pose for each object.
    pub fn spawn_objects(
        &self,
        world_from_hand: &Isometry3<f64>,
        world_from_objects: &[Isometry3<f64>],
        preshape: f64,
    ) -> Result<World, SimError> {
        let (poses, objects) = (world_from_objects.len(), self.object_count());
        if poses != objects {
            return Err(SimError::WrongPoses { poses, objects });
        }
        Ok(self.place(world_from_hand, world_from_objects, preshape))
    }

    /// As [`Template::spawn_objects`]; the caller has checked that there is one pose for each object.
    pub fn place(
        &self,
        world_from_hand: &Isometry3<f64>,
        world_from_objects: &[Isometry3<f64>],
        preshape: f64,
    ) -> World {
        let hand = &self.shared.hand;
        let world_from_base = world_from_hand * hand.base_from_hand.inverse();
        let base_from_world = world_from_base.inverse();
        let mut engine = self.engine.duplicate();
        // A preshape that is NaN gives joints that are NaN, which `is_finite` reports.
        let joints = hand.joint_positions(&hand.open_configuration(preshape));
        let joints = joints.unwrap_or_else(|_| vec![f64::NAN; hand.joints.len()]);
        let base_from_objects: Vec<_> = world_from_objects.iter().map(|pose| base_from_world * pose).collect();
        engine.pose(&base_from_world, &base_from_objects, &joints);
        let start = hand.actuators.iter().zip(hand.open_positions(preshape));
        let actuators = start.map(|(actuator, position)| ActuatorState::new(actuator, position)).collect();
        let state = State {
            gravity: Vector3::new(0.0, 0.0, -self.shared.config.gravity),
            forces: vec![Vector3::zeros(); self.object_count()],
            motion: BaseMotion::at_rest(world_from_base),
            mass_factors: vec![1.0; self.object_count()],
            target: 0,
            actuators,
            arm: hand.carrier.as_ref().map(|carrier| carrier::parked(carrier.axes.len())).unwrap_or_default(),
            arm_is_far: true,
            steps: 0,
        };
        World { engine, shared: Arc::clone(&self.shared), state, forces: Vec::new(), kept: Vec::new() }
    }

    /// A world from a saved state of an equal template.
    pub(crate) fn resume(&self, identity: &Identity, state: State, engine_state: &[u8]) -> Result<World, SimError> {
        let hand = &self.shared.hand;
        let arm = hand.carrier.as_ref().map_or(0, |carrier| carrier::parked(carrier.axes.len()).len());
        let counts = [state.forces.len(), state.mass_factors.len(), state.actuators.len(), state.arm.len()];
        let expected = [self.object_count(), self.object_count(), hand.actuators.len(), arm];
        if *identity != self.shared.identity || counts != expected {
            let why = "it belongs to another hand, object or physics setting".to_owned();
            return Err(SimError::BadSnapshot { why });
        }
        state.check(&self.shared.hand).map_err(|error| SimError::BadSnapshot { why: error.to_string() })?;
        let mut engine = self.engine.duplicate();
        engine.load(engine_state)?;
        let world = World { engine, shared: Arc::clone(&self.shared), state, forces: Vec::new(), kept: Vec::new() };
        // The bytes of our own solver were checked number by number. Those of rapier are its arenas, which name each other by index.
        if self.shared.config.engine == EngineKind::Rapier && !world.survives_a_step() {
            return Err(SimError::BadSnapshot { why: "the engine cannot step from it".to_owned() });
        }
        Ok(world)
    }

    /// Height above the table of the lowest point of the first object's collision geometry at pose `world_from_object`, metres.
    pub fn lowest_point(&self, world_from_object: &Isometry3<f64>) -> f64 {
        self.engine.lowest_point(0, world_from_object)
    }

    /// Hash of everything that the template is built from: hand, objects, walls and settings.
    pub fn identity(&self) -> &[u8; 32] {
        &self.shared.identity
    }

    pub fn object_count(&self) -> usize {
        self.shared.masses.len()
    }

    pub fn hand(&self) -> &Arc<Hand> {
        &self.shared.hand
    }

    pub fn config(&self) -> &PhysicsConfig {
        &self.shared.config
    }
}

impl Clone for World {
    fn clone(&self) -> Self {
        let (engine, shared) = (self.engine.duplicate(), Arc::clone(&self.shared));
        Self { engine, shared, state: self.state.clone(), forces: Vec::new(), kept: Vec::new() }
    }
}

impl World {
    /// Advances by one time step: the hand reaches `world_from_hand` at its end, the actuators follow their commands.
    ///
    /// * `commands`: one per actuator, in the order of the hand's actuators; actuators without a command hold their position.
    ///
    /// # Errors
    /// [`SimError::BadCommand`] for a command that is not finite; the world is then unchanged.
    pub fn step(&mut self, world_from_hand: &Isometry3<f64>, commands: &[ActuatorCommand]) -> Result<(), SimError> {
        self.check(commands)?;
        self.drive_actuators(commands, 1)?;
        let dt = self.shared.config.dt;
        let (engine, input) = self.input(world_from_hand, dt);
        engine.step(&input);
        self.state.steps += 1;
        Ok(())
    }

    /// As [`World::step`], for several time steps at once, if the objects rest, the hand touches nothing, and nothing comes within reach in that
    /// time. Returns whether it did; if not, the world is as before.
    ///
    /// * `steps`: at most [`World::free_steps`].
    ///
    /// # Errors
    /// As [`World::step`].
    pub fn step_freely(
        &mut self,
        world_from_hand: &Isometry3<f64>,
        commands: &[ActuatorCommand],
        steps: u32,
    ) -> Result<bool, SimError> {
        if !self.engine.is_free() {
            return Ok(false);
        }
        self.check(commands)?;
        self.kept.clone_from(&self.state.actuators);
        let motion = self.state.motion;
        self.drive_actuators(commands, steps)?;
        let duration = f64::from(steps) * self.shared.config.dt;
        let (engine, input) = self.input(world_from_hand, duration);
        let stepped = engine.step_freely(&input, steps);
        if stepped {
            self.state.steps += u64::from(steps);
        } else {
            std::mem::swap(&mut self.kept, &mut self.state.actuators);
            self.state.motion = motion;
        }
        Ok(stepped)
    }

    /// Most time steps that [`World::step_freely`] takes at once.
    pub fn free_steps(&self) -> u32 {
        (FREE_TIME / self.shared.config.dt + 1e-9) as u32
    }

    /// False if [`World::step_freely`] is sure to return false.
    pub fn is_free(&self) -> bool {
        self.engine.is_free()
    }

    /// Moves the base to the hand's pose at the end of a step of `dt` seconds. Returns the engine, and its input.
    #[inline]
    fn input(&mut self, world_from_hand: &Isometry3<f64>, dt: f64) -> (&mut dyn Engine, StepInput<'_>) {
        let base_from_world = self.state.motion.world_from_base.inverse();
        let target = world_from_hand * self.shared.hand_from_base;
        let frame = self.state.motion.advance(target, dt, &self.state.gravity);
        let base_from_world_after = target.inverse();
        self.forces.clear();
        self.forces.extend(self.state.forces.iter().map(|force| base_from_world.rotation * force));
        let input = StepInput {
            base_from_world,
            base_from_world_after,
            frame,
            forces: &self.forces,
            actuators: &self.state.actuators,
            arm: &self.state.arm,
            arm_is_far: self.state.arm_is_far,
        };
        (&mut *self.engine, input)
    }

    /// Whether a copy can be observed and stepped with the hand at rest.
    fn survives_a_step(&self) -> bool {
        let step = || {
            let mut copy = self.clone();
            let hand = copy.world_from_hand();
            let stepped = copy.step(&hand, &[]).is_ok();
            stepped && copy.hand_load().force.iter().all(|x| x.is_finite()) && copy.is_finite()
        };
        catch_unwind(AssertUnwindSafe(step)).unwrap_or(false)
    }

    /// Checks all commands before the first actuator moves.
    fn check(&self, commands: &[ActuatorCommand]) -> Result<(), SimError> {
        let known = commands.iter().take(self.shared.hand.actuators.len());
        match known.into_iter().position(|command| !command.is_finite()) {
            Some(actuator) => Err(SimError::BadCommand { actuator }),
            None => Ok(()),
        }
    }

    /// Moves the actuators by `steps` time steps, against their present loads.
    fn drive_actuators(&mut self, commands: &[ActuatorCommand], steps: u32) -> Result<(), SimError> {
        let (hand, dt) = (&self.shared.hand, self.shared.config.dt);
        for (index, (actuator, command)) in hand.actuators.iter().zip(commands).enumerate() {
            let load = self.load(index);
            if !load.is_finite() {
                // The simulation diverged, which `has_diverged` reports; the command is not at fault.
                continue;
            }
            let state = &mut self.state.actuators[index];
            for _ in 0..steps {
                state.step(actuator, *command, load, dt).map_err(|_| SimError::BadCommand { actuator: index })?;
            }
        }
        Ok(())
    }

    /// Takes all objects for at rest where they are, as after a settling: those that stay slow for 10 ms then cost nothing until something touches
    /// them. An object that would fall over very slowly stays, too.
    pub fn expect_rest(&mut self) {
        self.engine.expect_rest();
    }

    /// Sets gravity in the world's frame, m/s2, for example for a tilted table.
    pub fn set_gravity(&mut self, gravity: &Vector3<f64>) {
        self.state.gravity = *gravity;
        self.engine.wake();
    }

    /// Sets a force on the object's centre of mass, N, world's axes; it acts until it is set again, and a new world has none.
    ///
    /// * `force`: finite; another counts as none.
    pub fn set_object_force(&mut self, force: &Vector3<f64>) {
        let finite = force.iter().all(|x| x.is_finite());
        self.state.forces[self.state.target] = if finite { *force } else { Vector3::zeros() };
    }

    /// Sets the object's velocity in the world's frame (m/s, of the centre of mass, and rad/s), for physics tests.
    pub fn set_object_velocity(&mut self, linear: &Vector3<f64>, angular: &Vector3<f64>) {
        let base_from_world = self.state.motion.world_from_base.rotation.inverse();
        let arm = self.object_center() - Point3::from(self.state.motion.world_from_base.translation.vector);
        let frame = self.state.motion.linear + self.state.motion.angular.cross(&arm);
        let (linear, angular) =
            (base_from_world * (linear - frame), base_from_world * (angular - self.state.motion.angular));
        self.engine.set_object_velocity(self.state.target, &linear, &angular);
    }

    /// Multiplies the object's friction factor, and its mass and inertia: domain randomization of one world.
    ///
    /// * `friction`, `mass`: positive factors; other values count as 1.
    pub fn scale_object(&mut self, friction: f64, mass: f64) {
        let factor = |factor: f64| if factor.is_finite() && factor > 0.0 { factor } else { 1.0 };
        let (friction, mass) = (factor(friction), factor(mass));
        self.engine.scale_object(self.state.target, friction, mass);
        self.state.mass_factors[self.state.target] *= mass;
    }

    /// As [`World::scale_object`], for every object.
    pub fn scale_objects(&mut self, friction: f64, mass: f64) {
        let target = self.state.target;
        for object in 0..self.object_count() {
            self.set_target(object);
            self.scale_object(friction, mass);
        }
        self.set_target(target);
    }

    /// Makes an object the target, to which the other methods refer as "the object".
    ///
    /// * `object`: another index than that of an object changes nothing.
    pub fn set_target(&mut self, object: usize) {
        if object < self.object_count() {
            self.state.target = object;
        }
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
