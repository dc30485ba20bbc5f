//! Configs cross as JSON of the core's serde structs; `graspbox.configs` mirrors them, and a test compares both.

use crate::convert::{config, json};
use crate::errors::CoreError;
use graspbox_agent::{AgentConfig, ClutterConfig, Randomization, ResetOptions};
use graspbox_episode::{ForceConfig, ShakeConfig, SuccessCriterion, TrialConfig};
use graspbox_mesh::{CleanOptions, LoadOptions};
use graspbox_perception::{CropConfig, DepthNoise, HandGridConfig, ProposalConfig};
use graspbox_plan::{DecomposeParams, PlanParams, PoseParams};
use graspbox_sim::{Friction, NewtonConfig, PhysicsConfig, RapierConfig};
use graspbox_vision::{CameraConfig, CamerasConfig, PictureConfig};
use pyo3::prelude::*;

/// Parses the JSON of the config `name`, and writes it again with all fields.
///
/// # Errors
/// `ConfigError` for an unknown name or field, or a value of the wrong type.
#[pyfunction]
#[pyo3(name = "_config")]
pub fn config_again(name: &str, text: &str) -> PyResult<String> {
    Ok(match name {
        "AgentConfig" => json(&config::<AgentConfig>(text, name)?),
        "ClutterConfig" => json(&config::<ClutterConfig>(text, name)?),
        "ResetOptions" => json(&config::<ResetOptions>(text, name)?),
        "CameraConfig" => json(&config::<CameraConfig>(text, name)?),
        "CamerasConfig" => json(&config::<CamerasConfig>(text, name)?),
        "PictureConfig" => json(&config::<PictureConfig>(text, name)?),
        "CleanConfig" => json(&config::<CleanOptions>(text, name)?),
        "CropConfig" => json(&config::<CropConfig>(text, name)?),
        "DepthNoise" => json(&config::<DepthNoise>(text, name)?),
        "HandGridConfig" => json(&config::<HandGridConfig>(text, name)?),
        "ProposalConfig" => json(&config::<ProposalConfig>(text, name)?),
        "DecomposeConfig" => json(&config::<DecomposeParams>(text, name)?),
        "LoadConfig" => json(&config::<LoadOptions>(text, name)?),
        "PlanConfig" => json(&config::<PlanParams>(text, name)?),
        "PoseConfig" => json(&config::<PoseParams>(text, name)?),
        "ForceConfig" => json(&config::<ForceConfig>(text, name)?),
        "FrictionConfig" => json(&config::<Friction>(text, name)?),
        "Randomization" => json(&config::<Randomization>(text, name)?),
        "RapierConfig" => json(&config::<RapierConfig>(text, name)?),
        "NewtonConfig" => json(&config::<NewtonConfig>(text, name)?),
        "PhysicsConfig" => json(&config::<PhysicsConfig>(text, name)?),
        "ShakeConfig" => json(&config::<ShakeConfig>(text, name)?),
        "SuccessCriterion" => json(&config::<SuccessCriterion>(text, name)?),
        "TrialConfig" => json(&config::<TrialConfig>(text, name)?),
        _ => Err(CoreError::Config(format!("there is no config {name:?}"))),
    }?)
}
