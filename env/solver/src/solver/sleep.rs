//! Sleep: objects that rest are not simulated until their load changes.
//!
//! An object that no body of the hand touches falls asleep once it has been slower than [`SLOW`] relative to the scenery for [`RESTS`], or for
//! [`CONFIRMED`] if it is expected to rest or woke by its load alone. It then keeps its pose in the world exactly, and carries objects that are awake like the scenery. It
//! wakes in the step in which a contact with the hand becomes possible, a force acts on it, its state is set, or the load that other objects put
//! on it would differ from that of its rest by more than [`LOAD`].
//!
//! The contact points of the last step before sleep remain the contacts of the sleepers.

use nalgebra::{Isometry3, Vector3};

use super::{ObjectState, Solver, StepInput};
use crate::contact::Contact;
use crate::kinematics::Twist;
use crate::model::{BodyKind, Model};
use crate::problem::Patch;

/// Speed below which every point of a resting object stays, m/s.
const SLOW: f64 = 1e-3;
/// Time for which it stays so before it sleeps, seconds.
const RESTS: f64 = 0.2;
/// The same for an object that came to rest before where it is, seconds. One that falls is faster by then; one that stands on an edge may not be.
const CONFIRMED: f64 = 0.01;
/// Change of its load that wakes a sleeper, as a share of its weight and the contact forces of its rest, dimensionless. A box alone on the table then
/// wakes at a fifth of its weight, which friction holds.
const LOAD: f64 = 0.1;

/// A change of the load on a sleeper.
#[derive(Clone, Copy, Default)]
pub(super) struct Load {
    /// N.
    force: Vector3<f64>,
    /// About its centre of mass, N m.
    moment: Vector3<f64>,
    /// Sum of the contact forces at its rest, N.
    borne: f64,
}

impl ObjectState {
    /// Wakes the object.
    pub(crate) fn wake(&mut self) {
        (self.slow_for, self.asleep) = (0.0, None);
    }
}

/// Whether no contact of a pair changes, since both bodies rest.
#[inline]
pub(crate) fn rests(sides: &[BodyKind; 2], asleep: impl Fn(usize) -> bool) -> bool {
    match *sides {
        [BodyKind::Object(a), BodyKind::Object(b)] => asleep(a) && asleep(b),
        [BodyKind::Object(a), BodyKind::Scenery] => asleep(a),
        _ => false,
    }
}

impl Solver {
    /// Takes all objects for at rest where they are, as after a settling: those that stay slow for 10 ms sleep.
    pub fn expect_rest(&mut self) {
        self.state.objects.iter_mut().for_each(|object| object.slow_for = RESTS - CONFIRMED);
    }

    /// Poses the sleepers, and wakes those on which a force acts. Their velocity is that of the scenery.
    pub(super) fn pose_sleepers(&mut self, input: &StepInput) {
        for index in 0..self.state.objects.len() {
            if input.forces.get(index).is_some_and(|force| *force != Vector3::zeros()) {
                self.wake(index);
            }
        }
        self.asleep.clear();
        for object in &mut self.state.objects {
            self.asleep.push(object.asleep.is_some());
            if let Some(world_from_object) = &object.asleep {
                object.base_from_object = input.base_from_world * world_from_object;
            }
        }
    }

    /// Gives the sleepers the velocity of the scenery in this step, which they have at its end.
    pub(super) fn carry_sleepers(&mut self, scenery: &Twist, reference: &Vector3<f64>) {
        for index in 0..self.state.objects.len() {
            if self.asleep[index] {
                let arm = self.object_center(index) - reference;
                let object = &mut self.state.objects[index];
                (object.linear, object.angular) = (scenery.at(&arm), scenery.angular);
            }
        }
    }

    /// Wakes an object, if it sleeps. Its contacts with sleepers remain the loads of their rest.
    pub(super) fn wake(&mut self, object: usize) {
        if self.state.objects[object].asleep.is_none() {
            return;
        }
        self.state.objects[object].wake();
        if let Some(asleep) = self.asleep.get_mut(object) {
            *asleep = false;
        }
        let (model, objects) = (&self.model, &self.state.objects);
        self.rested.retain(|contact| {
            let sleeps = |body| matches!(model.kind(body), BodyKind::Object(o) if objects[o].asleep.is_some());
            contact.sides.iter().any(|side| sleeps(side.body))
        });
    }

    /// Wakes the sleepers whose load has changed, by the solution of the step's equations. Returns whether there are any.
    pub(super) fn wake_loaded(&mut self, model: &Model, input: &StepInput) -> bool {
        if !self.asleep.contains(&true) || !self.asleep.contains(&false) {
            return false;
        }
        self.find_loads(model);
        let gravity = input.frame.gravity.norm();
        let mut any = false;
        for object in 0..self.asleep.len() {
            let Load { force, moment, borne } = self.loads[object];
            let changed = force.norm() + moment.norm() / model.radius[object];
            if self.asleep[object] && changed > LOAD * (self.problem.objects[object].mass * gravity + borne) {
                self.wake(object);
                self.state.objects[object].slow_for = RESTS - CONFIRMED;
                any = true;
            }
        }
        any
    }

