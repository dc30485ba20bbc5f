//! One environment: its random stream, its episode, what its last step returned.

use crate::AgentError;
use crate::agent_episode::AgentEpisode;
use crate::config::Autoreset;
use crate::env_spec::EnvSpec;
use crate::initial_samples::InitialSamples;
use crate::initial_state::InitialState;
use crate::objects::Need;
use crate::random_stream::RandomStream;
use crate::reset_options::ResetOptions;
use crate::reward::TERM_COUNT;
use crate::saved_state::SavedState;
use crate::step_result::StepResult;

/// Episodes whose objects are prepared in the background. Each environment asks in the order of its episodes, so that those of the next
/// ones come first; more than one, because environments whose episodes end together would need as many objects at once.
const EPISODES_AHEAD: usize = 3;

/// One environment.
#[derive(Default)]
pub struct Env {
    stream: Option<RandomStream>,
    episode: Option<AgentEpisode>,
    done: bool,
    result: StepResult,
    last: Option<StepResult>,
}

impl Env {
    /// Begins a new episode; a seed begins the stream anew.
    ///
    /// * `env`: index of the environment, for errors.
    ///
    /// # Errors
    /// A first reset without a seed, an option out of place, or an object that cannot be prepared.
    pub fn reset(
        &mut self,
        spec: &EnvSpec,
        env: usize,
        seed: Option<u64>,
        options: &ResetOptions,
    ) -> Result<(), AgentError> {
        let mut stream = self.stream_of(seed).ok_or(AgentError::NotSeeded { env })?;
        let (episode, result) = match begin(spec, &mut stream, options) {
            Ok(begun) => begun,
            Err(error) => {
                // Everything stays as it was, with one exception: the next reset samples another object, so that one that cannot be
                // used does not block the environment for good.
                if seed.is_none() && options.object.is_none() && error.is_of_an_object() {
                    self.stream = Some(stream);
                }
                return Err(error);
            }
        };
        // Where each episode gets a seed of its own, the stream does not tell which object comes next.
        if seed.is_none() || spec.config.autoreset != Autoreset::Disabled {
            let mut later = stream.clone();
            for _ in 0..EPISODES_AHEAD {
                spec.objects.ensure_ahead(InitialState::need(spec, &later, &ResetOptions::default())?);
                InitialSamples::new(&mut later, spec.objects.len());
            }
        }
        self.stream = Some(stream);
        self.result = result;
        self.episode = Some(episode);
        self.done = false;
        self.last = None;
        Ok(())
    }

    /// The stream with which a reset would begin; none without a seed before the first.
    fn stream_of(&self, seed: Option<u64>) -> Option<RandomStream> {
        seed.map(RandomStream::new).or_else(|| self.stream.clone())
    }

    /// What a reset would need of its object, where that can be told.
    pub fn need(&self, spec: &EnvSpec, seed: Option<u64>, options: &ResetOptions) -> Option<Need> {
        InitialState::need(spec, &self.stream_of(seed)?, options).ok()
    }

    /// True if the next step ignores its action: after the end of an episode, unless the next one has begun already.
    pub fn resets_next(&self, spec: &EnvSpec) -> bool {
        self.done && spec.config.autoreset != Autoreset::Disabled
    }

    /// Whether there is anything to observe.
    ///
    /// # Errors
    /// No episode yet.
    pub fn ready_to_observe(&self, env: usize) -> Result<(), AgentError> {
        self.episode.as_ref().map(|_| ()).ok_or(AgentError::NotReset { env })
    }

    /// Whether a step can be taken.
    ///
    /// # Errors
    /// No episode yet, or one that is over and is not reset by itself.
    pub fn ready(&self, spec: &EnvSpec, env: usize) -> Result<(), AgentError> {
        self.ready_to_observe(env)?;
        if self.done && spec.config.autoreset == Autoreset::Disabled {
            return Err(AgentError::Over { env });
        }
        Ok(())
    }

    /// One step of the environment, autoreset included; `action` was checked.
    ///
    /// # Errors
    /// As [`Env::ready`] and [`Env::reset`].
    pub fn step(&mut self, spec: &EnvSpec, env: usize, action: &[f32]) -> Result<(), AgentError> {
        self.ready(spec, env)?;
        if self.resets_next(spec) {
            return self.reset(spec, env, None, &ResetOptions::default());
        }
        let Some(episode) = &mut self.episode else {
            return Err(AgentError::NotReset { env });
        };
        self.last = None;
        let skip = spec.config.frame_skip;
        let (mut terms, mut terminated) = ([0.0; TERM_COUNT], false);
        episode.begin_action();
        for _ in 0..skip {
            let (more, over) = episode.step(action, spec)?;
            terms.iter_mut().zip(more).for_each(|(sum, term)| *sum += term);
            terminated = over;
            if over {
                break;
            }
        }
        self.result.terms = terms;
        self.result.terminated = terminated;
        self.result.truncated =
            spec.config.max_episode_steps.is_some_and(|most| episode.steps().div_ceil(skip) >= most);
        self.result.reset = false;
        self.result.observe(episode, spec)?;
        self.done = self.result.terminated || self.result.truncated;
        if self.done && spec.config.autoreset == Autoreset::SameStep {
            self.begin_next(spec, env)?;
        }
        Ok(())
    }

    /// Begins the next episode in the step that ended this one.
    fn begin_next(&mut self, spec: &EnvSpec, env: usize) -> Result<(), AgentError> {
        let last = self.result.clone();
        self.reset(spec, env, None, &ResetOptions::default())?;
        self.result.terms = last.terms;
        self.result.terminated = last.terminated;
        self.result.truncated = last.truncated;
        self.last = Some(last);
        Ok(())
    }

    /// What the last step or reset returned.
    pub fn result(&self) -> &StepResult {
        &self.result
    }

    /// What the last step of the previous episode returned, if a new one began in the same step.
    pub fn last(&self) -> Option<&StepResult> {
        self.last.as_ref()
    }

    /// The episode.
    pub fn episode(&self) -> Option<&AgentEpisode> {
        self.episode.as_ref()
    }

    /// Everything that the future of this environment depends on, as bytes.
    ///
    /// # Errors
    /// No episode yet, or a world that cannot be written.
    pub fn save(&self, spec: &EnvSpec, env: usize) -> Result<Vec<u8>, AgentError> {
        let (Some(episode), Some(stream)) = (&self.episode, &self.stream) else {
            return Err(AgentError::NotReset { env });
        };
        let mut state = SavedState::of(episode, stream.state(), spec)?;
        state.done = self.done;
        state.terms = self.result.terms;
        state.terminated = self.result.terminated;
        state.truncated = self.result.truncated;
        state.encode()
    }

    /// Takes up a state that [`Env::save`] gave; from there the same actions lead to the same bits.
    ///
    /// # Errors
    /// Bytes of another version, damaged ones, or ones of other objects, another hand, other physics, cameras or another control mode.
    pub fn restore(&mut self, spec: &EnvSpec, bytes: &[u8]) -> Result<(), AgentError> {
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
) -> Result<(AgentEpisode, StepResult), AgentError> {
    // An error is found again below, after the stream has moved on: the next reset samples another object.
    drop(InitialState::need(spec, stream, options).and_then(|need| spec.objects.ensure(&need)));
    let episode = AgentEpisode::new(&InitialState::sample(spec, stream, options)?, spec);
    let mut result = StepResult { reset: true, ..StepResult::default() };
    result.observe(&episode, spec)?;
    Ok((episode, result))
}
