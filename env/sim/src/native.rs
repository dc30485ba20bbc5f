//! The engine on our own solver ([`graspbox_solver`]): f64, all contacts of a step solved together.

mod translate;

use crate::SimError;
use crate::config::PhysicsConfig;
use crate::engine::{Contact, ContactSide, Engine, JointState, Part, StepInput};
use crate::object::ObjectModel;
use graspbox_hand::Hand;
use graspbox_solver as solver;
use nalgebra::{Isometry3, Point3, Vector3};
use std::sync::Arc;
use translate::Translation;

/// One world of our own solver.
#[derive(Clone)]
pub(crate) struct Native {
    solver: solver::Solver,
    base_from_world: Isometry3<f64>,
    driven: Vec<f64>,
    given: Vec<solver::Given>,
    shared: Arc<Shared>,
}

/// What an engine and its copies share.
struct Shared {
    hand: Arc<Hand>,
    translation: Translation,
    dt: f64,
}

impl Native {
    /// Prepares hand and object.
    ///
    /// # Errors
    /// An object or a hand that cannot be simulated.
    pub(crate) fn new(hand: Arc<Hand>, object: &ObjectModel, config: PhysicsConfig) -> Result<Self, SimError> {
        let (tree, translation) = translate::hand(&hand);
        let object = translate::object(object, config.friction.object);
        let scenery = translate::scenery(config.friction.table);
        let search = solver::SearchConfig { prediction: config.prediction, drift: config.contact_drift };
        let model = solver::Model::new(tree, object, scenery, config.solver, search).map_err(|error| match error {
            solver::ModelError::FlatPart { part } => SimError::FlatPart { part },
            error @ solver::ModelError::BadTree { .. } => {
                SimError::BadHand { hand: hand.name.clone(), why: error.to_string() }
            }
        })?;
        let driven = vec![0.0; model.tree().driven];
        let given = vec![solver::Given::default(); model.tree().cables.len()];
        let shared = Arc::new(Shared { hand, translation, dt: config.dt });
        let solver = solver::Solver::new(Arc::new(model));
        Ok(Self { solver, base_from_world: Isometry3::identity(), driven, given, shared })
    }

    fn part(&self, body: solver::BodyIndex, shape: Option<u16>, surface: Option<solver::Surface>) -> Part {
        match (body, surface) {
            (solver::OBJECT, _) => Part::Object,
            (_, Some(solver::Surface::Ground)) if shape.is_none() => Part::Ground,
            (_, Some(solver::Surface::Table)) if shape.is_none() => Part::Table,
            _ => {
                let (link, shape) = self.shared.translation.owner(body - solver::BASE, shape.unwrap_or(0).into());
                Part::Link { link, shape }
            }
        }
    }

    /// One side of a contact in the words of the seam.
    fn side(&self, contact: &solver::Contact, index: usize) -> ContactSide {
        let part = self.part(contact.bodies[index], contact.shapes[index], contact.surface.filter(|_| index == 1));
        let point = Point3::from(contact.points[index]);
        let into = if index == 0 { -contact.normal } else { contact.normal };
        let turn = &self.solver.state().rotations[contact.bodies[index]];
        match part {
            Part::Object => ContactSide { part, point, normal: turn.inverse_transform_vector(&into) },
            Part::Table | Part::Ground => {
                let world_from_base = self.base_from_world.inverse();
                ContactSide { part, point: world_from_base * point, normal: world_from_base * into }
            }
            Part::Link { link, .. } => {
                let body_from_link = &self.shared.translation.body_from_link[link];
                let normal = turn.inverse_transform_vector(&into);
                ContactSide {
                    part,
                    point: body_from_link.inverse_transform_point(&point),
                    normal: body_from_link.inverse_transform_vector(&normal),
                }
            }
        }
    }
}

impl Engine for Native {
    fn duplicate(&self) -> Box<dyn Engine> {
        Box::new(self.clone())
    }

