//! The solver of one world: its state, and one time step.

pub(crate) mod saved;

use nalgebra::{Isometry3, Matrix3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

use crate::contact::{Contact, Side};
use crate::dynamics::{Dynamics, FrameMotion};
use crate::kinematics::{Kinematics, Twist};
use crate::model::{BASE, BodyIndex, Model, OBJECT};
use crate::problem::Problem;
use crate::problem::newton::Newton;
use crate::problem::rows::{self, PointSource};
use crate::scenery::Surface;
use crate::search::{Moving, Opposite, Searcher, Situation};

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
    /// Force on the object's centre of mass, N, base's axes.
    pub force: Vector3<f64>,
    /// Driven coordinates at the end of the step, rad or m.
    pub driven: &'a [f64],
    /// Command of every cable.
    pub cables: &'a [CableCommand],
}

/// Command to a cable: the length that its actuator has wound (for a servo, the commanded position).
#[derive(Clone, Copy, Debug, Default)]
pub struct CableCommand {
    /// At the end of the step, metres (servo: rad or m).
    pub length: f64,
    /// Its rate during the step, m/s (servo: rad/s or m/s).
    pub rate: f64,
}

/// The state that a world carries from step to step.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct State {
    /// The object in the base's frame.
    pub base_from_object: Isometry3<f64>,
    /// Velocity of its centre of mass in the base's frame, m/s.
    pub linear: Vector3<f64>,
    /// Its angular velocity in the base's frame, rad/s.
    pub angular: Vector3<f64>,
    /// Coordinates, the driven ones last, rad or m.
    pub positions: Vec<f64>,
    /// Their rates, rad/s or m/s.
    pub rates: Vec<f64>,
    /// Forces of the cables, N.
    pub cable_forces: Vec<f64>,
    /// Factor on the object's friction.
    pub friction_factor: f64,
    /// Factor on the object's mass and inertia.
    pub mass_factor: f64,
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
    newton: Newton,
    /// By [`crate::BodyIndex`], at the beginning of the last step.
    poses: Vec<Isometry3<f64>>,
    turns: Vec<Matrix3<f64>>,
    /// The candidate behind each point of the problem.
    sources: Vec<PointSource>,
    /// Contacts of a loaded state, until the next step.
    loaded: Vec<Contact>,
    moving: Vec<Moving>,
    accelerations: Vec<f64>,
}

impl Solver {
    /// A world in which all coordinates are 0 and the object is at the origin.
    #[must_use]
    pub fn new(model: Arc<Model>) -> Self {
        let count = model.tree.coordinates.len() + model.tree.driven;
        let state = State {
            base_from_object: Isometry3::identity(),
            linear: Vector3::zeros(),
            angular: Vector3::zeros(),
            positions: vec![0.0; count],
            rates: vec![0.0; count],
            cable_forces: vec![0.0; model.tree.cables.len()],
            friction_factor: 1.0,
            mass_factor: 1.0,
            unconverged_steps: 0,
        };
        Self {
            searcher: Searcher::new(&model),
            kinematics: Kinematics::default(),
            dynamics: Dynamics::default(),
            problem: Problem::new(&model),
            newton: Newton::new(&model),
            poses: Vec::new(),
            turns: Vec::new(),
            sources: Vec::new(),
            loaded: Vec::new(),
            moving: Vec::new(),
            accelerations: vec![0.0; count],
            state,
            model,
        }
    }

    /// The data that this world shares with others.
    #[must_use]
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// The present state.
    #[must_use]
    pub fn state(&self) -> &State {
        &self.state
    }

    /// The present state, to pose the world. The lengths of its lists must not change.
    pub fn state_mut(&mut self) -> &mut State {
        &mut self.state
    }