    /// Computes what the load of each sleeper by objects that are awake is beyond that of its rest.
    fn find_loads(&mut self, model: &Model) {
        self.loads.clear();
        self.loads.resize(self.asleep.len(), Load::default());
        let (problem, asleep) = (&self.problem, &self.asleep);
        let add = |loads: &mut [Load], sides: &[BodyKind; 2], point: &Vector3<f64>, force: &Vector3<f64>| {
            let [BodyKind::Object(a), BodyKind::Object(b)] = *sides else { return };
            for (object, force) in [(a, -force), (b, *force)] {
                if asleep[object] {
                    let arm = point - problem.objects[object].center;
                    loads[object].force += force;
                    loads[object].moment += arm.cross(&force);
                }
            }
        };
        for Patch { sides, first, last, .. } in &problem.patches {
            for point in &problem.points[*first..*last] {
                let impulse = point.normal * point.impulse + point.friction_impulse(problem.stick_speed);
                add(&mut self.loads, sides, &(self.referred + point.arm), &(impulse / problem.dt));
            }
        }
        let base_from_world = self.poses.last().copied().unwrap_or_default();
        for contact in &self.rested {
            let sides = contact.sides.map(|side| model.kind(side.body));
            for side in sides {
                if let BodyKind::Object(object) = side {
                    self.loads[object].borne += contact.force;
                }
            }
            if !rests(&sides, |object| asleep[object]) {
                let contact = moved(contact, &base_from_world);
                let force = contact.normal * contact.force + contact.friction_force;
                add(&mut self.loads, &sides, &contact.point, &-force);
            }
        }
    }

    /// Puts objects to sleep that have rested long enough.
    pub(super) fn put_to_sleep(&mut self, model: &Model, input: &StepInput, scenery: &Twist) {
        self.touched.clear();
        self.touched.resize(self.asleep.len(), false);
        for Patch { sides, .. } in &self.problem.patches {
            if let [BodyKind::Object(object), BodyKind::Hand(_)] = *sides {
                self.touched[object] = true;
            }
        }
        let mut any = false;
        for object in 0..self.asleep.len() {
            if self.asleep[object] {
                continue;
            }
            let slow = !self.touched[object] && self.is_slow(model, object, scenery);
            let state = &mut self.state.objects[object];
            state.slow_for = if slow { state.slow_for + input.dt } else { 0.0 };
            any |= state.slow_for >= RESTS;
        }
        if any {
            self.sleep(model, input);
        }
    }

    /// Whether every point of an object is slow relative to the scenery.
    fn is_slow(&self, model: &Model, object: usize, scenery: &Twist) -> bool {
        let (state, terms) = (&self.state.objects[object], &self.problem.objects[object]);
        let moved = scenery.at(&(terms.center - self.referred));
        (state.linear - moved).norm() + (state.angular - scenery.angular).norm() * model.radius[object] < SLOW
    }

    /// Puts the objects to sleep that have rested, and keeps their contacts.
    fn sleep(&mut self, model: &Model, input: &StepInput) {
        let world_from_base = input.base_from_world_after.inverse();
        for state in self.state.objects.iter_mut().filter(|state| state.asleep.is_none() && state.slow_for >= RESTS) {
            state.asleep = Some(world_from_base * state.base_from_object);
        }
        let (before, objects) = (&self.asleep, &self.state.objects);
        let falls = |side: &BodyKind| matches!(side, BodyKind::Object(object) if !before[*object] && objects[*object].asleep.is_some());
        self.rested.retain(|contact| !contact.sides.iter().any(|side| falls(&model.kind(side.body))));
        let world_from_base = input.base_from_world.inverse();
        for (index, source) in self.sources.iter().enumerate() {
            if model.pairs[source.pair as usize].sides.iter().any(falls) {
                self.rested.push(moved(&self.contact(index, source), &world_from_base));
            }
        }
    }

    /// A contact of a sleeper in the frame of the base.
    pub(super) fn of_sleeper(&self, contact: &Contact) -> Contact {
        moved(contact, &self.poses.last().copied().unwrap_or_default())
    }
}

/// A contact in another frame.
fn moved(contact: &Contact, to_from: &Isometry3<f64>) -> Contact {
    Contact {
        point: to_from.transform_point(&contact.point.into()).coords,
        normal: to_from.rotation * contact.normal,
        friction_force: to_from.rotation * contact.friction_force,
        ..*contact
    }
}
