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

    /// Advances by one step of any duration, if [`Solver::is_free`] and no bodies come within reach in it. Returns whether it did; if not, poses
    /// and velocities are as before.
    ///
    /// Bodies are within reach if they may touch at their velocities at the end of the step, by which they move, or are nearer than
    /// [`crate::ImplicitConfig::prediction`] then.
    pub fn step_freely(&mut self, input: &StepInput) -> bool {
        if !self.is_free() || input.forces.iter().any(|force| *force != Vector3::zeros()) {
            return false;
        }
        let model = std::sync::Arc::clone(&self.model);
        let free = model.tree.coordinates.len();
        self.kept_rates.clear();
        self.kept_rates.extend(&self.state.rates);
        let (reference, scenery) = self.begin(&model, input, Springs::Implicit);
        self.problem.points.clear();
        self.problem.patches.clear();
        let balanced = self.solve(&model, &scenery);
        self.state.rates[..free].copy_from_slice(&self.problem.hand.velocity);
        self.place_bodies(&model, input, &reference, &scenery);
        self.referred = reference;
        if !balanced || !self.nothing_in_reach(&model, input) {
            self.state.rates.copy_from_slice(&self.kept_rates);
            return false;
        }
        self.end(&model, input, &scenery, &reference);
        true
    }

    /// Searches every pair, and tells whether none of their points come within reach.
    fn nothing_in_reach(&mut self, model: &Model, input: &StepInput) -> bool {
        let planes = model.scenery.planes(&input.base_from_world);
        let (poses, turns, moving, dt) = (&self.poses, &self.turns, &self.moving, input.dt);
        let now = Situation { dt, poses, turns, moving, planes: &planes, idle: input.idle };
        self.searcher.search(model, &now, &self.asleep);
        let mut pairs = model.pairs.iter().zip(&self.searcher.pairs);
        pairs.all(|(pair, cache)| {
            rests(&pair.sides, |object| self.asleep[object]) || rows::none_in_reach(&now, pair, cache)
        })
    }
}
