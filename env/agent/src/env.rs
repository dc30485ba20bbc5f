//! One environment: its stream, its episode, its state as bytes.

use crate::AgentError;
use crate::action::Control;
use crate::agent_episode::{AgentEpisode, Info, Record};
use crate::arm_controller::ArmController;
use crate::config::Autoreset;
use crate::env_spec::EnvSpec;
use crate::initial_state::{ResetOptions, start};
use crate::observe::observe;
use crate::random_stream::{RandomStream, RandomStreamState};
use crate::reward::TERMS;
use graspbox_episode::EpisodeError;
use graspbox_episode::{Episode, Judge};
use graspbox_vision::{Mount, Pixels};
use serde::{Deserialize, Serialize};

/// Leads every saved state; the number changes with the layout.
const MAGIC: &[u8; 8] = b"gbagent7";
/// Length of the checksum that follows.
const CHECKSUM: usize = 32;

/// What one step or reset of one environment showed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// All observations, one after another.
    pub observations: Vec<f32>,
    /// The images, in the order of the config.
    pub images: Vec<Pixels>,
    /// Reward terms; zeros after a reset.
    pub terms: [f32; TERMS],
    /// The episode ended by success or loss.
    pub terminated: bool,
    /// The episode was cut off.
    pub truncated: bool,
    /// A new episode began instead of a step.
    pub reset: bool,
    /// What is said beside.
    pub info: Info,
}

impl Outcome {
    /// Fills observations and images.
    fn show(&mut self, play: &AgentEpisode, spec: &EnvSpec) -> Result<(), AgentError> {
        self.observations.clear();
        observe(play, spec, &mut self.observations);
        if spec.observer.specs().is_empty() {
            return Ok(());
        }
        Ok(spec.observer.see(&play.scene_pose()?, play.viewpoint(), &mut self.images)?)
    }
}

/// One environment.
#[derive(Default)]
pub struct Env {
    stream: Option<RandomStream>,
    play: Option<AgentEpisode>,
    done: bool,
    outcome: Outcome,
    last: Option<Outcome>,
}

#[derive(Serialize, Deserialize)]
struct Saved {
    control: Control,
    frame_skip: u32,
    /// Names of the cameras, and what carries them.
    cameras: Vec<(String, Mount)>,
    object: String,
    stream: RandomStreamState,
    world: Vec<u8>,
    judge: Judge,
    arm: ArmController,
    record: Record,
    done: bool,
    terms: [f32; TERMS],
    terminated: bool,
    truncated: bool,
}

impl Env {
    /// Begins a new episode; a seed begins the stream anew.
    ///
    /// * `env`: index of the environment, for errors.
    ///
    /// # Errors
    /// A first reset without a seed, an option that cannot be, or an object that cannot be prepared.
    pub fn reset(
        &mut self,
        spec: &EnvSpec,
        env: usize,
        seed: Option<u64>,
        options: &ResetOptions,
    ) -> Result<(), AgentError> {
        let mut stream = match (seed, &self.stream) {
            (Some(seed), _) => RandomStream::new(seed),
            (None, Some(stream)) => stream.clone(),
            (None, None) => return Err(AgentError::NotSeeded { env }),
        };
        let (play, outcome) = match begin(spec, &mut stream, options) {
            Ok(begun) => begun,
            Err(error) => {
                // Everything stays as it was, but for one thing: the next start draws another object, lest one that cannot be used
                // stop the environment for good.
                if seed.is_none() && options.object.is_none() && error.is_of_an_object() {
                    self.stream = Some(stream);
                }
                return Err(error);
            }
        };
        self.stream = Some(stream);
        self.outcome = outcome;
        self.play = Some(play);
        self.done = false;
        self.last = None;
        Ok(())
    }

    /// True where the next step will not look at its action: after the end of an episode, unless the next one has begun already.
    pub fn resets_next(&self, spec: &EnvSpec) -> bool {
        self.done && spec.config.autoreset != Autoreset::Disabled
    }

    /// Whether there is anything to show.
    ///
    /// # Errors
    /// No episode yet.
    pub fn ready_to_show(&self, env: usize) -> Result<(), AgentError> {
        self.play.as_ref().map(|_| ()).ok_or(AgentError::NotReset { env })
    }

    /// Whether a step can be taken.
    ///
    /// # Errors
    /// No episode yet, or one that is over and is not reset by itself.
    pub fn ready(&self, spec: &EnvSpec, env: usize) -> Result<(), AgentError> {
        if self.play.is_none() {
            return Err(AgentError::NotReset { env });
        }
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
        let anew = ResetOptions::default();
        if self.resets_next(spec) {
            return self.reset(spec, env, None, &anew);
        }
        let Some(play) = &mut self.play else {
            return Err(AgentError::NotReset { env });
        };
        self.last = None;
        let skip = spec.config.frame_skip;
        let (mut terms, mut terminated) = ([0.0; TERMS], false);
        play.begin_action();
        for _ in 0..skip {
            let (more, over) = play.step(action, spec)?;
            terms.iter_mut().zip(more).for_each(|(sum, term)| *sum += term);
            terminated = over;
            if over {
                break;
            }
        }
        let truncated = spec.config.max_episode_steps.is_some_and(|most| play.steps().div_ceil(skip) >= most);
        self.outcome = Outcome {
            observations: std::mem::take(&mut self.outcome.observations),
            images: std::mem::take(&mut self.outcome.images),
            terms,
            terminated,
            truncated,
            reset: false,
            info: play.info(),
        };
        self.outcome.show(play, spec)?;
        self.done = terminated || truncated;
        if self.done && spec.config.autoreset == Autoreset::SameStep {
            let last = self.outcome.clone();
            self.reset(spec, env, None, &anew)?;
            self.outcome.terms = last.terms;
            self.outcome.terminated = last.terminated;
            self.outcome.truncated = last.truncated;
            self.last = Some(last);
        }
        Ok(())
    }

