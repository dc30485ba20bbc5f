//! Options of a reset, and the checks that several of them share.

use crate::EnvError;
use graspbox_hand::rigid_motion;
use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged, expecting = "give the index or the name of an object")]
pub enum ObjectChoice {
    Index(usize),
    Name(String),
}

/// Values of an initial state that are set; the others are sampled. Matrices are homogeneous, as lists of rows.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ResetOptions {
    pub object: Option<ObjectChoice>,
    /// Its resting pose: an index, the most probable first.
    pub resting: Option<usize>,
    /// Its place: x, y (m) and rotation about the vertical (rad) of the resting pose.
    pub place: Option<[f64; 3]>,
    /// Its pose, from which it is dropped.
    pub world_from_object: Option<[[f64; 4]; 4]>,
    /// The hand's pose.
    pub world_from_hand: Option<[[f64; 4]; 4]>,
    /// The preshape, as one number.
    pub preshape: Option<f64>,
    /// Factor on the object's friction.
    pub friction: Option<f64>,
    /// Factor on the object's mass.
    pub mass: Option<f64>,
    /// Poses of cameras by name, in the frames of their mounts.
    pub cameras: BTreeMap<String, [[f64; 4]; 4]>,
    /// The goal: x, y, z, world, metres.
    pub goal: Option<[f64; 3]>,
}

/// Least and greatest factor on mass and friction.
const FACTORS: [f64; 2] = [0.01, 100.0];

pub(crate) fn bad_option(option: &'static str, why: impl Into<String>) -> EnvError {
    EnvError::BadOption { option, why: why.into() }
}

pub(crate) fn finite(value: f64, option: &'static str) -> Result<f64, EnvError> {
    if value.is_finite() { Ok(value) } else { Err(bad_option(option, "give finite numbers")) }
}

/// A factor that is set, or else the sampled one.
pub(crate) fn factor(given: Option<f64>, sampled: f64, option: &'static str) -> Result<f64, EnvError> {
    let factor = given.unwrap_or(sampled);
    let [low, high] = FACTORS;
    if (low..=high).contains(&factor) {
        Ok(factor)
    } else {
        Err(bad_option(option, format!("{factor} is out of range; give a factor between {low} and {high}")))
    }
}

/// The rigid motion of a homogeneous matrix.
pub(crate) fn rigid(rows: &[[f64; 4]; 4], option: &'static str) -> Result<Isometry3<f64>, EnvError> {
    let flat: [f64; 16] = std::array::from_fn(|i| rows[i / 4][i % 4]);
    rigid_motion(&flat).ok_or_else(|| {
        bad_option(option, "give a homogeneous matrix: a rotation, a translation column, the last row 0 0 0 1")
    })
}
