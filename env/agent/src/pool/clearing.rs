//! Clearing a scene of several objects: what remains after each attempt, and when the episode is over.
//!
//! After an attempt the objects in the hand are taken away, the hand returns to where it waited, and the others come to rest. Those that end
//! outside the workspace are lost. So did the rounds of VGN (Breyer et al., "Volumetric Grasping Network", 2020).

use crate::AgentError;
use crate::actions::decision::Outcome;
use crate::objects::Prepared;
use crate::pool::env_spec::EnvSpec;
use crate::starts::clutter::{Placed, SceneObjects, scene_of};
use graspbox_episode::Body;
use graspbox_mesh::range::{OutOfRange, in_range};
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// An object that moved by more than this in an attempt was disturbed, metres.
pub const DISTURBED: f64 = 0.01;

/// The last attempt.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LastAttempt {
    /// Rise of the object's centre of mass, metres.
    pub lift: f64,
    /// The grasp was secure.
    pub secure: bool,
    /// The hand touched an object.
    pub touches: bool,
    /// Number of objects that were disturbed and are still there.
    pub disturbed: u32,
}

/// The record of an episode that clears a scene; part of every saved state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Clearing {
    /// The objects of the scene, in its order. Once the last one is gone they are those of the last attempt.
    pub objects: Vec<Placed>,
    /// Number of objects when the episode began.
    pub begun: u32,
    /// Number of attempts.
    pub attempts: u32,
    /// Number of objects taken away.
    pub cleared: u32,
    /// Number of objects that left the workspace.
    pub lost: u32,
    /// Failures in a row.
    pub failures: u32,
    /// The last attempt.
    pub last: LastAttempt,
}

impl Clearing {
    /// Before the first attempt.
    pub fn new(objects: Vec<Placed>) -> Self {
        let begun = objects.len() as u32;
        Self { objects, begun, attempts: 0, cleared: 0, lost: 0, failures: 0, last: LastAttempt::default() }
    }

    /// Number of objects that are still there.
    pub fn remaining(&self) -> u32 {
        self.begun.saturating_sub(self.cleared + self.lost)
    }

    /// True once nothing is left, or after `most` failures in a row.
    pub fn over(&self, most: u32) -> bool {
        self.remaining() == 0 || self.failures >= most
    }

    /// Records an attempt in which nothing moved.
    pub fn nothing_moved(&mut self) {
        self.attempts = self.attempts.saturating_add(1);
        self.failures = self.failures.saturating_add(1);
        self.last = LastAttempt::default();
    }

    /// Records an attempt, takes the objects in the hand away, and lets the others come to rest. Returns the next scene; `None` if nothing is left.
    ///
    /// * `prepared`: the objects of the scene, in its order.
    /// * `factors`: on the friction and the mass of every object.
    ///
    /// # Errors
    /// An error of the simulation.
    pub fn attempted(
        &mut self,
        outcome: &Outcome,
        prepared: &[Arc<Prepared>],
        factors: [f64; 2],
        spec: &EnvSpec,
    ) -> Result<Option<SceneObjects>, AgentError> {
        let world = outcome.episode.world();
        let held: Vec<usize> = if outcome.attempt.success { outcome.episode.held_objects().collect() } else { vec![] };
        self.attempts = self.attempts.saturating_add(1);
        self.failures = if held.is_empty() { self.failures.saturating_add(1) } else { 0 };
        self.cleared += held.len() as u32;
        self.last = LastAttempt {
            lift: outcome.episode.verdict().lift,
            secure: outcome.attempt.secure,
            touches: outcome.touched,
            disturbed: 0,
        };
        // A world that diverged tells nothing: its objects are where they were.
        let diverged = !world.is_finite();
        let before = self.objects.iter().map(|object| object.world_from_object);
        let after: Vec<_> = if diverged { before.collect() } else { world.world_from_objects().collect() };
        let left: Vec<usize> = (0..prepared.len()).filter(|index| !held.contains(index)).collect();
        if left.is_empty() {
            return Ok(None);
        }
        let bodies: Vec<&Body> = left.iter().map(|index| prepared[*index].body()).collect();
        let poses = left.iter().map(|index| after[*index]).collect();
        let physics = *spec.objects.physics();
        let found = spec.config.clutter.workspace().settle(&bodies, poses, factors, spec.hand(), physics)?;
        self.lost += (left.len() - found.objects.len()) as u32;
        let stayed: Vec<usize> = found.objects.iter().map(|index| left[*index]).collect();
        if stayed.is_empty() {
            return Ok(None);
        }
        let moved = |(index, pose): (&usize, &Isometry3<f64>)| {
            let center = prepared[*index].body().model().center_of_mass();
            (pose * center - self.objects[*index].world_from_object * center).norm() > DISTURBED
        };
        self.last.disturbed = stayed.iter().zip(&found.world_from_objects).filter(|pair| moved(*pair)).count() as u32;
        let remaining = stayed.iter().zip(&found.world_from_objects);
        let remaining = remaining.map(|(i, pose)| Placed { world_from_object: *pose, ..self.objects[*i].clone() });
        self.objects = remaining.collect();
        let prepared: Vec<_> = stayed.iter().map(|index| Arc::clone(&prepared[*index])).collect();
        Ok(Some((scene_of(spec, &prepared, &self.objects, None)?, prepared)))
    }

    /// Refuses states that no episode of `spec` can have.
    ///
    /// # Errors
    /// [`OutOfRange`], naming the first number.
    pub(crate) fn check(&self, spec: &EnvSpec) -> Result<(), OutOfRange> {
        Placed::check(&self.objects, spec)?;
        let most = spec.config.clutter.most_objects() as f64;
        in_range("clearing.begun", f64::from(self.begun), 1.0..=most, "")?;
        let gone = f64::from(self.cleared) + f64::from(self.lost);
        in_range("clearing.cleared + clearing.lost", gone, 0.0..=f64::from(self.begun), "")?;
        in_range("clearing.failures", f64::from(self.failures), 0.0..=f64::from(self.attempts), "")
    }
}
