//! A saved state: the complete state of an environment as bytes.
//!
//! Eight bytes that change with the layout, a BLAKE3 checksum, and the content in postcard's encoding.

use crate::AgentError;
use crate::actions::arm_controller::ArmController;
use crate::actions::control::Control;
use crate::pool::agent_episode::AgentEpisode;
use crate::pool::env_spec::EnvSpec;
use crate::pool::record::Record;
use crate::rewards::reward::TermValues;
use crate::starts::clutter::{Placed, SceneObjects, scaled, scene_of};
use crate::starts::random_stream::RandomStreamState;
use graspbox_episode::{Episode, EpisodeError, Judge};
use graspbox_mesh::{all_within, checksum};
use graspbox_vision::Mount;
use serde::{Deserialize, Serialize};

/// First bytes of every saved state; the last one changes with the layout.
const MAGIC: &[u8; 8] = b"gbagentd";

/// The content of a saved state.
#[derive(Serialize, Deserialize)]
pub struct SavedState {
    control: Control,
    frame_skip: u32,
    /// Names and mounts of the cameras.
    cameras: Vec<(String, Mount)>,
    object: String,
    /// The random stream.
    pub stream: RandomStreamState,
    world: Vec<u8>,
    judges: Vec<Judge>,
    arm: ArmController,
    record: Record,
    /// The episode is over.
    pub done: bool,
    /// Reward terms of the last step.
    pub terms: TermValues,
    /// The last step ended the episode by success or loss.
    pub terminated: bool,
    /// The last step cut the episode off.
    pub truncated: bool,
}

fn bad(why: impl Into<String>) -> AgentError {
    AgentError::BadState { why: why.into() }
}

impl SavedState {
    /// The state of an episode; the caller fills in `done` and the result of the last step.
    ///
    /// # Errors
    /// An error for a world that cannot be written.
    pub fn of(episode: &AgentEpisode, stream: RandomStreamState, spec: &EnvSpec) -> Result<Self, AgentError> {
        let object = spec.objects.names().nth(episode.record().object).unwrap_or_default().to_owned();
        let sim_error = |source| EpisodeError::Sim { object: object.clone(), source };
        Ok(Self {
            control: spec.config.control,
            frame_skip: spec.config.frame_skip,
            cameras: cameras(spec),
            stream,
            world: episode.episode().world().snapshot().map_err(sim_error)?,
            judges: episode.episode().judges().to_vec(),
            arm: episode.arm().clone(),
            record: episode.record().clone(),
            done: false,
            terms: TermValues::default(),
            terminated: false,
            truncated: false,
            object,
        })
    }

    /// As bytes.
    ///
    /// # Errors
    /// [`AgentError::BadState`] for content that cannot be encoded.
    pub fn encode(&self) -> Result<Vec<u8>, AgentError> {
        let body = postcard::to_allocvec(self).map_err(|error| bad(error.to_string()))?;
        Ok(checksum::seal(MAGIC, &body))
    }

    /// From bytes.
    ///
    /// # Errors
    /// [`AgentError::BadState`] for damaged bytes, or those of another version.
    pub fn decode(bytes: &[u8]) -> Result<Self, AgentError> {
        let body = checksum::open(MAGIC, bytes).map_err(|error| bad(error.to_string()))?;
        postcard::from_bytes(body).map_err(|_| bad("its content cannot be read"))
    }

    /// Checks that the state belongs to environments of `spec`.
    fn fits(&self, spec: &EnvSpec) -> Result<(), AgentError> {
        let index = self.record.object;
        if spec.objects.names().nth(index) != Some(&self.object) {
            return Err(bad(format!("object {index} of this set is not `{}`", self.object)));
        }
        if self.control != spec.config.control || self.frame_skip != spec.config.frame_skip {
            let (control, skip) = (self.control.name(), self.frame_skip);
            return Err(bad(format!("it has the control mode `{control}` with a frame_skip of {skip}")));
        }
        if self.record.target_scene.is_some() != spec.config.has_target() {
            return Err(bad("its layout is another one"));
        }
        if self.judges.iter().any(|judge| *judge.criterion() != spec.config.success) {
            return Err(bad("it is judged by another criterion of success"));
        }
        if self.record.last_action.len() != spec.action {
            return Err(bad("it has another hand"));
        }
        if self.cameras != cameras(spec) {
            let names: Vec<_> = self.cameras.iter().map(|(name, _)| name.as_str()).collect();
            return Err(bad(format!("its cameras are others, or carried by something else: {}", names.join(", "))));
        }
        if self.record.viewpoint.parent_from_camera.len() != self.cameras.len() {
            return Err(bad("one of its cameras has no pose"));
        }
        Ok(())
    }

    /// Refuses numbers that no environment of `spec` saves: the checksum tells that a state was damaged, not who made it.
    fn check(&self, spec: &EnvSpec) -> Result<(), AgentError> {
        let checked = || {
            self.arm.check()?;
            self.record.check(spec)?;
            all_within("terms", self.terms.iter().map(|term| f64::from(*term)), 1e6, "")
        };
        checked().map_err(|error| bad(error.to_string()))?;
        self.record.viewpoint.light.check().map_err(|error| bad(error.to_string()))
    }

    /// The episode of the state.
    ///
    /// # Errors
    /// [`AgentError::BadState`] for a state of other objects, hand, physics, cameras or control mode.
    pub fn episode(&self, spec: &EnvSpec) -> Result<AgentEpisode, AgentError> {
        self.fits(spec)?;
        self.check(spec)?;
        let record = &self.record;
        let target = record.target_scene.as_ref().map(|scene| scene.target as usize);
        let (scene, prepared) = match record.placed() {
            Some(placed) => placed_scene(spec, placed, target)?,
            None => {
                let prepared = spec.objects.prepared(record.object)?;
                let (resting, scene) = spec.objects.scene(&prepared, record.resting)?;
                if resting != record.resting {
                    return Err(bad("the object no longer rests in that pose"));
                }
                (scene, vec![prepared])
            }
        };
        let episode = Episode::resume(&scene, &self.world, self.judges.clone()).map_err(|error| match error {
            EpisodeError::OutOfRange(error) => bad(error.to_string()),
            other => other.into(),
        })?;
        Ok(AgentEpisode::resume(episode, prepared, self.arm.clone(), record.clone()))
    }
}

/// The scene of several objects.
fn placed_scene(spec: &EnvSpec, placed: &[Placed], target: Option<usize>) -> Result<SceneObjects, AgentError> {
    let prepared = placed.iter().map(|placed| scaled(&spec.objects, placed.object, placed.scale));
    let prepared = prepared.collect::<Result<Vec<_>, _>>()?;
    Ok((scene_of(spec, &prepared, placed, target)?, prepared))
}

fn cameras(spec: &EnvSpec) -> Vec<(String, Mount)> {
    let all = spec.observer.config().cameras.iter();
    all.map(|camera| (camera.name.clone(), camera.mount)).collect()
}
