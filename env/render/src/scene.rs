//! Instances of models, and the light.

use crate::Model;
use crate::camera::check_pose;
use crate::error::RenderError;
use graspbox_mesh::in_range;
use nalgebra::{Isometry3, Vector3};
use serde::{Deserialize, Serialize};

/// A model in the world.
#[derive(Clone, Copy, Debug)]
pub struct Instance<'a> {
    /// Its geometry.
    pub model: &'a Model,
    /// Its pose.
    pub world_from_model: Isometry3<f64>,
    /// Red, green, blue in full light, in [0, 1].
    pub color: [f32; 3],
    /// Its value in the segmentation; 0 means background.
    pub label: u8,
    /// Whether it casts a shadow. Everything receives shadows; the table need not cast one.
    pub casts_shadow: bool,
}

/// Largest number of instances in a scene.
pub(crate) const MOST_INSTANCES: usize = 1 << 16;

pub(crate) fn check_instances(instances: &[Instance]) -> Result<(), RenderError> {
    let (count, limit) = (instances.len(), MOST_INSTANCES);
    if count > limit {
        return Err(RenderError::TooManyInstances { count, limit });
    }
    for (i, instance) in instances.iter().enumerate() {
        check_pose(&instance.world_from_model, || format!("instance {i}"))?;
        for part in instance.color {
            in_range("color", f64::from(part), 0.0..=1.0, "")?;
        }
    }
    Ok(())
}

/// One directional lamp, ambient light, and the background.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Light {
    /// Direction in which the light of the lamp travels, in the world; of any length.
    pub direction: Vector3<f64>,
    /// Strength of the lamp, in [0, 4].
    pub intensity: f32,
    /// Strength of the ambient light, in [0, 4].
    pub ambient: f32,
    /// Width of a shadow's soft border, metres, in [0.001, 1].
    pub softness: f64,
    /// Whether shadows are cast.
    pub shadows: bool,
    /// Background above the horizon, as [`Instance::color`].
    pub sky: [f32; 3],
    /// Background below the horizon, as [`Instance::color`].
    pub floor: [f32; 3],
}

impl Default for Light {
    fn default() -> Self {
        Self {
            direction: Vector3::new(-0.45, 0.55, -1.0),
            intensity: 0.72,
            ambient: 0.34,
            softness: 0.012,
            shadows: true,
            sky: [0.90, 0.93, 0.97],
            floor: [0.62, 0.64, 0.68],
        }
    }
}

impl Light {
    /// # Errors
    /// [`RenderError::OutOfRange`] names the first field outside its range.
    pub fn check(&self) -> Result<(), RenderError> {
        in_range("length of the light's direction", self.direction.norm(), 1e-6..=1e6, "")?;
        in_range("intensity", f64::from(self.intensity), 0.0..=4.0, "")?;
        in_range("ambient", f64::from(self.ambient), 0.0..=4.0, "")?;
        in_range("softness", self.softness, 1e-3..=1.0, "m")?;
        for (name, color) in [("sky", &self.sky), ("floor", &self.floor)] {
            color.iter().try_for_each(|part| in_range(name, f64::from(*part), 0.0..=1.0, ""))?;
        }
        Ok(())
    }
}

/// True if the renderer accepts the pose: finite, rigid, within 1 km.
pub(crate) fn is_near(pose: &Isometry3<f64>) -> bool {
    let translation = pose.translation.vector.iter().all(|x| x.abs() < 1e3);
    translation && (pose.rotation.coords.norm() - 1.0).abs() < 1e-6
}
