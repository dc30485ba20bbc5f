//! The result of a step or a reset of one environment.

use crate::EnvError;
use crate::observations::info::{Info, read_info};
use crate::pool::env_episode::EnvEpisode;
use crate::pool::env_spec::EnvSpec;
use crate::rewards::reward::TermValues;
use graspbox_render::Pixels;

/// The result of a step or a reset of one environment; [`Batch`](crate::Batch) collects many of them in arrays.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StepResult {
    /// All observations, one after another.
    pub observations: Vec<f32>,
    /// The images, in the order of the config.
    pub images: Vec<Pixels>,
    /// Reward terms; zeros after a reset.
    pub terms: TermValues,
    /// The episode ended by success or loss.
    pub terminated: bool,
    /// The episode was cut off.
    pub truncated: bool,
    /// A new episode began instead of a step.
    pub reset: bool,
    /// The info, in the order of [`INFO`](crate::observations::info::INFO).
    pub info: Info,
}

impl StepResult {
    /// Fills observations, images and info from the present state of an episode; keeps the rest.
    ///
    /// # Errors
    /// [`EnvError`] for a mesh that cannot be rendered, or an observation whose reader does not fit its row.
    pub fn observe(&mut self, episode: &EnvEpisode, spec: &EnvSpec) -> Result<(), EnvError> {
        let view = episode.view(spec);
        self.info = read_info(&view);
        self.observations.clear();
        for observation in &spec.observations {
            observation.read(&view, &mut self.observations)?;
        }
        if spec.observer.specs().is_empty() {
            return Ok(());
        }
        Ok(spec.observer.render(&episode.scene_pose(spec)?, episode.viewpoint(), &mut self.images)?)
    }
}
