//! The solver of one world: its state, and one time step.

mod free;
pub(crate) mod saved;
pub(crate) mod sleep;

use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

use crate::contact::{Contact, Side};
use crate::dynamics::{Dynamics, FrameMotion, TreeMotion};
use crate::kinematics::{Kinematics, Twist};
use crate::model::{BodyIndex, BodyKind, Model};
use crate::problem::Problem;
use crate::problem::islands::Islands;
use crate::problem::newton::Newton;
use crate::problem::objects::own_twist;
use crate::problem::rows::{self, PointSource};
use crate::scenery::Surface;
use crate::search::{BodyMotion, Opposite, Searcher, Situation};
use crate::solver::free::Springs;
use crate::solver::sleep::{Load, rests};

/// Inputs of one step.
pub struct StepInput<'a> {
    /// Duration, seconds.
    pub dt: f64,
    /// The world in the base's frame at the beginning of the step.
    pub base_from_world: Isometry3<f64>,
    /// The same at the end of the step.
    pub base_from_world_after: Isometry3<f64>,
    /// Motion of the base's frame during the step.
    pub frame: FrameMotion,
    /// Force on the centre of mass of each object, N, base's axes; objects beyond the list feel none.
    pub forces: &'a [Vector3<f64>],
    /// Driven coordinates at the end of the step, rad or m.
    pub driven: &'a [f64],
    /// Command of every cable.
    pub cables: &'a [CableCommand],
    /// Number of the last bodies of the tree that touch nothing in this step, which saves their time. Only driven coordinates may move them.
    pub idle: usize,
}

/// Command to a cable: the length that its actuator has wound (for a servo, the commanded position).
#[derive(Clone, Copy, Debug, Default)]
pub struct CableCommand {
    /// At the end of the step, metres (servo: rad or m).
    pub length: f64,
    /// Its rate during the step, m/s (servo: rad/s or m/s).
    pub rate: f64,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ObjectState {
    /// The object in the base's frame.
    pub base_from_object: Isometry3<f64>,
    /// Velocity of its centre of mass in the base's frame, m/s.
    pub linear: Vector3<f64>,
    /// Its angular velocity in the base's frame, rad/s.
    pub angular: Vector3<f64>,
    /// Factor on its friction.
    pub friction_factor: f64,
    /// Factor on its mass and inertia.
    pub mass_factor: f64,
    /// For how long it has been slow, seconds.
    pub slow_for: f64,
    /// The object in the world while it sleeps; `None` while it is simulated.
    pub asleep: Option<Isometry3<f64>>,
}

impl Default for ObjectState {
    fn default() -> Self {
        Self {
            base_from_object: Isometry3::identity(),
            linear: Vector3::zeros(),
            angular: Vector3::zeros(),
            friction_factor: 1.0,
            mass_factor: 1.0,
            slow_for: 0.0,
            asleep: None,
        }
    }
}

/// The state that a world carries from step to step.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct State {
    pub objects: Vec<ObjectState>,
    /// Coordinates, the driven ones last, rad or m.
    pub positions: Vec<f64>,
    /// Their rates, rad/s or m/s.
    pub rates: Vec<f64>,
    /// Forces of the cables, N.
    pub cable_forces: Vec<f64>,
    /// Steps in which the iteration did not converge.
    pub unconverged_steps: u64,
}

