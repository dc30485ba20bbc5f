//! Configs: the core's defaults and fields are those of `tests/fixtures/configs.json`, which Python compares with its own; errors name the field.

#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_arm::{PathParams, ReachParams};
use graspbox_episode::{ForceConfig, ShakeConfig, SuccessCriterion, TrialConfig};
use graspbox_gym::json::config;
use graspbox_gym::{ClutterConfig, EnvConfig, Randomization, ResetOptions};
use graspbox_mesh::{CleanOptions, LoadOptions};
use graspbox_perception::{CropConfig, DepthNoise, HandGridConfig, ProposalConfig};
use graspbox_plan::{DecomposeParams, PlanParams, PoseParams};
use graspbox_render::{CameraConfig, CamerasConfig, PictureConfig};
use graspbox_sim::{Friction, ImplicitConfig, PhysicsConfig, RapierConfig};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// A function that checks a config against its default and another value of every field.
type Check = fn(&str, &Value, &Value);

const CHECKS: &[(&str, Check)] = &[
    ("EnvConfig", check::<EnvConfig>),
    ("ClutterConfig", check::<ClutterConfig>),
    ("CameraConfig", check::<CameraConfig>),
    ("CamerasConfig", check::<CamerasConfig>),
    ("PictureConfig", check::<PictureConfig>),
    ("CleanConfig", check::<CleanOptions>),
    ("CropConfig", check::<CropConfig>),
    ("DepthNoise", check::<DepthNoise>),
    ("HandGridConfig", check::<HandGridConfig>),
    ("ProposalConfig", check::<ProposalConfig>),
    ("DecomposeConfig", check::<DecomposeParams>),
    ("LoadConfig", check::<LoadOptions>),
    ("PathConfig", check::<PathParams>),
    ("PlanConfig", check::<PlanParams>),
    ("PoseConfig", check::<PoseParams>),
    ("ForceConfig", check::<ForceConfig>),
    ("FrictionConfig", check::<Friction>),
    ("Randomization", check::<Randomization>),
    ("RapierConfig", check::<RapierConfig>),
    ("ReachConfig", check::<ReachParams>),
    ("ImplicitConfig", check::<ImplicitConfig>),
    ("PhysicsConfig", check::<PhysicsConfig>),
    ("ShakeConfig", check::<ShakeConfig>),
    ("SuccessCriterion", check::<SuccessCriterion>),
    ("TrialConfig", check::<TrialConfig>),
];

/// A config of the fixture.
#[derive(serde::Deserialize)]
struct Expected {
    default: Value,
    /// Another value of every field.
    other: Value,
}

/// The value with every number as f64, since Python writes 1 where the core writes 1.0.
fn floats(value: &Value) -> Value {
    match value {
        Value::Number(number) => json!(number.as_f64()),
        Value::Array(values) => values.iter().map(floats).collect(),
        Value::Object(fields) => fields.iter().map(|(name, value)| (name.clone(), floats(value))).collect(),
        other => other.clone(),
    }
}

fn check<T: Serialize + DeserializeOwned>(name: &str, default: &Value, other: &Value) {
    let crossed = |text: &str| config::<T>(text, name).map(|config| serde_json::to_value(config).unwrap());
    assert_eq!(floats(&crossed("{}").unwrap()), floats(default), "{name}: defaults");
    assert_eq!(floats(&crossed(&other.to_string()).unwrap()), floats(other), "{name}: another value of every field");
    let refused = |sent: Value| crossed(&sent.to_string()).unwrap_err().to_string();
    let unknown = refused(json!({ "zzz": 1 }));
    assert!(unknown.contains(&format!("{name} has no field 'zzz'; its fields are ")), "{unknown}");
    for (field, _) in default.as_object().unwrap() {
        // No field takes such an object, or such a list.
        for bad in [json!({ "x": 1 }), json!([[[1.5, "x"]]])] {
            let why = refused(json!({ field: bad }));
            assert!(why.starts_with(&format!("{name}.{field}")), "{why}");
            assert!(why.contains("; give ") || why.contains("has no field 'x'; its fields are"), "{why}");
            assert!(!why.contains("line 1"), "{why}");
        }
    }
}

#[test]
fn configs_cross_and_errors_name_the_field() {
    let text = std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/configs.json")).unwrap();
    let expected: BTreeMap<String, Expected> = serde_json::from_str(&text).unwrap();
    let names: Vec<_> = CHECKS.iter().map(|(name, _)| *name).collect();
    assert!(expected.keys().all(|name| names.contains(&name.as_str())), "a config of Python is not checked");
    assert_eq!(names.len(), expected.len());
    for (name, check) in CHECKS {
        check(name, &expected[*name].default, &expected[*name].other);
    }
}

#[test]
fn messages_help() {
    let plan = |text: &str| config::<PlanParams>(text, "PlanConfig").map(|_| ()).unwrap_err().to_string();
    assert_eq!(plan(r#"{"decompos": {}}"#), "PlanConfig has no field 'decompos'; did you mean 'decompose'?");
    assert_eq!(plan(r#"{"poses": {"ofset": 1}}"#), "PlanConfig.poses has no field 'ofset'; did you mean 'offset'?");
    assert!(plan("{").starts_with("PlanConfig is not JSON"));
    let reset = config::<ResetOptions>(r#"{"object": 1.5}"#, "ResetOptions").map(|_| ()).unwrap_err().to_string();
    assert!(reset.starts_with("ResetOptions.object is 1.5 (float); give the index or the name"), "{reset}");
}
