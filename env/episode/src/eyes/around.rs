//! An object from many sides, without a hand.

use crate::EpisodeError;
use crate::eyes::stage::{Moment, Stage};
use graspbox_camera::{Camera, Channels, Detail, Frame, Job, Light, render_batch};

/// What each camera sees of the moment; frames in the order of the cameras.
///
/// # Errors
/// None for a moment whose poses are finite.
pub fn look_around(
    stage: &Stage,
    moment: &Moment,
    cameras: &[Camera],
    light: &Light,
    channels: Channels,
) -> Result<Vec<Frame>, EpisodeError> {
    let instances = stage.instances(moment);
    let job = |camera: &Camera| Job { instances: &instances, camera: *camera, light: *light, channels };
    let jobs: Vec<_> = cameras.iter().map(job).collect();
    render_batch(&jobs, Detail::Auto).map_err(|source| EpisodeError::Camera { name: "a view".into(), source })
}
