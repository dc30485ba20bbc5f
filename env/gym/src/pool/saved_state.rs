//! A saved state: the complete state of an environment as bytes.
//!
//! Eight bytes that change with the layout, a BLAKE3 checksum, and the content in postcard's encoding.

use crate::EnvError;
use crate::actions::arm_controller::ArmController;
use crate::actions::control::Fingers;
use crate::pool::env_episode::EnvEpisode;
use crate::pool::env_spec::EnvSpec;
use crate::pool::episode_body::EpisodeBody;
use crate::rewards::reward::TermValues;
use crate::starts::clutter::{SceneObjects, scaled, scene_of};
use crate::starts::random_stream::RandomStreamState;
use crate::state::{GoalConfig, Mode, Placed, Record, SceneKind};
use graspbox_episode::{Episode, EpisodeError, Judge};
use graspbox_mesh::{all_within, checksum};
use graspbox_render::Mount;
use serde::{Deserialize, Serialize};

/// First bytes of every saved state; the last one changes with the layout.
const MAGIC: &[u8; 8] = b"gbstate4";

/// The content of a saved state.
#[derive(Serialize, Deserialize)]
pub struct SavedState {
    fingers: Fingers,
    control_freq: f64,
    goal: Option<GoalConfig>,
    /// Names and mounts of the cameras.
    cameras: Vec<(String, Mount)>,
    object: String,
    pub stream: RandomStreamState,
    world: Vec<u8>,
    judges: Vec<Judge>,
    arm: ArmController,
    record: Record,
    mode: Mode,
    /// The episode is over.
    pub done: bool,
    /// Reward terms of the last step.
    pub terms: TermValues,
    /// The last step ended the episode by success or loss.
    pub terminated: bool,
    /// The last step cut the episode off.
    pub truncated: bool,
}

fn bad(why: impl Into<String>) -> EnvError {
    EnvError::BadState { why: why.into() }
}

