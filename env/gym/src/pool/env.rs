//! One environment: its random stream, its episode, and the result of its last step.

use crate::EnvError;
use crate::config::Autoreset;
use crate::objects::Need;
use crate::pool::env_episode::EnvEpisode;
use crate::pool::env_spec::EnvSpec;
use crate::pool::saved_state::SavedState;
use crate::pool::step_result::StepResult;
use crate::rewards::reward::TERM_COUNT;
use crate::starts::initial_samples::InitialSamples;
use crate::starts::initial_state::InitialState;
use crate::starts::random_stream::RandomStream;
use crate::starts::reset_options::ResetOptions;
use crate::starts::scene_ahead::SceneAhead;
use std::sync::Arc;

/// Number of next episodes whose objects are prepared in the background, in their order. It is more than one, since environments whose episodes end
/// together need as many objects at once.
const EPISODES_AHEAD: usize = 3;

#[derive(Default)]
pub struct Env {
    stream: Option<RandomStream>,
    episode: Option<EnvEpisode>,
    done: bool,
    result: StepResult,
    last: Option<StepResult>,
    /// The scene of the next episode among several objects.
    next_scene: Option<Arc<SceneAhead>>,
}

impl Env {
    /// Begins a new episode; a seed restarts the stream.
    ///
    /// * `env`: index of the environment, for errors.
    ///
    /// # Errors
    /// [`EnvError`] for a first reset without a seed, an invalid option, or an object that cannot be prepared.
    pub fn reset(
        &mut self,
        spec: &EnvSpec,
        env: usize,
        seed: Option<u64>,
        options: &ResetOptions,
    ) -> Result<(), EnvError> {
        let mut stream = self.stream_of(seed).ok_or(EnvError::NotSeeded { env })?;
        let (episode, result) = match begin(spec, &mut stream, options, self.next_scene.as_deref()) {
            Ok(begun) => begun,
            Err(error) => {
                // Everything stays as it was, with one exception: the next reset samples another object, so that one that cannot be
                // used does not block the environment for good.
                if seed.is_none() && options.object.is_none() && error.object().is_some() {
                    self.stream = Some(stream);
                }
                return Err(error);
            }
        };
        self.next_scene = None;
        // If each episode has its own seed, the stream does not determine the next object.
        if seed.is_none() || spec.config.autoreset != Autoreset::Disabled {
            let mut later = stream.clone();
            for _ in 0..EPISODES_AHEAD {
                let needs = InitialState::needs(spec, &later, &ResetOptions::default())?;
                needs.into_iter().for_each(|need| spec.objects.ensure_ahead(need));
                InitialSamples::new(&mut later, spec.objects.len());
            }
            self.next_scene = InitialState::scene(spec, &stream)
                .map(|(layout, samples)| SceneAhead::queue(&spec.objects, layout, samples));
        }
        self.stream = Some(stream);
        self.result = result;
        self.episode = Some(episode);
        self.done = false;
        self.last = None;
        Ok(())
    }

    /// The stream with which a reset would begin; `None` for a first reset without a seed.
    fn stream_of(&self, seed: Option<u64>) -> Option<RandomStream> {
        seed.map(RandomStream::new).or_else(|| self.stream.clone())
    }

    /// The preparations that a reset would need, as far as they are known.
    pub fn needs(&self, spec: &EnvSpec, seed: Option<u64>, options: &ResetOptions) -> Vec<Need> {
        let stream = self.stream_of(seed);
        stream.and_then(|stream| InitialState::needs(spec, &stream, options).ok()).unwrap_or_default()
    }

    /// True if the next step ignores its action and resets: after the end of an episode, unless the next one has already begun.
    pub fn resets_next(&self, spec: &EnvSpec) -> bool {
        self.done && spec.config.autoreset != Autoreset::Disabled
    }

    /// Checks that there is an episode to observe.
    ///
    /// # Errors
    /// [`EnvError::NotReset`] without an episode.
    pub fn ready_to_observe(&self, env: usize) -> Result<(), EnvError> {
        self.episode.as_ref().map(|_| ()).ok_or(EnvError::NotReset { env })
    }

    /// Checks that a step is possible.
    ///
    /// # Errors
    /// [`EnvError::NotReset`] without an episode, [`EnvError::Over`] after the end of one without autoreset.
    pub fn ready(&self, spec: &EnvSpec, env: usize) -> Result<(), EnvError> {
        self.ready_to_observe(env)?;
        if self.done && spec.config.autoreset == Autoreset::Disabled {
            return Err(EnvError::Over { env });
        }
        Ok(())
    }

