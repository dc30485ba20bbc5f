//! Settings of environments: control, endings, observations, randomization.

use crate::AgentError;
use crate::actions::control::Control;
use crate::observations::observation::Observation;
use graspbox_episode::{Layout, SPREADS, SuccessCriterion, TrialConfig};
use graspbox_mesh::in_range;
use graspbox_sim::Wall;
use graspbox_vision::CamerasConfig;
use serde::{Deserialize, Serialize};

/// Most control periods of a step: 5 s.
const MOST_FRAME_SKIP: f64 = 100.0;
/// Most objects of a scene.
const MOST_OBJECTS: f64 = 40.0;

/// When an environment begins the next episode after the end of one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Autoreset {
    /// At the next step, which then ignores the action.
    #[default]
    NextStep,
    /// At once; the last observation and info of the ended episode are returned separately.
    SameStep,
    /// Only when it is reset.
    Disabled,
}

/// Domain randomization beside objects and initial poses; ranges at their neutral values are off.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Randomization {
    /// Least and greatest factor on the object's friction.
    pub friction: [f64; 2],
    /// Least and greatest factor on the object's mass.
    pub mass: [f64; 2],
    /// Additional variation of the object's x and y, metres.
    pub object_position: f64,
    /// Greatest constant error of the hand's position in an episode along each axis, metres.
    pub hand_position: f64,
    /// Greatest constant error of the hand's rotation in an episode about each axis, radians.
    pub hand_rotation: f64,
    /// Greatest shift of a camera along each of its axes, metres.
    pub camera_position: f64,
    /// Greatest rotation of a camera about each of its axes, radians.
    pub camera_rotation: f64,
    /// Variation of the light, in [0, 1]: at 1 the lamp rotates by up to 0.7 rad, and its strength changes by up to half.
    pub light: f64,
}

impl Default for Randomization {
    fn default() -> Self {
        Self {
            friction: [1.0, 1.0],
            mass: [1.0, 1.0],
            object_position: 0.0,
            hand_position: 0.0,
            hand_rotation: 0.0,
            camera_position: 0.0,
            camera_rotation: 0.0,
            light: 0.0,
        }
    }
}

impl Randomization {
    /// The preset `"standard"`: friction within 30 %, mass within 25 %, a hand calibrated to 5 mm and 1.7 degrees, cameras to
    /// 1 cm and 1.1 degrees, and varied light.
    pub fn standard() -> Self {
        Self {
            friction: [0.7, 1.3],
            mass: [0.75, 1.25],
            object_position: 0.03,
            hand_position: 0.005,
            hand_rotation: 0.03,
            camera_position: 0.01,
            camera_rotation: 0.02,
            light: 0.5,
        }
    }
}

/// Scenes of several objects. Where a single object lies, `objects_per_scene`, `scale` and `spread` mean nothing.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ClutterConfig {
    /// How the objects lie; `None`: a single object, in one of its resting poses.
    pub layout: Option<Layout>,
    /// Least and greatest number of objects.
    pub objects_per_scene: [usize; 2],
    /// Least and greatest scale of an object.
    pub scale: [f64; 2],
    /// Distance of the objects from the middle ([`graspbox_episode::Draw::spread`]).
    pub spread: f64,
    /// Failures in a row after which an episode of [`Control::Clear`] is over.
    pub max_failures: u32,
}

impl Default for ClutterConfig {
    fn default() -> Self {
        Self { layout: None, objects_per_scene: [5, 5], scale: [1.0, 1.0], spread: 1.0, max_failures: 2 }
    }
}

impl ClutterConfig {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`AgentError::OutOfRange`], naming the first setting that is out of range.
    pub fn validate(&self) -> Result<(), AgentError> {
        let [low, high] = self.objects_per_scene;
        in_range("objects_per_scene[0]", low as f64, 1.0..=MOST_OBJECTS, "")?;
        in_range("objects_per_scene[1]", high as f64, low as f64..=MOST_OBJECTS, "")?;
        in_range("scale[0]", self.scale[0], 0.1..=10.0, "")?;
        in_range("scale[1]", self.scale[1], self.scale[0]..=10.0, "")?;
        in_range("spread", self.spread, SPREADS, "")?;
        in_range("max_failures", f64::from(self.max_failures), 1.0..=1e6, "")?;
        self.walls()?;
        Ok(())
    }

    /// Walls of every scene.
    ///
    /// # Errors
    /// As [`Layout::walls`].
    pub fn walls(&self) -> Result<Vec<Wall>, AgentError> {
        self.layout.map_or(Ok(Vec::new()), |layout| Ok(layout.walls()?))
    }

    /// Most objects of a scene.
    pub fn most_objects(&self) -> usize {
        if self.layout.is_some() { self.objects_per_scene[1] } else { 1 }
    }

    /// Least and greatest scale of an object; 1 for a single one.
    pub(crate) fn scales(&self) -> [f64; 2] {
        if self.layout.is_some() { self.scale } else { [1.0, 1.0] }
    }

    /// The layout whose workspace objects must not leave after an attempt: for a single object that of packed ones.
    pub(crate) fn workspace(&self) -> Layout {
        self.layout.unwrap_or(Layout::Packed)
    }
}

