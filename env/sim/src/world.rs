//! The world: a template that is built once per object, and the worlds that are cloned from it, stepped and observed.

use crate::build::{self, Handles, Part};
use crate::config::PhysicsConfig;
use crate::dispatch::Dispatcher;
use crate::finger::{self, JointState};
use crate::identity::{Identity, identity};
use crate::motion::BaseMotion;
use crate::object::ObjectModel;
use crate::{SimError, frames};
use graspbox_hand::{Hand, MotorCommand, MotorKind, MotorState};
use nalgebra::{Isometry3, Point3, Vector3};
use rapier3d::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

mod observe;

pub use observe::FingerState;

/// A joint below this speed is still, rad/s: it sways in its flexure when the hand is moved.
const STILL: f64 = 0.2;

/// An object that turns faster than this tumbles, rad/s.
const TUMBLING: f64 = 1.0;

/// What changes from step to step, beside the engine's own state.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct State {
    motion: BaseMotion,
    /// Gravity in the world's frame, m/s2.
    gravity: Vector3<f64>,
    motors: Vec<MotorState>,
    /// Tension of every finger's tendon, N.
    tensions: Vec<f64>,
    steps: u64,
}

/// A world before its first step: cloning it and posing the clone is the only reset there is.
pub struct Template {
    physics: PhysicsWorld,
    shared: Arc<Shared>,
}

/// What all worlds of one template share.
struct Shared {
    hand: Arc<Hand>,
    handles: Handles,
    config: PhysicsConfig,
    mass: f64,
    object_from_center: Vector3<f64>,
    identity: Identity,
}

