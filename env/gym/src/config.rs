//! Settings of environments: control, endings, observations, randomization.

use crate::EnvError;
use crate::actions::control::{ActionSpec, Control, Fingers, Timing};
use crate::observations::observation::Observation;
use crate::state::GoalConfig;
use graspbox_episode::{Layout, SPREADS, SuccessCriterion, TrialConfig};
use graspbox_mesh::in_range;
use graspbox_render::CamerasConfig;
use graspbox_sim::Wall;
use serde::{Deserialize, Serialize};

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

/// Domain randomization besides objects and initial poses; ranges at their neutral values are off.
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
    /// Layout of the objects; `None`: a single object, in one of its resting poses.
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
    /// [`EnvError::OutOfRange`], naming the first setting that is out of range.
    pub fn validate(&self) -> Result<(), EnvError> {
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
    pub fn walls(&self) -> Result<Vec<Wall>, EnvError> {
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
pub struct EnvConfig {
    /// Control mode: how an action moves the hand.
    pub control: Control,
    /// How an action moves the fingers; without meaning where a step is a decision, as the next one.
    pub fingers: Fingers,
    /// Actions per second, Hz.
    pub control_freq: f64,
    /// When an environment begins the next episode after the end of one.
    pub autoreset: Autoreset,
    /// Number of steps after which an episode is truncated; `None`: never.
    pub max_episode_steps: Option<u32>,
    /// Observations, in this order.
    pub observations: Vec<Observation>,
    /// Domain randomization.
    pub randomization: Randomization,
    /// Layout of the objects. [`Control::Clear`] clears all of them; in the other modes one of several is the target.
    pub clutter: ClutterConfig,
    /// Cameras and images.
    pub cameras: CamerasConfig,
    /// Goals; only in closed-loop control of a single object, with one observation besides those of the goal.
    pub goal: Option<GoalConfig>,
    /// The criterion of success in every control mode, without goals.
    pub success: SuccessCriterion,
    /// The trial after a decision; closed-loop control has none. [`EnvConfig::success`] replaces its own `success`.
    pub trial: TrialConfig,
}

impl Default for EnvConfig {
    fn default() -> Self {
        Self {
            control: Control::default(),
            fingers: Fingers::default(),
            control_freq: 5.0,
            autoreset: Autoreset::default(),
            max_episode_steps: None,
            observations: Observation::ALL.to_vec(),
            randomization: Randomization::default(),
            clutter: ClutterConfig::default(),
            cameras: CamerasConfig::default(),
            goal: None,
            success: SuccessCriterion::default(),
            trial: TrialConfig::default(),
        }
    }
}

impl Randomization {
    /// Checks every range.
    ///
    /// # Errors
    /// [`EnvError::OutOfRange`], naming the first setting that is out of range.
    pub fn validate(&self) -> Result<(), EnvError> {
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

impl EnvConfig {
    /// The trial that follows a decision, judged by [`EnvConfig::success`]. It has no observer: a trial that would await one runs to its end.
    pub fn trial(&self) -> TrialConfig {
        let early_stop = self.trial.early_stop && !self.trial.await_observer;
        TrialConfig { success: self.success, early_stop, ..self.trial }
    }

    /// The meaning of an action.
    pub fn action(&self) -> ActionSpec {
        ActionSpec { control: self.control, fingers: self.fingers }
    }

    /// The name of an observation in results: with a goal, all but those of the goal are called `observation`.
    pub fn shown_name<'a>(&self, name: &'a str) -> &'a str {
        let own = self.goal.is_none() || Observation::GOAL.iter().any(|goal| goal.name() == name);
        if own { name } else { "observation" }
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
    /// [`EnvError::OutOfRange`], naming the first setting that is out of range; [`EnvError::Twice`] for an observation.
    pub fn validate(&self) -> Result<(), EnvError> {
        self.randomization.validate()?;
        if !self.control.decides() {
            Timing::periods(self.control_freq)?;
        }
        in_range("max_episode_steps", f64::from(self.max_episode_steps.unwrap_or(1)), 1.0.., "")?;
        self.success.validate()?;
        if self.trial.success != SuccessCriterion::default() && self.trial.success != self.success {
            return Err(EnvError::TwoCriteria);
        }
        if self.control.decides() {
            self.trial().validate()?;
        }
        self.clutter.validate()?;
        if let Some(goal) = &self.goal {
            goal.validate()?;
            if self.control.decides() || self.clutter.layout.is_some() {
                return Err(EnvError::NoGoals);
            }
        }
        for (i, observation) in self.observations.iter().enumerate() {
            if self.observations[..i].contains(observation) {
                return Err(EnvError::Twice { name: observation.name().to_owned() });
            }
        }
        Ok(())
    }
}
