//! An object from many sides, without a hand.

use crate::VisionError;
use crate::visual_models::{ScenePose, VisualModels};
use graspbox_camera::{Camera, Channels, Detail, Frame, Job, Light, render_batch};

/// Renders the scene with each camera; frames in the order of the cameras.
///
/// # Errors
/// None for a scene whose poses are finite.
pub fn render_views(
    models: &VisualModels,
    scene_pose: &ScenePose,
    cameras: &[Camera],
    light: &Light,
    channels: Channels,
    detail: Detail,
) -> Result<Vec<Frame>, VisionError> {
    let instances = models.instances(scene_pose);
    let job = |camera: &Camera| Job { instances: &instances, camera: *camera, light: *light, channels };
    let jobs: Vec<_> = cameras.iter().map(job).collect();
    render_batch(&jobs, detail).map_err(|source| VisionError::Camera { name: "a view".into(), source })
}
