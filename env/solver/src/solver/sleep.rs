//! Sleep: objects that rest are not simulated until something touches them.
//!
//! An island without the hand falls asleep once all of its objects have been slower than [`SLOW`] relative to the scenery for [`RESTS`], or for
//! [`CONFIRMED`] if they are expected to rest. Its objects then keep their poses in the world exactly. They wake together, in the step in which a
//! contact with a body that is awake becomes possible, a force acts on one of them, or their state is set.
//!
//! The contact points of the last step before sleep remain the contacts of the sleepers.

use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};

use super::{ObjectState, Solver, StepInput};
use crate::contact::Contact;
use crate::kinematics::Twist;
use crate::model::{BodyKind, Model, Pair};

/// Speed below which every point of a resting object stays, m/s.
const SLOW: f64 = 1e-3;
/// Time for which it stays so before it sleeps, seconds.
const RESTS: f64 = 0.2;

/// The same for an object that came to rest before where it is, seconds. One that falls is faster by then; one that stands on an edge may not be.
const CONFIRMED: f64 = 0.01;

/// A sleeping object.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Sleep {
    /// Its pose, which does not change.
    pub world_from_object: Isometry3<f64>,
    /// Index of the first object that fell asleep in the same island.
    pub island: u32,
}

impl ObjectState {
    /// Wakes the object.
    pub(crate) fn wake(&mut self) {
        (self.slow_for, self.asleep) = (0.0, None);
    }
}

/// Whether no contact of a pair changes: both bodies rest.
#[inline]
pub(crate) fn rests(asleep: &[bool], pair: &Pair) -> bool {
    match pair.sides {
        [BodyKind::Object(a), BodyKind::Object(b)] => asleep[a] && asleep[b],
        [BodyKind::Object(a), BodyKind::Scenery] => asleep[a],
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
            if let Some(sleep) = &object.asleep {
                object.base_from_object = input.base_from_world * sleep.world_from_object;
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

    /// Wakes an object and those that fell asleep with it, if it sleeps.
    pub(super) fn wake(&mut self, object: usize) {
        let Some(island) = self.state.objects[object].asleep.as_ref().map(|sleep| sleep.island) else { return };
        let model = std::sync::Arc::clone(&self.model);
        for (index, object) in self.state.objects.iter_mut().enumerate() {
            if object.asleep.as_ref().is_some_and(|sleep| sleep.island == island) {
                object.wake();
                if let Some(asleep) = self.asleep.get_mut(index) {
                    *asleep = false;
                }
                let of_it = |contact: &Contact| {
                    contact.sides.iter().any(|side| matches!(model.kind(side.body), BodyKind::Object(o) if o == index))
                };
                self.rested.retain(|contact| !of_it(contact));
            }
        }
    }

    /// Puts islands to sleep whose objects have rested long enough.
    pub(super) fn put_to_sleep(&mut self, model: &Model, input: &StepInput, scenery: &Twist) {
        for island in 0..self.islands.all.len() {
            let (hand, objects) = (self.islands.all[island].hand, self.islands.objects(&self.islands.all[island]));
            let held =
                |patch: &usize| self.problem.patches[*patch].sides.iter().any(|side| matches!(side, BodyKind::Hand(_)));
            let touched = self.islands.patches(&self.islands.all[island]).iter().any(held);
            let slow = !hand && !touched && objects.iter().all(|object| self.is_slow(model, *object, scenery));
            let objects: Vec<usize> = objects.to_vec();
            let mut rested = !objects.is_empty();
            for object in &objects {
                let state = &mut self.state.objects[*object];
                state.slow_for = if slow { state.slow_for + input.dt } else { 0.0 };
                rested &= state.slow_for >= RESTS;
            }
            if rested {
                self.sleep(model, input, &objects);
            }
        }
    }

    /// Whether every point of an object is slow relative to the scenery.
    fn is_slow(&self, model: &Model, object: usize, scenery: &Twist) -> bool {
        let (state, terms) = (&self.state.objects[object], &self.problem.objects[object]);
        let moved = scenery.at(&(terms.center - self.referred));
        (state.linear - moved).norm() + (state.angular - scenery.angular).norm() * model.radius[object] < SLOW
    }

    /// Puts the objects of an island to sleep.
    fn sleep(&mut self, model: &Model, input: &StepInput, objects: &[usize]) {
        let island = objects.iter().copied().min().unwrap_or_default() as u32;
        let world_from_base = input.base_from_world_after.inverse();
        for object in objects {
            let state = &mut self.state.objects[*object];
            state.asleep = Some(Sleep { world_from_object: world_from_base * state.base_from_object, island });
        }
        let world_from_base = input.base_from_world.inverse();
        for (index, source) in self.sources.iter().enumerate() {
            let pair = &model.pairs[source.pair as usize];
            if pair.sides.iter().any(|side| matches!(side, BodyKind::Object(object) if objects.contains(object))) {
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
