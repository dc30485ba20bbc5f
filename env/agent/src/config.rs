//! How the environments are steered, ended and varied.

use crate::AgentError;
use crate::action::Control;
use crate::observation_spec::Observation;
use graspbox_episode::{SuccessCriterion, TrialConfig};
use graspbox_vision::CamerasConfig;
use serde::{Deserialize, Serialize};

/// Seconds between two actions: 20 Hz.
pub const CONTROL_PERIOD: f64 = 0.05;

/// When an environment whose episode is over begins the next one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Autoreset {
    /// At the next step, which then ignores the action.
    #[default]
    NextStep,
    /// At once; what the ended episode showed last comes back separately.
    SameStep,
    /// Only when it is reset.
    Disabled,
}

/// What varies from episode to episode beside object and start; every range at its neutral value is off.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Randomization {
    /// Least and greatest factor on the object's friction.
    pub friction: [f64; 2],
    /// Least and greatest factor on the object's mass.
    pub mass: [f64; 2],
    /// The object's place varies by so much more in x and y, metres.
    pub object_position: f64,
    /// Greatest constant error of the hand's position in an episode along each axis, metres.
    pub hand_position: f64,
    /// Greatest constant error of the hand's rotation in an episode about each axis, radians.
    pub hand_rotation: f64,
    /// Greatest shift of a camera along each of its axes, metres.
    pub camera_position: f64,
    /// Greatest turn of a camera about each of its axes, radians.
    pub camera_rotation: f64,
    /// Variation of the light, in [0, 1]: at 1 the lamp turns by up to 0.7 rad and grows or fades by half.
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
    /// 1 cm and 1.1 degrees, another light.
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

/// Everything that steers a pool of environments.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AgentConfig {
    /// What an action means.
    pub control: Control,
    /// When a finished environment begins again.
    pub autoreset: Autoreset,
    /// Control periods that a step lasts: its action holds for all of them.
    pub frame_skip: u32,
    /// An episode is cut off after so many steps; none: never.
    pub max_episode_steps: Option<u32>,
    /// What is observed, in this order.
    pub observations: Vec<Observation>,
    /// What varies.
    pub randomization: Randomization,
    /// What is seen.
    pub cameras: CamerasConfig,
    /// What counts as success, in every control mode.
    pub success: SuccessCriterion,
    /// The trial that follows a decision; closed-loop control has none. Its own `success` is left as it is: see [`AgentConfig::success`].
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
            cameras: CamerasConfig::default(),
            success: SuccessCriterion::default(),
            trial: TrialConfig::default(),
        }
    }
}

impl AgentConfig {
    /// The trial that follows a decision, judged by [`AgentConfig::success`].
    pub fn trial(&self) -> TrialConfig {
        TrialConfig { success: self.success, ..self.trial }
    }

    /// Checks every setting.
    ///
    /// # Errors
    /// [`AgentError::BadConfig`], naming the first setting that is out of range; [`AgentError::Twice`] for an observation.
    pub fn validate(&self) -> Result<(), AgentError> {
        let r = &self.randomization;
        let rows = [
            ("randomization.friction[0]", r.friction[0], 0.1, 10.0, "between 0.1 and 10"),
            ("randomization.friction[1]", r.friction[1], r.friction[0], 10.0, "between the first factor and 10"),
            ("randomization.mass[0]", r.mass[0], 0.1, 10.0, "between 0.1 and 10"),
            ("randomization.mass[1]", r.mass[1], r.mass[0], 10.0, "between the first factor and 10"),
            ("randomization.object_position", r.object_position, 0.0, 0.15, "between 0 and 0.15 m"),
            ("randomization.hand_position", r.hand_position, 0.0, 0.05, "between 0 and 0.05 m"),
            ("randomization.hand_rotation", r.hand_rotation, 0.0, 0.5, "between 0 and 0.5 rad"),
            ("randomization.camera_position", r.camera_position, 0.0, 1.0, "between 0 and 1 m"),
            ("randomization.camera_rotation", r.camera_rotation, 0.0, 0.5, "between 0 and 0.5 rad"),
            ("randomization.light", r.light, 0.0, 1.0, "between 0 and 1"),
            (
                "frame_skip",
                f64::from(self.frame_skip),
                1.0,
                if self.control.decides() { 1.0 } else { 100.0 },
                "between 1 and 100; 1 where an episode is one decision",
            ),
            (
                "max_episode_steps",
                f64::from(self.max_episode_steps.unwrap_or(1)),
                1.0,
                f64::from(u32::MAX),
                "at least 1",
            ),
        ];
        for (field, value, low, high, expected) in rows {
            if !(low..=high).contains(&value) {
                return Err(AgentError::BadConfig { field, value, expected });
            }
        }
        self.success.validate()?;
        if self.trial.success != SuccessCriterion::default() && self.trial.success != self.success {
            return Err(AgentError::TwoCriteria);
        }
        if self.control.decides() {
            self.trial().validate()?;
        }
        for (i, observation) in self.observations.iter().enumerate() {
            if self.observations[..i].contains(observation) {
                return Err(AgentError::Twice { name: observation.name().to_owned() });
            }
        }
        Ok(())
    }
}

/// Physics steps in a control period of [`CONTROL_PERIOD`].
///
/// # Errors
/// [`AgentError::BadConfig`] for a time step that does not divide it.
pub fn steps_per_control(dt: f64) -> Result<u32, AgentError> {
    let steps = (CONTROL_PERIOD / dt).round();
    if steps < 1.0 || (steps * dt - CONTROL_PERIOD).abs() > 1e-9 {
        return Err(AgentError::BadConfig {
            field: "physics.dt",
            value: dt,
            expected: "a whole fraction of the control period of 0.05 s",
        });
    }
    Ok(steps as u32)
}