    /// Advances the environment by one step, including autoreset; the caller has checked `action`.
    ///
    /// # Errors
    /// As [`Env::ready`] and [`Env::reset`].
    pub fn step(&mut self, spec: &EnvSpec, env: usize, action: &[f32]) -> Result<(), EnvError> {
        self.ready(spec, env)?;
        if self.resets_next(spec) {
            return self.reset(spec, env, None, &ResetOptions::default());
        }
        let Some(episode) = &mut self.episode else {
            return Err(EnvError::NotReset { env });
        };
        self.last = None;
        let periods = spec.timing.periods;
        let (mut terms, mut terminated) = ([0.0; TERM_COUNT], false);
        episode.begin_action();
        for _ in 0..periods {
            let (more, over) = episode.step(action, spec)?;
            terms.iter_mut().zip(more).for_each(|(sum, term)| *sum += term);
            terminated = over;
            if over {
                break;
            }
        }
        self.result.terms = episode.goal_terms(spec).unwrap_or(terms);
        self.result.terminated = terminated;
        self.result.truncated =
            spec.config.max_episode_steps.is_some_and(|most| episode.steps().div_ceil(periods) >= most);
        self.result.reset = false;
        self.result.observe(episode, spec)?;
        self.done = self.result.terminated || self.result.truncated;
        if self.done && spec.config.autoreset == Autoreset::SameStep {
            self.begin_next(spec, env)?;
        }
        Ok(())
    }

    /// Begins the next episode in the step that ended this one.
    fn begin_next(&mut self, spec: &EnvSpec, env: usize) -> Result<(), EnvError> {
        let last = self.result.clone();
        self.reset(spec, env, None, &ResetOptions::default())?;
        self.result.terms = last.terms;
        self.result.terminated = last.terminated;
        self.result.truncated = last.truncated;
        self.last = Some(last);
        Ok(())
    }

    /// The result of the last step or reset.
    pub fn result(&self) -> &StepResult {
        &self.result
    }

    /// The last result of the previous episode, if a new one began in the same step.
    pub fn last(&self) -> Option<&StepResult> {
        self.last.as_ref()
    }

    /// The scene of the next episode, where one is made in the background.
    #[cfg(test)]
    pub(crate) fn next_scene(&self) -> Option<&Arc<SceneAhead>> {
        self.next_scene.as_ref()
    }

    pub fn episode(&self) -> Option<&EnvEpisode> {
        self.episode.as_ref()
    }

    /// The complete state of this environment as bytes.
    ///
    /// # Errors
    /// [`EnvError::NotReset`] without an episode, or an error for a world that cannot be written.
    pub fn save(&self, spec: &EnvSpec, env: usize) -> Result<Vec<u8>, EnvError> {
        let (Some(episode), Some(stream)) = (&self.episode, &self.stream) else {
            return Err(EnvError::NotReset { env });
        };
        let mut state = SavedState::of(episode, stream.state(), spec)?;
        state.done = self.done;
        state.terms = self.result.terms;
        state.terminated = self.result.terminated;
        state.truncated = self.result.truncated;
        state.encode()
    }

    /// Restores a state from [`Env::save`]; the same actions then give the same bits.
    ///
    /// # Errors
    /// [`EnvError::BadState`] for damaged bytes, or those of another version, object set, hand, physics, cameras or control mode.
    pub fn restore(&mut self, spec: &EnvSpec, bytes: &[u8]) -> Result<(), EnvError> {
        let state = SavedState::decode(bytes)?;
        let episode = state.episode(spec)?;
        let mut result = StepResult {
            terms: state.terms,
            terminated: state.terminated,
            truncated: state.truncated,
            ..StepResult::default()
        };
        result.observe(&episode, spec)?;
        self.result = result;
        self.stream = Some(RandomStream::resume(&state.stream));
        self.episode = Some(episode);
        self.done = state.done;
        self.last = None;
        Ok(())
    }
}

/// Begins an episode, and observes it.
fn begin(
    spec: &EnvSpec,
    stream: &mut RandomStream,
    options: &ResetOptions,
    ahead: Option<&SceneAhead>,
) -> Result<(EnvEpisode, StepResult), EnvError> {
    // An error occurs again below, after the stream has advanced: the next reset then samples another object.
    let needs = InitialState::needs(spec, stream, options);
    drop(needs.and_then(|needs| needs.iter().try_for_each(|need| spec.objects.ensure(need))));
    let episode = EnvEpisode::new(&InitialState::sample(spec, stream, options, ahead)?, spec);
    let mut result = StepResult { reset: true, ..StepResult::default() };
    result.observe(&episode, spec)?;
    Ok((episode, result))
}
