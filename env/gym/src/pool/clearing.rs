//! Clearing a scene of several objects: what remains after each attempt, and when the episode is over.
//!
//! After an attempt the objects in the hand are taken away, the hand returns to where it waited, and the others come to rest. Those that end
//! outside the workspace are lost. So did the rounds of VGN (Breyer et al., "Volumetric Grasping Network", 2020).

use crate::EnvError;
use crate::actions::decision::Outcome;
use crate::objects::Prepared;
use crate::pool::env_spec::EnvSpec;
use crate::pool::episode_body::EpisodeBody;
use crate::rewards::reward::Attempt;
use crate::starts::clutter::{SceneObjects, scene_of};
use crate::state::mode::DISTURBED;
use crate::state::{ClearState, LastAttempt, Placed};
use graspbox_episode::{Body, Episode};
use nalgebra::Isometry3;
use std::sync::Arc;

impl ClearState {
    /// Tries the grasp of `action`, takes the objects in the hand away, and lets the others come to rest; the hand waits again while any remain.
    ///
    /// # Errors
    /// An error of the simulation.
    pub(crate) fn step(&mut self, body: &mut EpisodeBody, action: &[f32], spec: &EnvSpec) -> Result<Attempt, EnvError> {
        let Some(outcome) = body.decide(action, spec, &mut self.result)? else {
            self.nothing_moved();
            return Ok(Attempt { infeasible: true, ..Attempt::default() });
        };
        let attempt = outcome.attempt;
        if !outcome.moved {
            self.nothing_moved();
            body.wait(&self.waiting, spec);
            return Ok(attempt);
        }
        body.record.object = self.objects[outcome.episode.world().target()].object;
        let factors = [body.record.friction, body.record.mass];
        let Some((scene, prepared)) = self.attempted(&outcome, &body.prepared, factors, spec)? else {
            body.go_on(outcome.episode);
            return Ok(attempt);
        };
        let (object, criterion) = (scene.world_from_object(), spec.config.success);
        body.episode = Episode::reset_at(&scene, &self.waiting, object, body.record.preshape, factors, criterion);
        body.record.first_center = body.episode.world().object_center();
        body.prepared = prepared;
        body.wait(&self.waiting, spec);
        Ok(attempt)
    }

    /// Records an attempt in which nothing moved.
    fn nothing_moved(&mut self) {
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
    fn attempted(
        &mut self,
        outcome: &Outcome,
        prepared: &[Arc<Prepared>],
        factors: [f64; 2],
        spec: &EnvSpec,
    ) -> Result<Option<SceneObjects>, EnvError> {
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
        // Poses of a world that diverged mean nothing: its objects count as unmoved.
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
}
