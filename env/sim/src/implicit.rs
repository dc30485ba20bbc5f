//! The engine `implicit` ([`graspbox_solver`]) behind the interface of [`crate::engine`].

mod arm;
mod translate;

use crate::SimError;
use crate::engine::{Contact, ContactSide, Engine, JointState, Part, StepInput, WorldSpec};
use graspbox_hand::Hand;
use graspbox_solver as solver;
use nalgebra::{Isometry3, Point3, Vector3};
use std::sync::Arc;
use translate::Translation;

/// One world of the engine.
#[derive(Clone)]
pub(crate) struct Implicit {
    solver: solver::Solver,
    driven: Vec<f64>,
    commands: Vec<solver::CableCommand>,
    shared: Arc<Shared>,
}

/// Data shared by an engine and its copies.
struct Shared {
    hand: Arc<Hand>,
    translation: Translation,
    dt: f64,
}

impl Implicit {
    /// Translates hand, objects and scenery into the solver's model.
    ///
    /// # Errors
    /// [`SimError::FlatPart`], [`SimError::BadHand`] or [`SimError::TooManyObjects`].
    pub(crate) fn new(WorldSpec { hand, objects, walls, config }: WorldSpec) -> Result<Self, SimError> {
        let (tree, translation) = translate::hand(hand);
        let objects = objects.iter().map(|object| translate::object(object, config.friction.object)).collect();
        let scenery = translate::scenery(walls, config.friction.table);
        let model = solver::Model::new(tree, objects, scenery, config.implicit).map_err(|error| match error {
            solver::ModelError::FlatPart { object, part } => SimError::FlatPart { object, part },
            solver::ModelError::TooManyObjects { count } => SimError::TooManyObjects { count },
            solver::ModelError::TooManyWalls { count } => SimError::TooManyWalls { count },
            error @ solver::ModelError::BadTree { .. } => {
                SimError::BadHand { hand: hand.name.clone(), engine: "implicit", why: error.to_string() }
            }
        })?;
        let driven = vec![0.0; model.tree().driven];
        let commands = vec![solver::CableCommand::default(); model.tree().cables.len()];
        let shared = Arc::new(Shared { hand: Arc::clone(hand), translation, dt: config.dt });
        let solver = solver::Solver::new(Arc::new(model));
        Ok(Self { solver, driven, commands, shared })
    }

    /// The solver, and its input for a step of `dt` seconds.
    #[inline]
    fn drive<'a>(&'a mut self, input: &StepInput<'a>, dt: f64) -> (&'a mut solver::Solver, solver::StepInput<'a>) {
        let hand = &self.shared.hand;
        self.shared.translation.drive(hand, input.actuators, &mut self.driven, &mut self.commands);
        let first = self.driven.len() - input.arm.len();
        self.driven[first..].copy_from_slice(input.arm);
        let input = solver::StepInput {
            dt,
            base_from_world: input.base_from_world,
            base_from_world_after: input.base_from_world_after,
            frame: input.frame,
            forces: input.forces,
            driven: &self.driven,
            cables: &self.commands,
            idle: if input.arm_is_far { self.shared.translation.arm.count } else { 0 },
        };
        (&mut self.solver, input)
    }

    fn part(&self, side: &solver::Side, surface: Option<solver::Surface>) -> Part {
        match self.solver.model().kind(side.body) {
            solver::BodyKind::Object(object) => Part::Object(object),
            solver::BodyKind::Hand(body) => match self.shared.translation.arm.body(body) {
                Some(body) => Part::Arm(body),
                None => {
                    let (link, shape) = self.shared.translation.owner(body, side.shape.into());
                    Part::Link { link, shape }
                }
            },
            solver::BodyKind::Scenery => match surface {
                Some(solver::Surface::Ground) => Part::Ground,
                Some(solver::Surface::Wall) => Part::Wall,
                Some(solver::Surface::Table) | None => Part::Table,
            },
        }
    }

    /// One side of a contact in the frame of its link: links that form one body have separate frames.
    fn side(&self, side: &solver::Side, surface: Option<solver::Surface>) -> ContactSide {
        let part = self.part(side, surface);
        let (point, normal) = (Point3::from(side.point), side.normal);
        match part {
            Part::Link { link, .. } => {
                let place = &self.shared.translation.body_from_link[link];
                let point = place.inverse_transform_point(&point);
                ContactSide { part, point, normal: place.inverse_transform_vector(&normal) }
            }
            _ => ContactSide { part, point, normal },
        }
    }
}

impl Engine for Implicit {
    fn duplicate(&self) -> Box<dyn Engine> {
        Box::new(self.clone())
    }

