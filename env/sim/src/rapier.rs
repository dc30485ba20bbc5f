//! The engine `rapier` ([`rapier3d`]): chains in reduced coordinates, contacts solved in sub-steps of projected Gauss-Seidel.
//!
//! | module | purpose |
//! |---|---|
//! | `build` | assembly of bodies, joints and colliders |
//! | `shape` | collision shapes of the object and of the hand's links |
//! | `joints` | joint forces, written into rapier's joint springs |
//! | `forces` | fictitious forces of the moving frame |
//! | `contacts` | contact points for the interface of [`crate::engine`] |
//! | `frames` | conversions of units and types |

mod build;
mod contacts;
mod forces;
mod frames;
mod joints;
mod shape;

use crate::SimError;
use crate::config::PhysicsConfig;
use crate::engine::{Contact, Engine, JointState, Part, StepInput, WorldSpec};
use build::Handles;
use forces::FrameForces;
use graspbox_hand::Hand;
use graspbox_solver::dispatch::Dispatcher;
use nalgebra::{Isometry3, Vector3};
use rapier3d::prelude::*;
use std::sync::Arc;

/// A joint below this speed counts as at rest, rad/s: joints sway in their springs while the hand moves.
const STILL: f64 = 0.2;

/// An object that rotates faster than this tumbles, rad/s.
const TUMBLING: f64 = 1.0;

/// One world of rapier; its unit of length is the centimetre.
pub(crate) struct Rapier {
    physics: PhysicsWorld,
    /// Tension of every tendon, N.
    tensions: Vec<f64>,
    shared: Arc<Shared>,
}

/// Data shared by an engine and its copies.
struct Shared {
    hand: Arc<Hand>,
    handles: Handles,
    config: PhysicsConfig,
}

impl Rapier {
    /// Assembles rapier's world.
    ///
    /// # Errors
    /// [`SimError::NoParts`], [`SimError::FlatPart`], [`SimError::BadHand`] or [`SimError::TooManyObjects`].
    pub(crate) fn new(spec: WorldSpec) -> Result<Self, SimError> {
        if spec.objects.len() > graspbox_solver::MAX_OBJECTS {
            return Err(SimError::TooManyObjects { count: spec.objects.len() });
        }
        if spec.hand.carrier.is_some() {
            let why = "it does not simulate the arm that carries it".to_owned();
            return Err(SimError::BadHand { hand: spec.hand.name.clone(), engine: "rapier", why });
        }
        let (physics, handles) = build::build(spec)?;
        let tensions = vec![0.0; spec.hand.tendons.len()];
        let shared = Shared { hand: Arc::clone(spec.hand), handles, config: *spec.config };
        Ok(Self { physics, tensions, shared: Arc::new(shared) })
    }

    fn body(&self, handle: RigidBodyHandle) -> &RigidBody {
        &self.physics.bodies[handle]
    }

    fn object(&self, object: usize) -> &RigidBody {
        self.body(self.shared.handles.objects[object].body)
    }

    fn drive_joints(&mut self, input: &StepInput) {
        let Shared { hand, handles, config } = &*self.shared;
        joints::actuate(&mut self.physics, hand, handles, input, config.dt, &mut self.tensions);
        joints::drive_rigid(&mut self.physics, hand, handles, input, config.dt);
    }

    /// True while the hand touches nothing and does not move, and the only object does not tumble: at most an object on the table is left to
    /// solve.
    fn idles(&self, input: &StepInput) -> bool {
        let still = |joint| joints::joint_state(&self.physics, joint).speed.abs() < STILL;
        let [object] = self.shared.handles.objects[..] else { return false };
        let spin = frames::vector64(self.body(object.body).angvel());
        let spin_in_world = input.base_from_world_after.rotation.inverse() * spin
            + input.base_from_world.rotation.inverse() * input.frame.omega;
        input.actuators.iter().all(|actuator| actuator.velocity == 0.0)
            && spin_in_world.norm() < TUMBLING
            && self.shared.handles.free_joints().all(still)
            && !contacts::hand_in_contact(&self.physics)
    }

    /// True if forces of the last step still act on the bodies: rapier keeps them until they are reset.
    fn bears_forces(&self) -> bool {
        self.shared.handles.moving_bodies().any(|handle| {
            let body = self.body(handle);
            body.user_force() != Vector::ZERO || body.user_torque() != Vector::ZERO
        })
    }
}

impl Engine for Rapier {
    fn duplicate(&self) -> Box<dyn Engine> {
        Box::new(Self {
            physics: clone_physics(&self.physics),
            tensions: self.tensions.clone(),
            shared: Arc::clone(&self.shared),
        })
    }

    fn pose(&mut self, base_from_world: &Isometry3<f64>, base_from_objects: &[Isometry3<f64>], joints: &[f64]) {
        let Shared { hand, handles, .. } = &*self.shared;
        let objects = handles.objects.iter().map(|object| object.body).zip(base_from_objects);
        for (body, pose) in objects.chain([(handles.scenery, base_from_world)]) {
            if let Some(body) = self.physics.bodies.get_mut(body) {
                body.set_position(frames::pose(pose), true);
            }
        }
        joints::set_positions(&mut self.physics, handles, joints);
        build::place_links(&mut self.physics, hand, handles);
    }