    /// What the last step or reset showed.
    pub fn outcome(&self) -> &Outcome {
        &self.outcome
    }

    /// What the episode that just ended showed last, where a new one began in the same step.
    pub fn last(&self) -> Option<&Outcome> {
        self.last.as_ref()
    }

    /// The episode.
    pub fn play(&self) -> Option<&AgentEpisode> {
        self.play.as_ref()
    }

    /// Everything that the future of this environment depends on, as bytes.
    ///
    /// # Errors
    /// No episode yet, or a world that cannot be written.
    pub fn save(&self, spec: &EnvSpec, env: usize) -> Result<Vec<u8>, AgentError> {
        let (Some(play), Some(stream)) = (&self.play, &self.stream) else {
            return Err(AgentError::NotReset { env });
        };
        let name = play.prepared().body().name();
        let world = play
            .episode()
            .world()
            .snapshot()
            .map_err(|source| EpisodeError::Sim { object: name.to_owned(), source })?;
        let saved = Saved {
            control: spec.config.control,
            frame_skip: spec.config.frame_skip,
            cameras: cameras(spec),
            object: name.to_owned(),
            stream: stream.state(),
            world,
            judge: play.judge().clone(),
            arm: play.arm().clone(),
            record: play.record().clone(),
            done: self.done,
            terms: self.outcome.terms,
            terminated: self.outcome.terminated,
            truncated: self.outcome.truncated,
        };
        let body = postcard::to_allocvec(&saved).map_err(|error| AgentError::BadState { why: error.to_string() })?;
        let mut bytes = MAGIC.to_vec();
        bytes.extend_from_slice(blake3::hash(&body).as_bytes());
        bytes.extend_from_slice(&body);
        Ok(bytes)
    }

    /// Takes up a state that [`Env::save`] gave; from there the same actions lead to the same bits.
    ///
    /// # Errors
    /// Bytes of another version, damaged ones, or ones of other objects, another hand, other physics, cameras or another control mode.
    pub fn restore(&mut self, spec: &EnvSpec, bytes: &[u8]) -> Result<(), AgentError> {
        let bad = |why: &str| AgentError::BadState { why: why.to_owned() };
        let rest = bytes.strip_prefix(MAGIC).ok_or_else(|| bad("it is not a state of this version"))?;
        let (sum, body) = rest.split_at_checked(CHECKSUM).ok_or_else(|| bad("it is too short"))?;
        if blake3::hash(body).as_bytes() != sum {
            return Err(bad("its checksum does not match; it was cut off or changed"));
        }
        let saved: Saved = postcard::from_bytes(body).map_err(|_| bad("its content cannot be read"))?;
        let (index, record) = (saved.record.object, saved.record);
        if spec.objects.names().nth(index) != Some(&saved.object) {
            return Err(bad(&format!("object {index} of this set is not `{}`", saved.object)));
        }
        if saved.control != spec.config.control || saved.frame_skip != spec.config.frame_skip {
            return Err(bad(&format!(
                "it is of control mode `{}` with a frame_skip of {}",
                saved.control.name(),
                saved.frame_skip
            )));
        }
        if *saved.judge.criterion() != spec.config.success {
            return Err(bad("it is judged by another criterion of success"));
        }
        if record.last_action.len() != spec.action {
            return Err(bad("it is of another hand"));
        }
        if saved.cameras != cameras(spec) {
            let names: Vec<_> = saved.cameras.iter().map(|(name, _)| name.as_str()).collect();
            return Err(bad(&format!(
                "its cameras are other ones, or carried by something else: {}",
                names.join(", ")
            )));
        }
        if record.viewpoint.parent_from_camera.len() != saved.cameras.len() {
            return Err(bad("a camera of it has no pose"));
        }
        let prepared = spec.objects.prepared(index)?;
        let (resting, scene) = spec.objects.scene(&prepared, record.resting)?;
        if resting != record.resting {
            return Err(bad("the object no longer rests in that pose"));
        }
        let episode = Episode::resume(&scene, &saved.world, saved.judge)?;
        let play = AgentEpisode::resume(episode, prepared, saved.arm, record);
        let mut outcome = Outcome {
            terms: saved.terms,
            terminated: saved.terminated,
            truncated: saved.truncated,
            info: play.info(),
            ..Outcome::default()
        };
        outcome.show(&play, spec)?;
        self.outcome = outcome;
        self.stream = Some(RandomStream::resume(&saved.stream));
        self.play = Some(play);
        self.done = saved.done;
        self.last = None;
        Ok(())
    }
}

fn cameras(spec: &EnvSpec) -> Vec<(String, Mount)> {
    let all = spec.observer.config().cameras.iter();
    all.map(|camera| (camera.name.clone(), camera.mount)).collect()
}

/// Begins an episode, and shows it.
fn begin(
    spec: &EnvSpec,
    stream: &mut RandomStream,
    options: &ResetOptions,
) -> Result<(AgentEpisode, Outcome), AgentError> {
    let play = AgentEpisode::new(&start(spec, stream, options)?, spec)?;
    let mut outcome = Outcome { reset: true, info: play.info(), ..Outcome::default() };
    outcome.show(&play, spec)?;
    Ok((play, outcome))
}