    fn pose(&mut self, _base_from_world: &Isometry3<f64>, base_from_objects: &[Isometry3<f64>], joints: &[f64]) {
        let Shared { hand, translation, .. } = &*self.shared;
        let positions = translation.positions(hand, joints);
        let state = self.solver.state_mut();
        for (object, pose) in state.objects.iter_mut().zip(base_from_objects) {
            object.base_from_object = *pose;
        }
        state.positions.copy_from_slice(&positions);
    }

    fn place_arm(&mut self, arm: &[f64]) {
        let state = self.solver.state_mut();
        let first = state.positions.len() - arm.len();
        state.positions[first..].copy_from_slice(arm);
        state.rates[first..].fill(0.0);
    }

    fn step(&mut self, input: &StepInput) {
        let dt = self.shared.dt;
        let (solver, input) = self.drive(input, dt);
        solver.step(&input);
    }

    fn step_freely(&mut self, input: &StepInput, steps: u32) -> bool {
        let dt = f64::from(steps) * self.shared.dt;
        let (solver, input) = self.drive(input, dt);
        solver.step_freely(&input)
    }

    fn is_free(&self) -> bool {
        self.solver.is_free()
    }

    fn tension(&self, tendon: usize) -> f64 {
        self.solver.state().cable_forces[tendon]
    }

    fn joint(&self, joint: usize) -> JointState {
        let state = self.solver.state();
        match self.shared.translation.joints[joint] {
            Some((coordinate, ratio, offset)) => JointState {
                position: ratio * state.positions[coordinate] + offset,
                speed: ratio * state.rates[coordinate],
            },
            None => JointState { position: 0.0, speed: 0.0 },
        }
    }

    fn base_from_object(&self, object: usize) -> Isometry3<f64> {
        self.solver.state().objects[object].base_from_object
    }

    fn object_velocity(&self, object: usize) -> (Vector3<f64>, Vector3<f64>) {
        let object = &self.solver.state().objects[object];
        (object.linear, object.angular)
    }

    fn set_object_velocity(&mut self, object: usize, linear: &Vector3<f64>, angular: &Vector3<f64>) {
        let object = &mut self.solver.state_mut().objects[object];
        (object.linear, object.angular) = (*linear, *angular);
    }

    fn expect_rest(&mut self) {
        self.solver.expect_rest();
    }

    fn wake(&mut self) {
        self.solver.state_mut();
    }

    fn scale_object(&mut self, object: usize, friction: f64, mass: f64) {
        let object = &mut self.solver.state_mut().objects[object];
        object.friction_factor *= friction;
        object.mass_factor *= mass;
    }

    fn lowest_point(&self, object: usize, from_object: &Isometry3<f64>) -> f64 {
        self.solver.model().lowest_point(object, from_object)
    }

    fn contacts(&self, wanted: &dyn Fn([Part; 2]) -> bool, visit: &mut dyn FnMut(&Contact)) {
        // The kind of a body, before its shape is known.
        let kind = |body| match self.solver.model().kind(body) {
            solver::BodyKind::Object(object) => Part::Object(object),
            solver::BodyKind::Scenery => Part::Table,
            solver::BodyKind::Hand(body) => match self.shared.translation.arm.body(body) {
                Some(body) => Part::Arm(body),
                None => Part::Link { link: 0, shape: 0 },
            },
        };
        self.solver.contacts(
            |a, b| wanted([kind(a), kind(b)]),
            |contact| {
                visit(&Contact {
                    sides: [
                        self.side(&contact.sides[0], contact.surface),
                        self.side(&contact.sides[1], contact.surface),
                    ],
                    point: Point3::from(contact.point),
                    normal: contact.normal,
                    distance: contact.distance,
                    force: contact.force,
                    friction_force: contact.friction_force,
                    friction: contact.friction,
                });
            },
        );
    }

    fn is_finite(&self) -> bool {
        self.solver.is_finite()
    }

    fn unconverged_steps(&self) -> u64 {
        self.solver.state().unconverged_steps
    }

    fn save(&self) -> Result<Vec<u8>, SimError> {
        postcard::to_allocvec(&self.solver.save())
            .map_err(|_| SimError::BadSnapshot { why: "the solver's state could not be written".into() })
    }

    fn load(&mut self, bytes: &[u8]) -> Result<(), SimError> {
        let bad = |why: &str| SimError::BadSnapshot { why: why.into() };
        let saved: solver::SavedState = postcard::from_bytes(bytes).map_err(|_| bad("its content cannot be read"))?;
        self.solver.load(saved).map_err(|error| bad(&error.to_string()))
    }
}
