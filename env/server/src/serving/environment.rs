//! The environments of a session, and the execution of commands on them. Nothing here waits for a client.

use crate::segment::Segment;
use crate::wire::answer::{self, Layout};
use crate::wire::command::{Command, Seeds, SessionOptions};
use crate::wire::fault::{Classify, Fault};
use graspbox_gym::pool::env_pool::StepBatches;
use graspbox_gym::{Batch, EnvError, EnvPool};
use graspbox_render::PictureConfig;
use rayon::prelude::*;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Environments as Python made them.
pub struct MadeEnvironments {
    pub pool: Arc<EnvPool>,
    /// Weights of the reward terms.
    pub weights: Vec<f64>,
    /// Pictures of `render`; none if the environments were made without them.
    pub picture: Option<PictureConfig>,
    /// Description for the client: spec, spaces, tables.
    pub description: serde_json::Value,
}

/// The environments of a session.
pub struct Environment {
    pub pool: Arc<EnvPool>,
    weights: Vec<f64>,
    picture: Option<PictureConfig>,
    asked: SessionOptions,
    segment: Option<Arc<Segment>>,
    /// Most bytes of an answer.
    most: usize,
    classify: Classify,
}

/// Control frequency from which a step is short, Hz.
const SHORT_STEPS: f64 = 10.0;

/// A stepped environment, or the error of its step.
pub type Arrival = (usize, Result<StepBatches, EnvError>);

impl Environment {
    /// Wraps environments made by Python; the rows of an answer have at most `bytes` bytes, and a whole answer `most`.
    ///
    /// # Errors
    /// Requested shared memory that is not available.
    pub fn new(
        made: MadeEnvironments,
        asked: SessionOptions,
        bytes: usize,
        most: usize,
        classify: Classify,
    ) -> Result<Self, Fault> {
        let segment = match asked.shm {
            false => None,
            true => Some(Arc::new(Segment::create(random()?, bytes).map_err(|error| {
                Fault::config("share", format!("this server has no shared memory to offer: {error}; leave shm out"))
            })?)),
        };
        Ok(Self { pool: made.pool, weights: made.weights, picture: made.picture, asked, segment, most, classify })
    }