    fn pose(&mut self, base_from_world: &Isometry3<f64>, base_from_object: &Isometry3<f64>, preshape: f64) {
        self.base_from_world = *base_from_world;
        let free = self.solver.model().tree().coordinates.len();
        let state = self.solver.state_mut();
        state.base_from_object = *base_from_object;
        state.positions[free..].fill(preshape);
    }

    fn step(&mut self, input: &StepInput) {
        let hand = &self.shared.hand;
        self.shared.translation.drive(hand, input.motors, &mut self.driven, &mut self.given);
        self.solver.step(&solver::StepInput {
            dt: self.shared.dt,
            base_from_world: input.base_from_world,
            base_from_world_after: input.base_from_world_after,
            frame: solver::FrameMotion {
                gravity: input.frame.gravity,
                omega: input.frame.omega,
                alpha: input.frame.alpha,
            },
            driven: &self.driven,
            cables: &self.given,
        });
        self.base_from_world = input.base_from_world_after;
    }

    fn tension(&self, finger: usize) -> f64 {
        self.solver.state().cable_forces[finger]
    }

    fn joint(&self, joint: usize) -> JointState {
        let state = self.solver.state();
        match self.shared.translation.joints[joint] {
            Some((coordinate, ratio, offset)) => JointState {
                angle: ratio * state.positions[coordinate] + offset,
                speed: ratio * state.rates[coordinate],
            },
            None => JointState { angle: 0.0, speed: 0.0 },
        }
    }

    fn base_from_object(&self) -> Isometry3<f64> {
        self.solver.state().base_from_object
    }

    fn object_velocity(&self) -> (Vector3<f64>, Vector3<f64>) {
        (self.solver.state().linear, self.solver.state().angular)
    }

    fn set_object_velocity(&mut self, linear: &Vector3<f64>, angular: &Vector3<f64>) {
        let state = self.solver.state_mut();
        (state.linear, state.angular) = (*linear, *angular);
    }

    fn scale_object(&mut self, friction: f64, mass: f64) {
        let state = self.solver.state_mut();
        state.friction_factor *= friction;
        state.mass_factor *= mass;
    }

    fn lowest_point(&self, from_object: &Isometry3<f64>) -> f64 {
        self.solver.model().lowest_point(from_object)
    }

    fn contacts(&self, wanted: &dyn Fn([Part; 2]) -> bool, visit: &mut dyn FnMut(&Contact)) {
        for contact in &self.solver.state().contacts {
            let part = |i: usize| self.part(contact.bodies[i], contact.shapes[i], contact.surface.filter(|_| i == 1));
            if !wanted([part(0), part(1)]) {
                continue;
            }
            visit(&Contact {
                sides: [self.side(contact, 0), self.side(contact, 1)],
                point: Point3::from(contact.point),
                normal: contact.normal,
                distance: contact.distance,
                force: contact.force,
                friction: contact.friction,
            });
        }
    }

    fn is_finite(&self) -> bool {
        self.solver.is_finite()
    }

    fn unconverged_steps(&self) -> u64 {
        self.solver.state().unconverged_steps
    }

    fn save(&self) -> Result<Vec<u8>, SimError> {
        postcard::to_allocvec(&(self.solver.save(), &self.base_from_world))
            .map_err(|_| SimError::BadSnapshot { why: "the solver's state could not be written".into() })
    }

    fn load(&mut self, bytes: &[u8]) -> Result<(), SimError> {
        let bad = |why: &str| SimError::BadSnapshot { why: why.into() };
        let (saved, base_from_world): (solver::Saved, Isometry3<f64>) =
            postcard::from_bytes(bytes).map_err(|_| bad("its content cannot be read"))?;
        if !self.solver.load(saved) {
            return Err(bad("its coordinates are not those of this hand and object"));
        }
        self.base_from_world = base_from_world;
        Ok(())
    }
}