/// Settings of a pool of environments.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AgentConfig {
    /// Control mode: the meaning of an action.
    pub control: Control,
    /// When an environment begins the next episode after the end of one.
    pub autoreset: Autoreset,
    /// Number of control periods of a step; its action applies to all of them.
    pub frame_skip: u32,
    /// Number of steps after which an episode is truncated; `None`: never.
    pub max_episode_steps: Option<u32>,
    /// Observations, in this order.
    pub observations: Vec<Observation>,
    /// Domain randomization.
    pub randomization: Randomization,
    /// How objects lie. [`Control::Clear`] clears all of them; in the other modes one of several is the target.
    pub clutter: ClutterConfig,
    /// Cameras and images.
    pub cameras: CamerasConfig,
    /// The criterion of success in every control mode.
    pub success: SuccessCriterion,
    /// The trial after a decision; closed-loop control has none. [`AgentConfig::success`] replaces its own `success`.
    pub trial: TrialConfig,
}

impl Default for AgentConfig {
    fn default() -> Self {
        Self {
            control: Control::default(),
            autoreset: Autoreset::default(),
            frame_skip: 1,
            max_episode_steps: None,
            observations: Observation::ALL.to_vec(),
            randomization: Randomization::default(),
            clutter: ClutterConfig::default(),
            cameras: CamerasConfig::default(),
            success: SuccessCriterion::default(),
            trial: TrialConfig::default(),
        }
    }
}

impl Randomization {
    /// Checks every range.
    ///
    /// # Errors
    /// [`AgentError::OutOfRange`], naming the first setting that is out of range.
    pub fn validate(&self) -> Result<(), AgentError> {
        in_range("randomization.friction[0]", self.friction[0], 0.1..=10.0, "")?;
        in_range("randomization.friction[1]", self.friction[1], self.friction[0]..=10.0, "")?;
        in_range("randomization.mass[0]", self.mass[0], 0.1..=10.0, "")?;
        in_range("randomization.mass[1]", self.mass[1], self.mass[0]..=10.0, "")?;
        in_range("randomization.object_position", self.object_position, 0.0..=0.15, "m")?;
        in_range("randomization.hand_position", self.hand_position, 0.0..=0.05, "m")?;
        in_range("randomization.hand_rotation", self.hand_rotation, 0.0..=0.5, "rad")?;
        in_range("randomization.camera_position", self.camera_position, 0.0..=1.0, "m")?;
        in_range("randomization.camera_rotation", self.camera_rotation, 0.0..=0.5, "rad")?;
        Ok(in_range("randomization.light", self.light, 0.0..=1.0, "")?)
    }
}

impl AgentConfig {
    /// The trial that follows a decision, judged by [`AgentConfig::success`]. It has no observer: a trial that would await one runs to its end.
    pub fn trial(&self) -> TrialConfig {
        let early_stop = self.trial.early_stop && !self.trial.await_observer;
        TrialConfig { success: self.success, early_stop, ..self.trial }
    }

    /// True if an episode is about one target among several objects.
    pub fn has_target(&self) -> bool {
        self.control != Control::Clear && self.clutter.layout.is_some()
    }

    /// True if the hand pushes aside what it touches on its way to the pose of a decision; otherwise that is infeasible. A push would move a
    /// single object away from the grasp, but among others a real hand can make such a grasp.
    pub fn pushes(&self) -> bool {
        self.control == Control::Clear || self.has_target()
    }

    /// Checks every setting.
    ///
    /// # Errors
    /// [`AgentError::OutOfRange`], naming the first setting that is out of range; [`AgentError::Twice`] for an observation.
    pub fn validate(&self) -> Result<(), AgentError> {
        self.randomization.validate()?;
        let skip = if self.control.decides() { 1.0 } else { MOST_FRAME_SKIP };
        in_range("frame_skip", f64::from(self.frame_skip), 1.0..=skip, "")?;
        in_range("max_episode_steps", f64::from(self.max_episode_steps.unwrap_or(1)), 1.0.., "")?;
        self.success.validate()?;
        if self.trial.success != SuccessCriterion::default() && self.trial.success != self.success {
            return Err(AgentError::TwoCriteria);
        }
        if self.control.decides() {
            self.trial().validate()?;
        }
        self.clutter.validate()?;
        for (i, observation) in self.observations.iter().enumerate() {
            if self.observations[..i].contains(observation) {
                return Err(AgentError::Twice { name: observation.name().to_owned() });
            }
        }
        Ok(())
    }
}