    // No template with an arm is made.
    fn place_arm(&mut self, _arm: &[f64]) {}

    fn step(&mut self, input: &StepInput) {
        self.drive_joints(input);
        let forces = FrameForces::new(&input.frame);
        self.physics.gravity = forces.gravity;
        let pushed = input.forces.iter().any(|force| *force != Vector3::zeros());
        if pushed || forces.turning() || self.bears_forces() {
            for body in self.shared.handles.moving_bodies() {
                if let Some(body) = self.physics.bodies.get_mut(body) {
                    forces.apply(body);
                }
            }
        }
        for (object, force) in self.shared.handles.objects.iter().zip(input.forces) {
            if *force != Vector3::zeros()
                && let Some(body) = self.physics.bodies.get_mut(object.body)
            {
                body.add_force(frames::lengths(force), true);
            }
        }
        if let Some(body) = self.physics.bodies.get_mut(self.shared.handles.scenery) {
            body.set_next_kinematic_position(frames::pose(&input.base_from_world_after));
        }
        let config = &self.shared.config.rapier;
        self.physics.integration_parameters.num_solver_iterations =
            if self.idles(input) { config.idle_iterations } else { config.solver_iterations };
        self.physics.step_with_events(&contacts::NoContact(&self.shared.hand), &());
    }

    fn tension(&self, tendon: usize) -> f64 {
        self.tensions[tendon]
    }

    fn joint(&self, joint: usize) -> JointState {
        match &self.shared.handles.joints[joint] {
            Some(handle) => joints::joint_state(&self.physics, handle),
            None => JointState { position: 0.0, speed: 0.0 },
        }
    }

    fn base_from_object(&self, object: usize) -> Isometry3<f64> {
        frames::isometry(self.object(object).position())
    }

    fn object_velocity(&self, object: usize) -> (Vector3<f64>, Vector3<f64>) {
        let body = self.object(object);
        (frames::metres64(body.linvel()), frames::vector64(body.angvel()))
    }

    fn set_object_velocity(&mut self, object: usize, linear: &Vector3<f64>, angular: &Vector3<f64>) {
        if let Some(body) = self.physics.bodies.get_mut(self.shared.handles.objects[object].body) {
            body.set_linvel(frames::lengths(linear), true);
            body.set_angvel(frames::vector(angular), true);
        }
    }

    fn scale_object(&mut self, object: usize, friction: f64, mass: f64) {
        let handle = self.shared.handles.objects[object];
        if friction != 1.0
            && let Some(collider) = self.physics.colliders.get_mut(handle.collider)
        {
            collider.set_friction(collider.friction() * friction as f32);
        }
        if mass != 1.0
            && let Some(body) = self.physics.bodies.get_mut(handle.body)
        {
            let mut properties = body.mass_properties().local_mprops;
            if properties.inv_mass == 0.0 {
                // Before the first step, rapier has not summed the mass properties yet.
                body.recompute_mass_properties_from_colliders(&self.physics.colliders);
                properties = body.mass_properties().local_mprops;
            }
            properties.set_mass(properties.mass() * mass as f32, true);
            body.set_additional_mass_properties(properties, true);
        }
    }

    fn lowest_point(&self, object: usize, from_object: &Isometry3<f64>) -> f64 {
        let shape = self.physics.colliders[self.shared.handles.objects[object].collider].shape();
        frames::metres(shape.compute_aabb(&frames::pose(from_object)).mins.z)
    }

    fn contacts(&self, wanted: &dyn Fn([Part; 2]) -> bool, visit: &mut dyn FnMut(&Contact)) {
        contacts::visit(&self.physics, &self.shared.handles, wanted, visit);
    }

    fn is_finite(&self) -> bool {
        let finite = |handle| {
            let body = self.body(handle);
            body.position().is_finite() && body.linvel().is_finite() && body.angvel().is_finite()
        };
        self.tensions.iter().all(|tension| tension.is_finite()) && self.shared.handles.moving_bodies().all(finite)
    }

    /// Rapier takes a fixed number of sub-steps and measures no residual.
    fn unconverged_steps(&self) -> u64 {
        0
    }

    fn save(&self) -> Result<Vec<u8>, SimError> {
        postcard::to_allocvec(&(&self.physics, &self.tensions))
            .map_err(|_| SimError::BadSnapshot { why: "the engine's state could not be written".into() })
    }

    fn load(&mut self, bytes: &[u8]) -> Result<(), SimError> {
        let bad = |why: &str| SimError::BadSnapshot { why: why.into() };
        let (mut physics, tensions): (PhysicsWorld, Vec<f64>) =
            postcard::from_bytes(bytes).map_err(|_| bad("its content cannot be read"))?;
        let same = tensions.len() == self.tensions.len()
            && physics.bodies.len() == self.physics.bodies.len()
            && physics.colliders.len() == self.physics.colliders.len();
        if !same {
            return Err(bad("it belongs to another hand or object"));
        }
        physics.narrow_phase.set_query_dispatcher(Dispatcher::default());
        (self.physics, self.tensions) = (physics, tensions);
        Ok(())
    }
}

/// A copy of rapier's world without its workspaces, which carry no state from step to step.
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