    /// Encoding of results; large arrays into shared memory with `shm`, if there is some.
    fn layout(&self, shm: bool) -> Layout<'_> {
        let segment = self.segment.clone().filter(|_| shm);
        if let Some(segment) = &segment {
            segment.opened();
        }
        Layout { spec: self.pool.spec(), weights: &self.weights, millimetres: self.asked.millimetres, segment }
    }

    /// Name of the shared memory, for the client.
    pub fn segment(&self) -> Option<&str> {
        self.segment.as_deref().map(Segment::name)
    }

    fn fault(&self, field: &str, error: EnvError) -> Fault {
        let field = match &error {
            EnvError::BadOption { option, .. } => option,
            EnvError::BadLength { what: "seeds", .. } => "seed",
            EnvError::BadLength { what: "the reset mask", .. } => "mask",
            // Commands for one environment name it by `env_id`.
            EnvError::NoSuchEnv { .. } | EnvError::Busy { .. } if matches!(field, "env_id" | "state") => "env_id",
            EnvError::NoSuchEnv { .. } | EnvError::Busy { .. } => "env_ids",
            _ => field,
        };
        let field = field.to_owned();
        let found = (self.classify)(error.counted_from(self.asked.first));
        Fault { field: if found.field.is_empty() { field } else { found.field }, ..found }
    }

    /// True for a command that takes less time than a change of threads.
    pub fn is_short(&self, command: &Command) -> bool {
        let config = &self.pool.spec().config;
        match command {
            Command::Observe | Command::Cameras | Command::GetState { .. } => true,
            Command::Step { .. } => {
                self.pool.len() == 1 && !config.control.decides() && config.control_freq >= SHORT_STEPS
            }
            _ => false,
        }
    }

    /// Executes a command on the current rayon pool; the answer as a frame.
    ///
    /// * `stop`: set to skip environments that it has not reached.
    /// * `shm`: large arrays of the answer may be in shared memory.
    /// * `done`: called for each environment of `send` that arrives.
    ///
    /// # Errors
    /// The error that the same call has locally.
    pub fn run<F>(&self, id: u64, command: Command, shm: bool, stop: &AtomicBool, done: F) -> Result<Vec<u8>, Fault>
    where
        F: Fn(Arrival) + Clone + Send + 'static,
    {
        match command {
            Command::Reset { seeds, mask, options } => {
                let seeds = self.seeds(seeds)?;
                let batch = self.pool.reset_until(stop, &seeds, mask.as_deref(), &options);
                Ok(answer::now(id, &self.layout(shm), &batch.map_err(|error| self.fault("options", error))?))
            }
            Command::Step { actions, width } => {
                self.check(&actions, width, self.pool.len())?;
                let stepped = self.pool.step_until(stop, &actions).map_err(|error| self.fault("actions", error))?;
                Ok(answer::stepped(id, &self.layout(shm), &stepped))
            }
            Command::Send { actions, width, envs } => {
                let envs = envs.unwrap_or_else(|| (0..self.pool.len()).collect());
                self.check(&actions, width, envs.len())?;
                let sent = self.pool.send(&envs, &actions, move |env, result| done((env, result)));
                sent.map_err(|error| self.fault("actions", error))?;
                Ok(answer::begin(id, 0, 0).into_bytes())
            }
            Command::Observe => {
                let all = 0..self.pool.len();
                let ready = all.map(|env| self.pool.env(env)?.ready_to_observe(env));
                ready.collect::<Result<(), _>>().map_err(|error| self.fault("", error))?;
                Ok(answer::now(id, &self.layout(shm), &self.pool.now()))
            }
            Command::Render { envs } => self.render(id, envs),
            Command::Cameras => self.cameras(id).map_err(|error| self.fault("", error)),
            Command::GetState { env } => {
                let saved = self.pool.env(env).and_then(|locked| locked.save(self.pool.spec(), env));
                let saved = saved.map_err(|error| self.fault("env_id", error))?;
                let mut frame = answer::begin(id, 1, saved.len());
                frame.text("state");
                frame.binary(&saved);
                Ok(frame.into_bytes())
            }
            Command::SetState { env, state } => {
                let batch = self.pool.restore(env, &state).map_err(|error| self.fault("state", error))?;
                Ok(answer::now(id, &self.layout(shm), &batch))
            }
            Command::Prepare => self.prepare(id, stop),
            Command::Names => {
                let names = self.pool.spec().objects.names();
                let mut frame = answer::begin(id, 1, 0);
                frame.text("names");
                frame.list(names.len());
                names.for_each(|name| frame.text(name));
                Ok(frame.into_bytes())
            }
            Command::Make { .. } | Command::Resume { .. } | Command::Recv { .. } | Command::Close | Command::Cancel => {
                Err(Fault::internal("a command was not handled by its session"))
            }
        }
    }

    fn check(&self, actions: &[f32], width: usize, rows: usize) -> Result<(), Fault> {
        let size = self.pool.spec().action;
        if width == size && actions.len() == rows * size {
            return Ok(());
        }
        let given = actions.len().checked_div(width).unwrap_or_default();
        Err(Fault::config("actions", format!("actions has shape ({given}, {width}); give ({rows}, {size})")))
    }

    fn seeds(&self, seeds: Seeds) -> Result<Vec<Option<u64>>, Fault> {
        let count = self.pool.len();
        match seeds {
            Seeds::Each(each) => Ok(each),
            Seeds::First(seed) => {
                let each = (0..count as u64).map(|env| seed.checked_add(env).map(Some));
                let beyond = || Fault::config("seed", format!("seed is {seed}; the last environment's is beyond 2^64"));
                each.collect::<Option<Vec<_>>>().ok_or_else(beyond)
            }
            Seeds::Continue => (0..count)
                .map(|env| {
                    let locked = self.pool.env(env).map_err(|error| self.fault("", error))?;
                    if locked.ready_to_observe(env).is_ok() { Ok(None) } else { random().map(Some) }
                })
                .collect(),
        }
    }

    fn render(&self, id: u64, envs: Option<Vec<usize>>) -> Result<Vec<u8>, Fault> {
        let Some(picture) = &self.picture else {
            let message = "these environments were made without render_mode; give render_mode='rgb_array' to make them";
            return Err(Fault::config("render_mode", message));
        };
        let envs = envs.unwrap_or_else(|| (0..self.pool.len()).collect());
        let [height, width] = picture.image_size.map(|n| n as usize);
        let bytes = envs.len().saturating_mul(height * width * 3);
        if envs.len() > self.pool.len() || bytes > self.most {
            let message = format!(
                "{} pictures have {bytes} bytes; name each of the {} environments once at most, and as many as fit into {} bytes",
                envs.len(),
                self.pool.len(),
                self.most
            );
            return Err(Fault::config("env_ids", message));
        }
        let made = self.pool.pictures(&envs, picture).map_err(|error| self.fault("env_ids", error))?;
        let mut frame = answer::begin(id, 1, made.len());
        frame.text("frames");
        frame.array(&made, &[envs.len(), height, width, 3]);
        Ok(frame.into_bytes())
    }

    fn cameras(&self, id: u64) -> Result<Vec<u8>, EnvError> {
        let cameras = self.pool.cameras()?;
        let mut frame = answer::begin(id, 1, 0);
        frame.text("cameras");
        frame.map(cameras.len());
        for camera in cameras {
            frame.text(&camera.name);
            frame.map(2);
            frame.text("intrinsics");
            frame.array(&camera.intrinsics, &[3, 3]);
            frame.text("world_from_camera");
            let poses = &camera.world_from_camera;
            // Rows, since nalgebra's matrices are column-major.
            let rows =
                poses.iter().flat_map(|pose| pose.to_homogeneous().transpose().iter().copied().collect::<Vec<_>>());
            frame.array(&rows.collect::<Vec<f64>>(), &[poses.len(), 4, 4]);
        }
        Ok(frame.into_bytes())
    }

    fn prepare(&self, id: u64, stop: &AtomicBool) -> Result<Vec<u8>, Fault> {
        let objects = &self.pool.spec().objects;
        let models = !self.pool.spec().observer.specs().is_empty() || self.picture.is_some();
        let each = (0..objects.len()).into_par_iter().with_max_len(1);
        // Usable objects are prepared, even if others are not.
        let prepared: Vec<_> = each
            .map(|index| match stop.load(Ordering::Acquire) {
                true => Err(Fault::interrupted()),
                false => objects.prepare(index, models).map_err(|error| self.fault("objects", error)),
            })
            .collect();
        prepared.into_iter().collect::<Result<(), _>>().map(|()| answer::begin(id, 0, 0).into_bytes())
    }

    /// The answer to a `recv`, of environments whose step has ended.
    ///
    /// # Errors
    /// The first error of a step; the others come with the next `recv`.
    pub fn received(&self, id: u64, arrivals: &mut Vec<Arrival>) -> Result<Vec<u8>, Fault> {
        if let Some(bad) = arrivals.iter().position(|(_, result)| result.is_err()) {
            let (env, result) = arrivals.remove(bad);
            self.pool.arrived(env);
            return match result {
                Err(error) => Err(self.fault("", error)),
                Ok(_) => Err(Fault::internal("an arrival is lost")),
            };
        }
        let spec = self.pool.spec();
        let mut all = StepBatches { now: Batch::new(spec, arrivals.len()), last: Batch::new(spec, 0) };
        for (env, result) in arrivals.drain(..) {
            self.pool.arrived(env);
            if let Ok(stepped) = result {
                all.now.append(stepped.now);
                all.last.append(stepped.last);
            }
        }
        Ok(answer::stepped(id, &self.layout(false), &all))
    }
}

/// A random number of the operating system.
///
/// # Errors
/// A system without random numbers.
pub fn random() -> Result<u64, Fault> {
    getrandom::u64().map_err(|error| Fault::internal(error.to_string()))
}
