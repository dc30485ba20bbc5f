//! The one step of an episode of one decision.

use crate::EnvError;
use crate::pool::env_spec::EnvSpec;
use crate::pool::episode_body::EpisodeBody;
use crate::rewards::reward::Attempt;
use crate::state::GraspPoseState;

impl GraspPoseState {
    /// Moves the hand to the pose of `action` and tries the grasp.
    ///
    /// # Errors
    /// An error of the simulation.
    pub(crate) fn step(&mut self, body: &mut EpisodeBody, action: &[f32], spec: &EnvSpec) -> Result<Attempt, EnvError> {
        let Some(outcome) = body.decide(action, spec, &mut self.result)? else {
            return Ok(Attempt { infeasible: true, ..Attempt::default() });
        };
        body.go_on(outcome.episode);
        Ok(outcome.attempt)
    }
}