/// A table, one object and one hand, simulated in the frame of the hand's base.
pub struct World {
    physics: PhysicsWorld,
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
        let (physics, handles) = build::build(&hand, object, &config, &Isometry3::identity(), &Isometry3::identity())?;
        let shared = Shared {
            identity: identity(&hand, object, &config)?,
            hand,
            handles,
            config,
            mass: object.mass(),
            object_from_center: object.center_of_mass().coords,
        };
        Ok(Self { physics, shared: Arc::new(shared) })
    }

    /// A fresh world: the hand open at `world_from_hand` with its preshape (rad), the object at rest at `world_from_object`.
    pub fn spawn(&self, world_from_hand: &Isometry3<f64>, world_from_object: &Isometry3<f64>, preshape: f64) -> World {
        let hand = &self.shared.hand;
        let world_from_base = world_from_hand * hand.base_from_hand.inverse();
        let base_from_world = world_from_base.inverse();
        let mut physics = clone_physics(&self.physics);
        let handles = &self.shared.handles;
        let pose = |x: &Isometry3<f64>| frames::pose(x);
        if let Some(body) = physics.bodies.get_mut(handles.scenery) {
            body.set_position(pose(&base_from_world), true);
        }
        if let Some(body) = physics.bodies.get_mut(handles.object) {
            body.set_position(pose(&(base_from_world * world_from_object)), true);
        }
        set_swivels(&mut physics, hand, handles, preshape);
        build::place_links(&mut physics, handles);
        let start = |m: &graspbox_hand::Motor| if m.kind == MotorKind::Preshape { preshape } else { 0.0 };
        let motors = hand.motors.iter().map(|m| MotorState::new(m, start(m))).collect();
        let tensions = vec![0.0; hand.fingers.len()];
        let state = State {
            gravity: Vector3::new(0.0, 0.0, -self.shared.config.gravity),
            motion: BaseMotion::at_rest(world_from_base),
            motors,
            tensions,
            steps: 0,
        };
        World { physics, shared: Arc::clone(&self.shared), state }
    }

    /// A world from a saved state, if that state is of an equal template.
    pub(crate) fn resume(&self, identity: &Identity, mut physics: PhysicsWorld, state: State) -> Option<World> {
        physics.narrow_phase.set_query_dispatcher(Dispatcher);
        let hand = &self.shared.hand;
        let same = *identity == self.shared.identity
            && state.motors.len() == hand.motors.len()
            && state.tensions.len() == hand.fingers.len()
            && physics.bodies.len() == self.physics.bodies.len()
            && physics.colliders.len() == self.physics.colliders.len();
        same.then(|| World { physics, shared: Arc::clone(&self.shared), state })
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

fn set_swivels(physics: &mut PhysicsWorld, hand: &Hand, handles: &Handles, preshape: f64) {
    for (finger, handles) in hand.fingers.iter().zip(&handles.fingers) {
        let (Some((_, sign)), Some(handle)) = (finger.swivel, handles.swivel) else {
            continue;
        };
        let Some((multibody, link)) = physics.multibody_joints.get_mut(handle) else {
            continue;
        };
        let mut displacement = vec![0.0; multibody.ndofs()];
        if let Some(link) = multibody.link(link) {
            displacement[link.assembly_id()] = (sign * preshape) as f32;
        }
        multibody.apply_displacements(&displacement);
    }
}

/// The engine's world without its workspaces, which carry nothing from step to step.
fn clone_physics(w: &PhysicsWorld) -> PhysicsWorld {
    PhysicsWorld {
        gravity: w.gravity,
        integration_parameters: w.integration_parameters,
        physics_pipeline: PhysicsPipeline::new(),
        collision_pipeline: CollisionPipeline::new(),
        islands: w.islands.clone(),
        broad_phase: w.broad_phase.clone(),
        narrow_phase: w.narrow_phase.clone(),
        bodies: w.bodies.clone(),
        colliders: w.colliders.clone(),
        impulse_joints: w.impulse_joints.clone(),
        multibody_joints: w.multibody_joints.clone(),
        soft_bodies: w.soft_bodies.clone(),
        ccd_solver: CCDSolver::new(),
    }
}

impl Clone for World {
    fn clone(&self) -> Self {
        Self { physics: clone_physics(&self.physics), shared: Arc::clone(&self.shared), state: self.state.clone() }
    }
}

impl World {
    /// Advances by one time step: the hand reaches `world_from_hand` at its end, the motors follow their commands.
    ///
    /// `commands` has one entry a motor, in the order of the hand's motors; missing ones hold still.
    ///
    /// # Errors
    /// [`SimError::BadCommand`] for a command that is not finite; nothing moves then.
    pub fn step(&mut self, world_from_hand: &Isometry3<f64>, commands: &[MotorCommand]) -> Result<(), SimError> {
        let dt = self.shared.config.dt;
        self.drive_motors(commands, dt)?;
        self.drive_fingers(dt);
        let target = world_from_hand * self.shared.hand.base_from_hand.inverse();
        let forces = self.state.motion.advance(target, dt, &self.state.gravity);
        self.physics.gravity = forces.gravity;
        if forces.turning() || self.bears_frame_forces() {
            let fingers = self.shared.handles.fingers.iter().flat_map(|f| f.bodies);
            for body in fingers.chain([self.shared.handles.object]) {
                if let Some(body) = self.physics.bodies.get_mut(body) {
                    forces.apply(body);
                }
            }
        }
        if let Some(body) = self.physics.bodies.get_mut(self.shared.handles.scenery) {
            body.set_next_kinematic_position(frames::pose(&target.inverse()));
        }
        let config = &self.shared.config;
        self.physics.integration_parameters.num_solver_iterations =
            if self.idles() { config.idle_iterations } else { config.solver_iterations };
        self.physics.step();
        self.state.steps += 1;
        Ok(())
    }

    /// True while the hand is in contact with nothing, nothing in it moves and the object does not tumble: what is left to solve
    /// is at most an object on the table.
    fn idles(&self) -> bool {
        let still = |finger: usize| {
            let finger = self.finger(finger);
            finger.proximal_speed.abs() < STILL && finger.distal_speed.abs() < STILL
        };
        let motion = &self.state.motion;
        let spin = frames::vector64(self.body(self.shared.handles.object).angvel());
        self.state.motors.iter().all(|m| m.velocity == 0.0)
            && (motion.world_from_base.rotation * spin + motion.angular).norm() < TUMBLING
            && (0..self.shared.hand.fingers.len()).all(still)
            && !self.hand_in_contact()
    }

    /// True where the frame's forces of the last step are still on the bodies: the engine keeps them until they are taken off.
    fn bears_frame_forces(&self) -> bool {
        let fingers = self.shared.handles.fingers.iter().flat_map(|f| f.bodies);
        fingers.chain([self.shared.handles.object]).any(|handle| {
            let body = self.body(handle);
            body.user_force() != Vector::ZERO || body.user_torque() != Vector::ZERO
        })
    }

    fn drive_motors(&mut self, commands: &[MotorCommand], dt: f64) -> Result<(), SimError> {
        let shared = Arc::clone(&self.shared);
        for (i, motor) in shared.hand.motors.iter().enumerate() {
            let Some(command) = commands.get(i) else { continue };
            let load = match motor.kind {
                MotorKind::Finger(finger) => self.state.tensions[finger],
                // The swivel's gear holds against any load of a grasp.
                MotorKind::Preshape => 0.0,
            };
            let motor_state = &mut self.state.motors[i];
            motor_state.step(motor, *command, load, dt).map_err(|_| SimError::BadCommand { motor: i })?;
        }
        Ok(())
    }

    fn drive_fingers(&mut self, dt: f64) {
        let hand = Arc::clone(&self.shared.hand);
        let preshape = hand.preshape_motor();
        for (i, finger) in hand.fingers.iter().enumerate() {
            let handles = self.shared.handles.fingers[i];
            let MotorState { position: angle, velocity: speed, .. } = self.state.motors[finger.motor];
            let joints = [&hand.joints[finger.proximal], &hand.joints[finger.distal]];
            let spool = JointState { angle, speed };
            self.state.tensions[i] = finger::actuate(&mut self.physics, finger, joints, &handles, spool, dt);
            if let (Some((_, sign)), Some(handle), Some(motor)) = (finger.swivel, handles.swivel, preshape) {
                let goal = sign * hand.preshape_angle(self.state.motors[motor].position);
                let speed = (goal - finger::joint_state(&self.physics, handle).angle) / dt;
                if let Some((multibody, link)) = self.physics.multibody_joints.get_mut(handle)
                    && let Some(id) = multibody.link(link).map(|l| l.assembly_id())
                {
                    multibody.generalized_velocity_mut()[id] = speed as f32;
                }
            }
        }
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
        if let Some(body) = self.physics.bodies.get_mut(self.shared.handles.object) {
            body.set_linvel(frames::lengths(&linear), true);
            body.set_angvel(frames::vector(&angular), true);
        }
    }

    /// Multiplies the object's friction factor and its mass (with its inertia), for a world that varies from its template.
    ///
    /// * `friction`, `mass`: positive factors; others change nothing.
    pub fn scale_object(&mut self, friction: f64, mass: f64) {
        let handles = &self.shared.handles;
        let usable = |factor: f64| factor.is_finite() && factor > 0.0 && factor != 1.0;
        if usable(friction)
            && let Some(collider) = self.physics.colliders.get_mut(handles.object_collider)
        {
            collider.set_friction(collider.friction() * friction as f32);
        }
        if usable(mass)
            && let Some(body) = self.physics.bodies.get_mut(handles.object)
        {
            let mut properties = body.mass_properties().local_mprops;
            if properties.inv_mass == 0.0 {
                // Not stepped yet: the engine adds the properties up in its first step.
                body.recompute_mass_properties_from_colliders(&self.physics.colliders);
                properties = body.mass_properties().local_mprops;
            }
            properties.set_mass(properties.mass() * mass as f32, true);
            body.set_additional_mass_properties(properties, true);
        }
    }

    pub(crate) fn body(&self, handle: RigidBodyHandle) -> &RigidBody {
        &self.physics.bodies[handle]
    }

    pub(crate) fn physics(&self) -> &PhysicsWorld {
        &self.physics
    }

    pub(crate) fn state(&self) -> &State {
        &self.state
    }

    pub(crate) fn identity(&self) -> &Identity {
        &self.shared.identity
    }

    pub(crate) fn handles(&self) -> &Handles {
        &self.shared.handles
    }

    pub(crate) fn part(&self, collider: ColliderHandle) -> Part {
        Part::of(&self.physics.colliders[collider])
    }
}
