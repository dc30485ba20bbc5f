//! Long steps: while nothing touches and nothing can come within reach, one step takes the place of several.
//!
//! Only the hand's own joints move then, by cables, stops and springs, all of them implicit; the objects sleep.

use nalgebra::Vector3;

use super::{Solver, StepInput};
use crate::model::Model;
use crate::problem::rows;
use crate::search::Situation;
use crate::solver::sleep::rests;
use crate::tree::Coordinate;

/// Integration of the joints' springs.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Springs {
    /// With the forces of the beginning of the step.
    Explicit,
    /// With those of its end, which no duration makes unstable.
    Implicit,
}

impl Springs {
    /// What a spring adds to the damping of its joint in a step of `dt` seconds: its force at the end is less by `dt k v`.
    #[inline]
    pub fn damping(self, coordinate: &Coordinate, dt: f64) -> f64 {
        if self == Self::Implicit { dt * coordinate.stiffness } else { 0.0 }
    }
}

impl Solver {
    /// True if every object sleeps, and the last step had no contacts but theirs.
    #[must_use]
    pub fn is_free(&self) -> bool {
        let touched = !self.sources.is_empty() || self.loaded.len() > self.rested.len();
        !touched && self.state.objects.iter().all(|object| object.asleep.is_some())
    }

    /// Advances by one step that lasts as long as `steps` of them, if [`Solver::is_free`] and no bodies come within reach in it. Returns whether
    /// it did; if not, poses and velocities are as before.
    ///
    /// Bodies are within reach if they may touch at their present velocities, or farther apart by at most `steps` times
    /// [`crate::ImplicitConfig::prediction`], which allows for the speed that they gain. Two bodies of the hand may overlap by what they gain:
    /// the fingers of most hands are always near each other.
    pub fn step_freely(&mut self, input: &StepInput, steps: u32) -> bool {
        if !self.is_free() || input.forces.iter().any(|force| *force != Vector3::zeros()) {
            return false;
        }
        let model = std::sync::Arc::clone(&self.model);
        let free = model.tree.coordinates.len();
        self.kept_rates.clear();
        self.kept_rates.extend(&self.state.rates[free..]);
        let (reference, scenery) = self.begin(&model, input, Springs::Implicit);
        self.place_bodies(&model, input, &reference, &scenery);
        self.referred = reference;
        if !self.nothing_in_reach(&model, input, steps) {
            self.state.rates[free..].copy_from_slice(&self.kept_rates);
            return false;
        }
        self.problem.points.clear();
        self.problem.patches.clear();
        self.end(&model, input, &scenery);
        true
    }

    /// Searches every pair, and tells whether none of their points come within reach.
    fn nothing_in_reach(&mut self, model: &Model, input: &StepInput, steps: u32) -> bool {
        let planes = model.scenery.planes(&input.base_from_world);
        let (poses, turns, moving, dt) = (&self.poses, &self.turns, &self.moving, input.dt);
        let prediction = f64::from(steps) * model.config.prediction;
        let now = Situation { dt, prediction, poses, turns, moving, planes: &planes, idle: input.idle };
        self.searcher.search(model, &now, &self.asleep);
        let mut pairs = model.pairs.iter().zip(&self.searcher.pairs);
        pairs.all(|(pair, cache)| rests(&self.asleep, pair) || rows::none_in_reach(&now, pair, cache))
    }
}