/// The solver of one world.
#[derive(Clone)]
pub struct Solver {
    model: Arc<Model>,
    state: State,
    searcher: Searcher,
    kinematics: Kinematics,
    dynamics: Dynamics,
    problem: Problem,
    islands: Islands,
    newton: Newton,
    /// By [`crate::BodyIndex`], at the beginning of the last step.
    poses: Vec<Isometry3<f64>>,
    turns: Vec<Matrix3<f64>>,
    /// Reference point of the last step.
    referred: Vector3<f64>,
    /// The candidate behind each point of the problem.
    sources: Vec<PointSource>,
    /// Contacts of a loaded state, until the next step.
    loaded: Vec<Contact>,
    moving: Vec<BodyMotion>,
    accelerations: Vec<f64>,
    friction_factors: Vec<f64>,
    /// By object: whether it sleeps.
    asleep: Vec<bool>,
    /// Rates before a long step that may not be taken.
    kept_rates: Vec<f64>,
    /// By object: whether the hand may touch it in this step.
    touched: Vec<bool>,
    loads: Vec<Load>,
    /// Contacts of the sleepers when they fell asleep, frame of the world; also with objects that have woken since.
    rested: Vec<Contact>,
}

impl Solver {
    /// A world in which all coordinates are 0 and all objects are at the origin.
    #[must_use]
    pub fn new(model: Arc<Model>) -> Self {
        let count = model.tree.coordinates.len() + model.tree.driven;
        let state = State {
            objects: vec![ObjectState::default(); model.object_count()],
            positions: vec![0.0; count],
            rates: vec![0.0; count],
            cable_forces: vec![0.0; model.tree.cables.len()],
            unconverged_steps: 0,
        };
        Self {
            searcher: Searcher::new(&model),
            kinematics: Kinematics::default(),
            dynamics: Dynamics::default(),
            problem: Problem::new(&model),
            islands: Islands::default(),
            newton: Newton::default(),
            poses: Vec::new(),
            turns: Vec::new(),
            referred: Vector3::zeros(),
            sources: Vec::new(),
            loaded: Vec::new(),
            moving: Vec::new(),
            accelerations: vec![0.0; count],
            friction_factors: Vec::new(),
            asleep: Vec::new(),
            kept_rates: Vec::new(),
            touched: Vec::new(),
            loads: Vec::new(),
            rested: Vec::new(),
            state,
            model,
        }
    }

    /// The data that this world shares with others.
    #[must_use]
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    #[must_use]
    pub fn state(&self) -> &State {
        &self.state
    }

    /// The present state, to pose the world; wakes all objects. The lengths of its lists must not change.
    pub fn state_mut(&mut self) -> &mut State {
        self.state.objects.iter_mut().for_each(ObjectState::wake);
        self.rested.clear();
        &mut self.state
    }