    /// True while every number of the state is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let state = &self.state;
        let place = state.base_from_object.translation.vector;
        let vectors = [&state.linear, &state.angular, &place];
        let coordinates = state.rates.iter().chain(&state.positions).chain(&state.cable_forces);
        vectors.iter().flat_map(|v| v.iter()).chain(coordinates).all(|x| x.is_finite())
    }

    /// Advances by one step.
    pub fn step(&mut self, input: &StepInput) {
        let model = Arc::clone(&self.model);
        let free = model.tree.coordinates.len();
        self.drive(&model, input);
        let center = self.object_center();
        self.kinematics.place(&model, &self.state.positions);
        self.kinematics.differentiate(&model, &center, &self.state.rates[free..]);
        let mass = &mut self.problem.mass;
        let (rates, accelerations) = (&self.state.rates, &self.accelerations);
        self.dynamics.update(&model, &self.kinematics, &input.frame, rates, accelerations, mass);
        self.object_momentum(&model, input, &center);
        self.hand_momentum(&model, input);
        let scenery = scenery_twist(input, &center);
        self.find_contacts(&model, input, &center, scenery);
        let balanced = self.newton.solve(&model, &self.kinematics, &mut self.problem, &scenery);
        self.state.unconverged_steps += u64::from(!balanced);
        self.integrate(&model, input, &center);
    }

    /// Centre of mass of the object, base's frame, metres.
    #[must_use]
    pub fn object_center(&self) -> Vector3<f64> {
        (self.state.base_from_object * self.model.object.center).coords
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

    /// Momentum of the object at the end of the step without contacts.
    ///
    /// With the spin `s` in the rotating frame of the base, its angular velocity `omega` and acceleration `alpha`, and `w = s + omega`, Euler's
    /// equation `I dw/dt = -w x (I w)` becomes
    ///
    /// ```text
    /// I ds/dt = I (s x omega - alpha) - w x (I w)
    /// ```
    ///
    /// of which `-s x (I s)` is integrated implicitly (`gyroscopic`), the rest explicitly.
    fn object_momentum(&mut self, model: &Model, input: &StepInput, center: &Vector3<f64>) {
        let (state, frame, dt) = (&self.state, &input.frame, input.dt);
        let turn = state.base_from_object.rotation.to_rotation_matrix();
        let inertia = turn.matrix() * (model.object.inertia * state.mass_factor) * turn.matrix().transpose();
        let mass = model.object.mass * state.mass_factor;
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
        if input.force != Vector3::zeros() {
            linear += dt * input.force;
        }
        let free = model.tree.coordinates.len();
        let problem = &mut self.problem;
        problem.object_mass = mass;
        problem.object_inertia = inertia;
        for i in 0..3 {
            problem.momentum[free + i] = linear[i];
            problem.momentum[free + 3 + i] = momentum[i];
            problem.v[free + i] = state.linear[i];
            problem.v[free + 3 + i] = state.angular[i];
        }
    }

    /// Momentum of the free coordinates at the end of the step without damping, cables, stops and contacts; adds the damping to the mass matrix.
    fn hand_momentum(&mut self, model: &Model, input: &StepInput) {
        let (state, problem, dt) = (&self.state, &mut self.problem, input.dt);
        problem.dt = dt;
        for (i, coordinate) in model.tree.coordinates.iter().enumerate() {
            let row = problem.mass.row(i);
            let block = model.blocks[i].clone();
            let carried: f64 = row[block.clone()].iter().zip(&state.rates[block]).map(|(m, v)| m * v).sum();
            let spring = coordinate.stiffness * (coordinate.spring_reference - state.positions[i]);
            problem.momentum[i] = carried + dt * (self.dynamics.bias[i] + spring);
            problem.v[i] = state.rates[i];
            problem.q[i] = state.positions[i];
        }
        for (i, coordinate) in model.tree.coordinates.iter().enumerate() {
            problem.mass.row_mut(i)[i] += dt * coordinate.damping;
        }
        for ((cable, command), own) in model.tree.cables.iter().zip(input.cables).zip(&mut problem.cables) {
            let taken: f64 = cable.arms.iter().map(|(c, arm)| arm * state.positions[*c]).sum();
            own.stretch = command.length - dt * command.rate - taken;
            own.command_rate = command.rate;
            let damping = own.saturated_damping(cable);
            for (c, arm) in cable.arms.iter().filter(|_| damping > 0.0) {
                problem.mass.row_mut(*c)[*c] += dt * damping * arm * arm;
            }
        }
    }

    fn find_contacts(&mut self, model: &Model, input: &StepInput, center: &Vector3<f64>, scenery: Twist) {
        let kinematics = &self.kinematics;
        self.poses.clear();
        self.moving.clear();
        self.turns.clear();
        self.loaded.clear();
        self.poses.push(self.state.base_from_object);
        self.poses.extend(&kinematics.pose);
        self.poses.push(input.base_from_world);
        let matrix = |pose: &Isometry3<f64>| pose.rotation.to_rotation_matrix().into_inner();
        self.turns.push(matrix(&self.state.base_from_object));
        self.turns.extend(&kinematics.turn);
        self.turns.push(matrix(&input.base_from_world));
        let state = &self.state;
        for body in 0..self.poses.len() {
            let twist = match body {
                OBJECT => Twist { linear: state.linear, angular: state.angular },
                _ if body == model.scenery_body() => {
                    // At the base's origin.
                    let moved = scenery.at(&-center);
                    self.moving.push(Moving { center: Vector3::zeros(), velocity: moved, omega: scenery.angular });
                    continue;
                }
                _ => kinematics.twist(model, body - BASE, &state.rates),
            };
            let middle = self.turns[body] * model.center[body] + self.poses[body].translation.vector;
            let velocity = twist.at(&(middle - center));
            self.moving.push(Moving { center: middle, velocity, omega: twist.angular });
        }
        let planes = model.scenery.planes(&input.base_from_world);
        let now =
            Situation { dt: input.dt, poses: &self.poses, turns: &self.turns, moving: &self.moving, planes: &planes };
        self.searcher.search(model, &now);
        let scene = rows::Scene { now, center: *center, scenery, mass: self.problem.object_mass };
        let pairs = &self.searcher.pairs;
        let factor = self.state.friction_factor;
        rows::collect(model, &scene, kinematics, pairs, factor, &mut self.problem, &mut self.sources);
    }

    fn integrate(&mut self, model: &Model, input: &StepInput, center: &Vector3<f64>) {
        let (state, problem, dt) = (&mut self.state, &self.problem, input.dt);
        let free = model.tree.coordinates.len();
        let v = &problem.v[free..];
        state.linear = Vector3::new(v[0], v[1], v[2]);
        state.angular = Vector3::new(v[3], v[4], v[5]);
        let turn = UnitQuaternion::from_scaled_axis(state.angular * dt);
        let mut rotation = turn * state.base_from_object.rotation;
        rotation.renormalize();
        let place = center + dt * state.linear - rotation * model.object.center.coords;
        state.base_from_object = Isometry3::from_parts(Translation3::from(place), rotation);
        for i in 0..free {
            state.rates[i] = problem.v[i];
            state.positions[i] += dt * problem.v[i];
        }
        state.positions[free..].copy_from_slice(input.driven);
        for (force, cable) in state.cable_forces.iter_mut().zip(&problem.cables) {
            *force = cable.force;
        }
    }

    /// Visits the contact points of the last step between `wanted` bodies.
    pub fn contacts(&self, wanted: impl Fn(BodyIndex, BodyIndex) -> bool, mut visit: impl FnMut(&Contact)) {
        for contact in self.loaded.iter().filter(|c| wanted(c.sides[0].body, c.sides[1].body)) {
            visit(contact);
        }
        for (index, source) in self.sources.iter().enumerate() {
            let pair = &self.model.pairs[source.pair as usize];
            if wanted(pair.a, pair.b) {
                visit(&self.contact(index, source));
            }
        }
    }

    fn contact(&self, index: usize, source: &PointSource) -> Contact {
        let pair = &self.model.pairs[source.pair as usize];
        let candidate = &self.searcher.pairs[source.pair as usize].candidates[source.candidate as usize];
        let point = &self.problem.points[index];
        let shape = |i: usize| candidate.shapes[i].map_or(0, |s| self.model.shape_owner[usize::from(s)].1 as u16);
        let into_a = self.turns[pair.a].tr_mul(&-point.normal);
        let into_b = self.turns[pair.b].tr_mul(&point.normal);
        let middle = self.poses[OBJECT] * self.model.object.center + point.arm;
        let scenery = pair.b == self.model.scenery_body();
        let (on_b, surface) = match candidate.opposite {
            Opposite::Point { on_b, .. } => (on_b, scenery.then_some(Surface::Table)),
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

/// Twist of the scenery in the base's frame during the step, at the object's centre of mass.
fn scenery_twist(input: &StepInput, center: &Vector3<f64>) -> Twist {
    let moved = input.base_from_world_after * input.base_from_world.inverse();
    let after = moved.rotation * center + moved.translation.vector;
    Twist { linear: (after - center) / input.dt, angular: moved.rotation.scaled_axis() / input.dt }
}

/// Angular velocity after one implicit step of torque-free rotation: one Newton step for `I (w - w0) + dt w x (I w) = 0`, from `w0 = spin`.
fn gyroscopic(inertia: &Matrix3<f64>, spin: &Vector3<f64>, dt: f64) -> Vector3<f64> {
    let momentum = inertia * spin;
    let residual = dt * spin.cross(&momentum);
    let derivative = inertia + dt * (spin.cross_matrix() * inertia - momentum.cross_matrix());
    derivative.try_inverse().map_or(*spin, |inverse| spin - inverse * residual)
}