impl SavedState {
    /// The state of an episode; the caller fills in `done` and the result of the last step.
    ///
    /// # Errors
    /// An error for a world that cannot be written.
    pub fn of(episode: &EnvEpisode, stream: RandomStreamState, spec: &EnvSpec) -> Result<Self, EnvError> {
        let object = spec.objects.names().nth(episode.record().object).unwrap_or_default().to_owned();
        let sim_error = |source| EpisodeError::Sim { object: object.clone(), source };
        Ok(Self {
            fingers: spec.config.fingers,
            control_freq: spec.config.control_freq,
            goal: spec.config.goal,
            cameras: cameras(spec),
            stream,
            world: episode.episode().world().snapshot().map_err(sim_error)?,
            judges: episode.episode().judges().to_vec(),
            arm: episode.arm().clone(),
            record: episode.record().clone(),
            mode: episode.mode().clone(),
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
    /// [`EnvError::BadState`] for content that cannot be encoded.
    pub fn encode(&self) -> Result<Vec<u8>, EnvError> {
        let body = postcard::to_allocvec(self).map_err(|error| bad(error.to_string()))?;
        Ok(checksum::seal(MAGIC, &body))
    }

    /// From bytes.
    ///
    /// # Errors
    /// [`EnvError::BadState`] for damaged bytes, or those of another version.
    pub fn decode(bytes: &[u8]) -> Result<Self, EnvError> {
        let body = checksum::open(MAGIC, bytes).map_err(|error| bad(error.to_string()))?;
        postcard::from_bytes(body).map_err(|_| bad("its content cannot be read"))
    }

    /// Checks that the state belongs to environments of `spec`.
    fn fits(&self, spec: &EnvSpec) -> Result<(), EnvError> {
        let index = self.record.object;
        if spec.objects.names().nth(index) != Some(&self.object) {
            return Err(bad(format!("object {index} of this set is not `{}`", self.object)));
        }
        let (control, decides) = (self.mode.control(), spec.config.control.decides());
        let same = self.fingers == spec.config.fingers && self.control_freq == spec.config.control_freq;
        if control != spec.config.control || !(decides || same) {
            let (control, fingers, freq) = (control.name(), self.fingers.name(), self.control_freq);
            return Err(bad(format!(
                "it has the control mode `{control}`, fingers `{fingers}` and {freq} actions per second"
            )));
        }
        if self.goal != spec.config.goal || self.goal.map(|g| g.task) != self.record.goal.map(|g| g.task) {
            return Err(bad("it has another goal task, threshold or end"));
        }
        if self.mode.target_scene().is_some() != spec.config.has_target() {
            return Err(bad("its layout is another one"));
        }
        if self.judges.iter().any(|judge| *judge.criterion() != spec.config.success) {
            return Err(bad("it is judged by another criterion of success"));
        }
        if self.record.last_action.len() != spec.action {
            return Err(bad("it has another hand"));
        }
        if !self.arm.fits(spec.arm.as_ref()) {
            return Err(bad("its arm is another one, or stands elsewhere"));
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

    /// Refuses numbers that no environment of `spec` saves: the checksum shows damage, not who made the state.
    fn check(&self, spec: &EnvSpec) -> Result<(), EnvError> {
        let bounds = spec.state_bounds();
        let checked = || {
            self.arm.check()?;
            self.record.check(&bounds)?;
            self.mode.check(self.record.object, &bounds)?;
            all_within("terms", self.terms.iter().map(|term| f64::from(*term)), 1e6, "")
        };
        checked().map_err(|error| bad(error.to_string()))?;
        self.record.viewpoint.light.check().map_err(|error| bad(error.to_string()))
    }

    /// The scene of the state, and its objects.
    fn scene(&self, spec: &EnvSpec) -> Result<SceneObjects, EnvError> {
        let kind = match &self.mode {
            Mode::Clear(state) => return placed_scene(spec, &state.objects, None),
            Mode::Grasp(state) => &state.scene,
            Mode::GraspPose(state) => &state.scene,
        };
        match kind {
            SceneKind::Target(scene) => placed_scene(spec, &scene.objects, Some(scene.target as usize)),
            SceneKind::Single { resting, .. } => {
                let prepared = spec.objects.prepared(self.record.object)?;
                let (found, scene) = spec.objects.scene(&prepared, *resting)?;
                if found != *resting {
                    return Err(bad("the object no longer rests in that pose"));
                }
                Ok((scene, vec![prepared]))
            }
        }
    }

    /// The episode of the state.
    ///
    /// # Errors
    /// [`EnvError::BadState`] for a state of other objects, hand, physics, cameras or control mode.
    pub fn episode(&self, spec: &EnvSpec) -> Result<EnvEpisode, EnvError> {
        self.fits(spec)?;
        self.check(spec)?;
        let (scene, prepared) = self.scene(spec)?;
        let episode = Episode::resume(&scene, &self.world, self.judges.clone()).map_err(|error| match error {
            EpisodeError::OutOfRange(error) => bad(error.to_string()),
            other => other.into(),
        })?;
        let body = EpisodeBody { episode, prepared, arm: self.arm.clone(), record: self.record.clone() };
        Ok(EnvEpisode::resume(body, self.mode.clone()))
    }
}

/// The scene of several objects.
fn placed_scene(spec: &EnvSpec, placed: &[Placed], target: Option<usize>) -> Result<SceneObjects, EnvError> {
    let prepared = placed.iter().map(|placed| scaled(&spec.objects, placed.object, placed.scale));
    let prepared = prepared.collect::<Result<Vec<_>, _>>()?;
    Ok((scene_of(spec, &prepared, placed, target)?, prepared))
}

fn cameras(spec: &EnvSpec) -> Vec<(String, Mount)> {
    let all = spec.observer.config().cameras.iter();
    all.map(|camera| (camera.name.clone(), camera.mount)).collect()
}