    /// True while every number of the state is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let state = &self.state;
        let mut coordinates = state.rates.iter().chain(&state.positions).chain(&state.cable_forces);
        let finite = |object: &ObjectState| {
            let place = &object.base_from_object.translation.vector;
            [&object.linear, &object.angular, place].iter().flat_map(|v| v.iter()).all(|x| x.is_finite())
        };
        state.objects.iter().all(finite) && coordinates.all(|x| x.is_finite())
    }

    /// Advances by one step.
    pub fn step(&mut self, input: &StepInput) {
        let model = Arc::clone(&self.model);
        let (reference, scenery) = self.begin(&model, input, Springs::Explicit);
        let balanced = loop {
            self.find_contacts(&model, input, &reference, scenery);
            let balanced = self.solve(&model, &scenery);
            if !self.wake_loaded(&model, input) {
                break balanced;
            }
            self.rewind();
        };
        self.state.unconverged_steps += u64::from(!balanced);
        self.end(&model, input, &scenery, &reference);
    }

    /// Moves what is prescribed, and computes mass and momenta. Returns the reference point of all twists, and the twist of the scenery there.
    #[inline]
    fn begin(&mut self, model: &Model, input: &StepInput, springs: Springs) -> (Vector3<f64>, Twist) {
        let free = model.tree.coordinates.len();
        self.drive(model, input);
        self.pose_sleepers(input);
        let reference = self.reference();
        let scenery = scenery_twist(input, &reference);
        self.kinematics.idle = input.idle;
        self.kinematics.place(model, &self.state.positions);
        self.kinematics.differentiate(model, &reference, &self.state.rates[free..]);
        let mass = &mut self.problem.hand.mass;
        let (velocity, acceleration) = (&*self.state.rates, &*self.accelerations);
        let motion = TreeMotion { model, kinematics: &self.kinematics, frame: &input.frame, velocity, acceleration };
        self.dynamics.update(motion, mass);
        for object in 0..model.object_count() {
            self.object_momentum(model, input, object, &reference);
        }
        self.hand_momentum(model, input, springs);
        (reference, scenery)
    }

    /// Returns to the velocities at the beginning of the step, to solve its equations anew.
    fn rewind(&mut self) {
        let free = self.problem.hand.velocity.len();
        self.problem.hand.velocity.copy_from_slice(&self.state.rates[..free]);
        for (terms, state) in self.problem.objects.iter_mut().zip(&self.state.objects) {
            terms.velocity = six(&state.linear, &state.angular);
        }
    }

    /// Moves by the solution of a step's equations.
    #[inline]
    fn end(&mut self, model: &Model, input: &StepInput, scenery: &Twist, reference: &Vector3<f64>) {
        self.carry_sleepers(scenery, reference);
        self.integrate(model, input);
        self.put_to_sleep(model, input, scenery);
    }

    /// Centre of mass of object `index`, base's frame, metres.
    #[must_use]
    pub fn object_center(&self, index: usize) -> Vector3<f64> {
        (self.state.objects[index].base_from_object * self.model.objects[index].own.center).coords
    }

    /// Reference point of all twists, base's frame: the centre of mass of the first object.
    fn reference(&self) -> Vector3<f64> {
        if self.state.objects.is_empty() { Vector3::zeros() } else { self.object_center(0) }
    }

    /// Solves the equations of the step, island by island. Returns false if the iteration did not converge for one of them.
    #[inline(never)] // As for `find_contacts`.
    fn solve(&mut self, model: &Model, scenery: &Twist) -> bool {
        self.islands.find(model, &self.problem.patches, &self.asleep);
        self.newton.begin();
        let mut balanced = true;
        for island in &self.islands.all {
            let (objects, patches) = (self.islands.objects(island), self.islands.patches(island));
            if objects.is_empty() && (!island.hand || model.tree.coordinates.is_empty()) {
                continue;
            }
            let members = (island.hand, objects, patches);
            balanced &= self.newton.solve(model, &self.kinematics, &mut self.problem, members, scenery);
        }
        balanced
    }

    /// Computes rates and accelerations of the driven coordinates.
    fn drive(&mut self, model: &Model, input: &StepInput) {
        let free = model.tree.coordinates.len();
        for (i, target) in input.driven.iter().enumerate() {
            let index = free + i;
            let rate = (target - self.state.positions[index]) / input.dt;
            self.accelerations[index] = (rate - self.state.rates[index]) / input.dt;
            self.state.rates[index] = rate;
        }
    }

    /// Momentum of an object at the end of the step without contacts.
    ///
    /// With the spin `s` in the rotating frame of the base, its angular velocity `omega` and acceleration `alpha`, and `w = s + omega`, Euler's
    /// equation `I dw/dt = -w x (I w)` becomes
    ///
    /// ```text
    /// I ds/dt = I (s x omega - alpha) - w x (I w)
    /// ```
    ///
    /// of which `-s x (I s)` is integrated implicitly (`gyroscopic`), the rest explicitly.
    fn object_momentum(&mut self, model: &Model, input: &StepInput, index: usize, reference: &Vector3<f64>) {
        let center = &if index == 0 { *reference } else { self.object_center(index) };
        let (state, own, frame, dt) = (&self.state.objects[index], &model.objects[index].own, &input.frame, input.dt);
        let turn = state.base_from_object.rotation.to_rotation_matrix();
        let inertia = turn.matrix() * (own.inertia * state.mass_factor) * turn.matrix().transpose();
        let mass = own.mass * state.mass_factor;
        let (omega, alpha) = (&frame.omega, &frame.alpha);
        let push =
            frame.gravity - 2.0 * omega.cross(&state.linear) - omega.cross(&omega.cross(center)) - alpha.cross(center);
        let spin = state.angular;
        let total = spin + omega;
        let torque =
            inertia * (spin.cross(omega) - alpha) - total.cross(&(inertia * total)) + spin.cross(&(inertia * spin));
        let pushed = spin + dt * inertia.try_inverse().map_or_else(Vector3::zeros, |i| i * torque);
        let momentum = inertia * gyroscopic(&inertia, &pushed, dt);
        let mut linear = mass * (state.linear + dt * push);
        if let Some(force) = input.forces.get(index).filter(|force| **force != Vector3::zeros()) {
            linear += dt * force;
        }
        let terms = &mut self.problem.objects[index];
        (terms.mass, terms.inertia, terms.center) = (mass, inertia, *center);
        terms.lever = (index > 0).then(|| reference - center);
        terms.momentum = six(&linear, &momentum);
        terms.velocity = six(&state.linear, &state.angular);
    }

    /// Momentum of the free coordinates at the end of the step without damping, cables, stops and contacts; adds the damping to the mass matrix.
    fn hand_momentum(&mut self, model: &Model, input: &StepInput, springs: Springs) {
        let (state, dt) = (&self.state, input.dt);
        self.problem.dt = dt;
        let hand = &mut self.problem.hand;
        for (i, coordinate) in model.tree.coordinates.iter().enumerate() {
            let row = hand.mass.row(i);
            let block = model.blocks[i].clone();
            let carried: f64 = row[block.clone()].iter().zip(&state.rates[block]).map(|(m, v)| m * v).sum();
            let spring = coordinate.stiffness * (coordinate.spring_reference - state.positions[i]);
            hand.momentum[i] = carried + dt * (self.dynamics.bias[i] + spring);
            hand.velocity[i] = state.rates[i];
            hand.q[i] = state.positions[i];
        }
        for (i, coordinate) in model.tree.coordinates.iter().enumerate() {
            hand.mass.row_mut(i)[i] += dt * (coordinate.damping + springs.damping(coordinate, dt));
        }
        for ((cable, command), own) in model.tree.cables.iter().zip(input.cables).zip(&mut hand.cables) {
            let taken: f64 = cable.arms.iter().map(|(c, arm)| arm * state.positions[*c]).sum();
            own.stretch = command.length - dt * command.rate - taken;
            own.command_rate = command.rate;
            let damping = own.saturated_damping(cable);
            for (c, arm) in cable.arms.iter().filter(|_| damping > 0.0) {
                hand.mass.row_mut(*c)[*c] += dt * damping * arm * arm;
            }
        }
    }

    #[inline(never)] // With it inlined, `step` spills so many registers that a step takes 2 % longer.
    fn find_contacts(&mut self, model: &Model, input: &StepInput, reference: &Vector3<f64>, scenery: Twist) {
        self.place_bodies(model, input, reference, &scenery);
        self.referred = *reference;
        let planes = model.scenery.planes(&input.base_from_world);
        self.friction_factors.clear();
        self.friction_factors.extend(self.state.objects.iter().map(|object| object.friction_factor));
        loop {
            let (poses, turns, moving, dt) = (&self.poses, &self.turns, &self.moving, input.dt);
            let now = Situation { dt, poses, turns, moving, planes: &planes, idle: input.idle };
            self.searcher.search(model, &now, &self.asleep);
            let friction_factors = &self.friction_factors;
            let scene = rows::Scene { now, reference: *reference, scenery, friction_factors };
            let pairs = &self.searcher.pairs;
            if let Some(object) = rows::touched_sleeper(model, &scene, pairs, &self.asleep) {
                self.wake(object);
                continue;
            }
            let (problem, sources) = (&mut self.problem, &mut self.sources);
            rows::collect(model, &scene, &self.kinematics, (pairs, &self.asleep), problem, sources);
            return;
        }
    }

    /// Writes poses and motion of all bodies at the beginning of the step.
    fn place_bodies(&mut self, model: &Model, input: &StepInput, reference: &Vector3<f64>, scenery: &Twist) {
        let kinematics = &self.kinematics;
        self.poses.clear();
        self.moving.clear();
        self.turns.clear();
        self.loaded.clear();
        self.poses.extend(self.state.objects.iter().map(|object| object.base_from_object));
        self.poses.extend(&kinematics.pose);
        self.poses.resize(model.scenery_body(), Isometry3::identity());
        self.poses.push(input.base_from_world);
        let matrix = |pose: &Isometry3<f64>| pose.rotation.to_rotation_matrix().into_inner();
        self.turns.extend(self.poses[..model.base()].iter().map(matrix));
        self.turns.extend(&kinematics.turn);
        self.turns.resize(model.scenery_body(), Matrix3::identity());
        self.turns.push(matrix(&input.base_from_world));
        for body in 0..self.poses.len() {
            let middle = self.turns[body] * model.center.get(body).copied().unwrap_or_else(Vector3::zeros)
                + self.poses[body].translation.vector;
            self.moving.push(match model.kind(body) {
                // As it will be carried in this step.
                BodyKind::Object(object) if self.asleep[object] => {
                    BodyMotion { center: middle, velocity: scenery.at(&(middle - reference)), omega: scenery.angular }
                }
                BodyKind::Object(object) => {
                    let state = &self.state.objects[object];
                    let arm = match &self.problem.objects[object].lever {
                        Some(lever) => middle - reference + lever,
                        None => middle - reference,
                    };
                    let velocity = Twist { linear: state.linear, angular: state.angular }.at(&arm);
                    BodyMotion { center: middle, velocity, omega: state.angular }
                }
                BodyKind::Hand(index) if index >= kinematics.pose.len() => BodyMotion::default(),
                BodyKind::Hand(index) => {
                    let twist = kinematics.twist(model, index, &self.state.rates);
                    BodyMotion { center: middle, velocity: twist.at(&(middle - reference)), omega: twist.angular }
                }
                // At the base's origin.
                BodyKind::Scenery => {
                    let moved = scenery.at(&-reference);
                    BodyMotion { center: Vector3::zeros(), velocity: moved, omega: scenery.angular }
                }
            });
        }
    }

    fn integrate(&mut self, model: &Model, input: &StepInput) {
        let (problem, dt) = (&self.problem, input.dt);
        for (index, own) in model.objects.iter().enumerate() {
            let terms = &problem.objects[index];
            let object = &mut self.state.objects[index];
            if let Some(world_from_object) = &object.asleep {
                object.base_from_object = input.base_from_world_after * world_from_object;
                continue;
            }
            let Twist { linear, angular } = own_twist(&terms.velocity);
            (object.linear, object.angular) = (linear, angular);
            let turn = UnitQuaternion::from_scaled_axis(angular * dt);
            let mut rotation = turn * object.base_from_object.rotation;
            rotation.renormalize();
            let place = terms.center + dt * linear - rotation * own.own.center.coords;
            object.base_from_object = Isometry3::from_parts(Translation3::from(place), rotation);
        }
        let state = &mut self.state;
        let free = model.tree.coordinates.len();
        for i in 0..free {
            state.rates[i] = problem.hand.velocity[i];
            state.positions[i] += dt * problem.hand.velocity[i];
        }
        state.positions[free..].copy_from_slice(input.driven);
        for (force, cable) in state.cable_forces.iter_mut().zip(&problem.hand.cables) {
            *force = cable.force;
        }
    }

    /// Visits the contact points of the last step between `wanted` bodies.
    pub fn contacts(&self, wanted: impl Fn(BodyIndex, BodyIndex) -> bool, mut visit: impl FnMut(&Contact)) {
        for contact in self.loaded.iter().filter(|c| wanted(c.sides[0].body, c.sides[1].body)) {
            visit(contact);
        }
        let at_rest = |sides: [BodyKind; 2]| rests(&sides, |object| self.state.objects[object].asleep.is_some());
        for (index, source) in self.sources.iter().enumerate() {
            let pair = &self.model.pairs[source.pair as usize];
            // Those of objects that fell asleep in the last step are among the rested.
            if wanted(pair.a, pair.b) && !at_rest(pair.sides) {
                visit(&self.contact(index, source));
            }
        }
        // Those of a loaded state include them.
        let rested = if self.loaded.is_empty() { self.rested.as_slice() } else { &[] };
        for contact in rested.iter().filter(|c| wanted(c.sides[0].body, c.sides[1].body)) {
            if at_rest(contact.sides.map(|side| self.model.kind(side.body))) {
                visit(&self.of_sleeper(contact));
            }
        }
    }

    fn contact(&self, index: usize, source: &PointSource) -> Contact {
        let pair = &self.model.pairs[source.pair as usize];
        let candidate = &self.searcher.pairs[source.pair as usize].candidates[source.candidate as usize];
        let point = &self.problem.points[index];
        let shape = |i: usize| match (pair.sides[i], candidate.shapes[i]) {
            (BodyKind::Hand(_), Some(s)) => self.model.shape_owner[usize::from(s)].1 as u16,
            _ => 0,
        };
        let into_a = self.turns[pair.a].tr_mul(&-point.normal);
        let into_b = self.turns[pair.b].tr_mul(&point.normal);
        let middle = Point3::from(self.referred + point.arm);
        let surface_of_box = if candidate.shapes[1].is_some() { Surface::Wall } else { Surface::Table };
        let (on_b, surface) = match candidate.opposite {
            Opposite::Point { on_b, .. } => (on_b, (pair.sides[1] == BodyKind::Scenery).then_some(surface_of_box)),
            Opposite::Plane(surface) => {
                let on_plane = middle + point.normal * (0.5 * source.distance);
                (self.poses[pair.b].inverse_transform_point(&on_plane).coords, Some(surface))
            }
        };
        Contact {
            sides: [
                Side { body: pair.a, shape: shape(0), point: candidate.on_a, normal: into_a },
                Side { body: pair.b, shape: shape(1), point: on_b, normal: into_b },
            ],
            surface,
            point: middle.coords,
            normal: point.normal,
            friction: point.friction,
            distance: source.distance + self.problem.dt * point.normal_speed,
            force: point.impulse / self.problem.dt,
            friction_force: point.friction_impulse(self.problem.stick_speed) / self.problem.dt,
        }
    }
}

fn six(linear: &Vector3<f64>, angular: &Vector3<f64>) -> [f64; 6] {
    [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z]
}

/// Twist of the scenery in the base's frame during the step, at the reference point.
fn scenery_twist(input: &StepInput, reference: &Vector3<f64>) -> Twist {
    let moved = input.base_from_world_after * input.base_from_world.inverse();
    let after = moved.rotation * reference + moved.translation.vector;
    Twist { linear: (after - reference) / input.dt, angular: moved.rotation.scaled_axis() / input.dt }
}

/// Angular velocity after one implicit step of torque-free rotation: one Newton step for `I (w - w0) + dt w x (I w) = 0`, from `w0 = spin`.
fn gyroscopic(inertia: &Matrix3<f64>, spin: &Vector3<f64>, dt: f64) -> Vector3<f64> {
    let momentum = inertia * spin;
    let residual = dt * spin.cross(&momentum);
    let derivative = inertia + dt * (spin.cross_matrix() * inertia - momentum.cross_matrix());
    derivative.try_inverse().map_or(*spin, |inverse| spin - inverse * residual)
}
