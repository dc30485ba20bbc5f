//! A pool of environments, stepped together on the current rayon pool.

use crate::EnvError;
use crate::config::EnvConfig;
use crate::objects::{Need, Objects};
use crate::observations::row_check::check_rows;
use crate::pool::batch::Batch;
use crate::pool::env::Env;
use crate::pool::env_spec::EnvSpec;
use crate::starts::reset_options::ResetOptions;
use graspbox_episode::EpisodeError;
use graspbox_mesh::in_range;
use graspbox_render::PictureConfig;
use nalgebra::Isometry3;
use rayon::prelude::*;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most environments in a pool. `tests/rust/footprint.rs` bounds the memory of one world.
pub const MOST_ENVS: usize = 65_536;

/// A pool of environments; a single environment is a pool of one.
pub struct EnvPool {
    spec: EnvSpec,
    envs: Vec<Mutex<Env>>,
    /// Environments with a pending step, sent and not received yet.
    away: Vec<AtomicBool>,
    /// Cancels pending steps; steps that are sent later get another flag.
    recall: Mutex<Arc<AtomicBool>>,
}

/// The result of `work`, or the error that `panicked` makes of the message of its panic.
///
/// # Errors
/// That of `work`, or of a panic.
pub fn caught<T, E>(work: impl FnOnce() -> Result<T, E>, panicked: impl FnOnce(String) -> E) -> Result<T, E> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|payload| {
        let text = payload.downcast_ref::<&str>().copied();
        let text = text.or_else(|| payload.downcast_ref::<String>().map(String::as_str));
        Err(panicked(text.unwrap_or("no message").to_owned()))
    })
}

/// A camera and its pose in every environment.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraPoses {
    pub name: String,
    /// Rows of the matrix that takes a camera-frame point to homogeneous image positions.
    pub intrinsics: [f64; 9],
    /// One pose per environment.
    pub world_from_camera: Vec<Isometry3<f64>>,
}

/// Results of a step of several environments.
#[derive(Clone, Debug, PartialEq)]
pub struct StepBatches {
    /// One row per environment.
    pub now: Batch,
    /// Last results of episodes that ended in this step and were followed by the next one; one row each.
    pub last: Batch,
}

impl EnvPool {
    /// Makes `count` environments that sample from `objects`; each needs a reset before its first step.
    ///
    /// # Errors
    /// [`EnvError::OutOfRange`] for no environment, more than [`MOST_ENVS`] or a setting out of range; an error for a hand that cannot be
    /// simulated; [`EnvError::WrongSize`] for a row of an observation.
    pub fn new(objects: Arc<Objects>, config: EnvConfig, count: usize) -> Result<Self, EnvError> {
        in_range("num_envs", count as f64, 1.0..=MOST_ENVS as f64, "")?;
        Self::with_spec(EnvSpec::new(objects, config)?, count)
    }

    fn with_spec(spec: EnvSpec, count: usize) -> Result<Self, EnvError> {
        check_rows(&spec)?;
        Ok(Self {
            spec,
            envs: (0..count).map(|_| Mutex::default()).collect(),
            away: (0..count).map(|_| AtomicBool::new(false)).collect(),
            recall: Mutex::default(),
        })
    }

    /// Data shared by all environments.
    pub fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    /// Number of environments.
    pub fn len(&self) -> usize {
        self.envs.len()
    }

    /// Never true: a pool without environments is refused.
    pub fn is_empty(&self) -> bool {
        self.envs.is_empty()
    }

    /// Exclusive access to environment `env`.
    ///
    /// # Errors
    /// [`EnvError::NoSuchEnv`], or [`EnvError::Busy`] for an environment with a pending step.
    pub fn env(&self, env: usize) -> Result<MutexGuard<'_, Env>, EnvError> {
        let count = self.envs.len();
        let away = self.away.get(env).ok_or(EnvError::NoSuchEnv { env, count })?;
        if away.load(Ordering::Acquire) {
            return Err(EnvError::Busy { env });
        }
        Ok(self.lock(env))
    }

    fn lock(&self, env: usize) -> MutexGuard<'_, Env> {
        // A poisoned lock is harmless: a reset replaces the environment as a whole at its end.
        self.envs[env].lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn all_here(&self) -> Result<(), EnvError> {
        match self.away.iter().position(|away| away.load(Ordering::Acquire)) {
            Some(env) => Err(EnvError::Busy { env }),
            None => Ok(()),
        }
    }

    /// Runs `work` on every environment until `stop` is set; the others are unchanged.
    fn each<F>(&self, stop: &AtomicBool, work: F) -> Result<(), EnvError>
    where
        F: Fn(usize, &mut Env) -> Result<(), EnvError> + Sync,
    {
        if let [env] = self.envs.as_slice() {
            // On the calling thread: a change of threads takes longer than a short step.
            let mut env = env.lock().unwrap_or_else(PoisonError::into_inner);
            if stop.load(Ordering::Acquire) {
                return Err(EpisodeError::Cancelled { done: 0, total: 1 }.into());
            }
            return work(0, &mut env);
        }
        // One by one: a step in contact takes several times as long as one without.
        let results: Vec<Option<Result<(), EnvError>>> = (0..self.len())
            .into_par_iter()
            .with_max_len(1)
            .map(|index| {
                let mut env = self.lock(index);
                (!stop.load(Ordering::Acquire)).then(|| work(index, &mut env))
            })
            .collect();
        let (done, total) = (results.iter().flatten().count(), results.len());
        results.into_iter().flatten().collect::<Result<(), _>>()?;
        if done < total {
            return Err(EpisodeError::Cancelled { done, total }.into());
        }
        Ok(())
    }

    /// Begins new episodes in the environments of `mask` (in all without one). Returns all rows.
    ///
    /// * `seeds`: one per environment; `None` continues its stream.
    ///
    /// # Errors
    /// The error of the first environment that fails: lists of another length, a first reset without a seed, an invalid option, or an object that
    /// cannot be prepared.
    pub fn reset(
        &self,
        seeds: &[Option<u64>],
        mask: Option<&[bool]>,
        options: &ResetOptions,
    ) -> Result<Batch, EnvError> {
        self.reset_until(&AtomicBool::new(false), seeds, mask, std::slice::from_ref(options))
    }

    /// As [`EnvPool::reset`], until `stop` is set.
    ///
    /// * `options`: one for all environments, or one per environment.
    ///
    /// # Errors
    /// As [`EnvPool::reset`], and [`EpisodeError::Cancelled`] if some environments were not reached.
    pub fn reset_until(
        &self,
        stop: &AtomicBool,
        seeds: &[Option<u64>],
        mask: Option<&[bool]>,
        options: &[ResetOptions],
    ) -> Result<Batch, EnvError> {
        self.all_here()?;
        self.has_length("seeds", seeds.len())?;
        let shared = options.len() == 1;
        if !shared {
            self.has_length("the reset options", options.len())?;
        }
        if let Some(mask) = mask {
            self.has_length("the reset mask", mask.len())?;
        }
        let wanted = |index: usize| mask.is_none_or(|m| m[index]);
        let option = |index: usize| &options[if shared { 0 } else { index }];
        let needs = (0..self.len()).filter(|&index| wanted(index));
        self.ensure(stop, needs.flat_map(|index| self.lock(index).needs(&self.spec, seeds[index], option(index))));
        self.each(stop, |index, env| match wanted(index) {
            true => env.reset(&self.spec, index, seeds[index], option(index)),
            false => env.ready_to_observe(index),
        })?;
        Ok(self.now())
    }

    /// Prepares the objects of several environments, each object once.
    fn ensure(&self, stop: &AtomicBool, needs: impl Iterator<Item = Need>) {
        let mut needs: Vec<Need> = needs.collect();
        needs.sort_by_key(|need| need.object);
        needs.par_chunk_by(|a, b| a.object == b.object).for_each(|needs| {
            for need in needs.iter().take_while(|_| !stop.load(Ordering::Acquire)) {
                // An error occurs again, and is reported, in the reset of the environment.
                drop(self.spec.objects.ensure(need));
            }
        });
    }

    /// Steps every environment.
    ///
    /// * `actions`: one row per environment, in [-1, 1]; the row of an environment that begins an episode instead is ignored.
    ///
    /// # Errors
    /// [`EnvError`] for a list of another length, a number that is not finite, or an environment that cannot step; all are then unchanged.
    pub fn step(&self, actions: &[f32]) -> Result<StepBatches, EnvError> {
        self.step_until(&AtomicBool::new(false), actions)
    }

    /// As [`EnvPool::step`], until `stop` is set.
    ///
    /// # Errors
    /// As [`EnvPool::step`], and [`EpisodeError::Cancelled`] if some environments were not reached.
    pub fn step_until(&self, stop: &AtomicBool, actions: &[f32]) -> Result<StepBatches, EnvError> {
        self.all_here()?;
        let envs: Vec<usize> = (0..self.len()).collect();
        self.check(&envs, actions)?;
        let size = self.spec.action;
        self.each(stop, |index, env| env.step(&self.spec, index, &actions[index * size..(index + 1) * size]))?;
        Ok(self.stepped())
    }

    /// Starts steps of environments on the current rayon pool. `done` is called for each when it finishes; the environment is busy until
    /// [`EnvPool::arrived`].
    ///
    /// # Errors
    /// As [`EnvPool::step`], or [`EnvError::Busy`]. Errors of a step, including panics, reach `done`.
    pub fn send<F>(self: &Arc<Self>, envs: &[usize], actions: &[f32], done: F) -> Result<(), EnvError>
    where
        F: Fn(usize, Result<StepBatches, EnvError>) + Clone + Send + 'static,
    {
        self.check(envs, actions)?;
        let mut named = vec![false; self.len()];
        if let Some(&env) = envs.iter().find(|env| std::mem::replace(&mut named[**env], true)) {
            return Err(EnvError::Busy { env });
        }
        let (size, actions) = (self.spec.action, actions.to_vec());
        self.dispatch(envs, done, move |pool, row, index| {
            let mut env = pool.lock(index);
            env.step(&pool.spec, index, &actions[row * size..(row + 1) * size])?;
            Ok(pool.row(index, &env))
        });
        Ok(())
    }

    /// Runs `work` for each of `envs` on the current rayon pool, unless it is cancelled before it starts.
    ///
    /// * `work`: gets the pool, the index in `envs`, and the index of the environment.
    fn dispatch<F, W>(self: &Arc<Self>, envs: &[usize], done: F, work: W)
    where
        F: Fn(usize, Result<StepBatches, EnvError>) + Clone + Send + 'static,
        W: Fn(&Self, usize, usize) -> Result<StepBatches, EnvError> + Send + Sync + 'static,
    {
        let (work, recalled) = (Arc::new(work), Arc::clone(&self.recall()));
        for (row, &env) in envs.iter().enumerate() {
            self.away[env].store(true, Ordering::Release);
            let (pool, work, recalled, done) =
                (Arc::clone(self), Arc::clone(&work), Arc::clone(&recalled), done.clone());
            rayon::spawn(move || {
                if recalled.load(Ordering::Acquire) {
                    return pool.arrived(env);
                }
                // No thread joins this task: a panic would end the process, and silence would leave the receiver waiting.
                let result = caught(|| work(&pool, row, env), |why| EnvError::Broken { env, why });
                done(env, result);
            });
        }
    }

    fn recall(&self) -> MutexGuard<'_, Arc<AtomicBool>> {
        self.recall.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Cancels pending steps: environments that have not begun to step are unchanged and soon free again, without a call of `done`; the others
    /// finish as usual.
    pub fn call_back(&self) {
        std::mem::take(&mut *self.recall()).store(true, Ordering::Release);
    }

    /// Number of environments with a pending step.
    pub fn away(&self) -> usize {
        self.away.iter().filter(|away| away.load(Ordering::Acquire)).count()
    }

    /// Marks the step of an environment as received: it can be stepped, reset or observed again.
    pub fn arrived(&self, env: usize) {
        if let Some(away) = self.away.get(env) {
            away.store(false, Ordering::Release);
        }
    }

    /// The present results of every environment.
    pub fn now(&self) -> Batch {
        let mut batch = Batch::new(&self.spec, self.len());
        for env in 0..self.len() {
            batch.push(&self.spec, env, self.lock(env).result());
        }
        batch
    }

    fn stepped(&self) -> StepBatches {
        let mut stepped = StepBatches { now: Batch::new(&self.spec, self.len()), last: Batch::new(&self.spec, 0) };
        for index in 0..self.len() {
            self.push(&mut stepped, index, &self.lock(index));
        }
        stepped
    }

    fn row(&self, index: usize, env: &Env) -> StepBatches {
        let mut stepped = StepBatches { now: Batch::new(&self.spec, 1), last: Batch::new(&self.spec, 0) };
        self.push(&mut stepped, index, env);
        stepped
    }

    fn push(&self, stepped: &mut StepBatches, index: usize, env: &Env) {
        stepped.now.push(&self.spec, index, env.result());
        if let Some(last) = env.last() {
            stepped.last.push(&self.spec, index, last);
        }
    }

    /// Restores a state from [`Env::save`]. Returns the results of environment `index` in that state.
    ///
    /// # Errors
    /// As [`EnvPool::env`] and [`Env::restore`].
    pub fn restore(&self, index: usize, state: &[u8]) -> Result<Batch, EnvError> {
        let mut env = self.env(index)?;
        env.restore(&self.spec, state)?;
        Ok(self.row(index, &env).now)
    }

    fn has_length(&self, what: &'static str, found: usize) -> Result<(), EnvError> {
        let expected = self.len();
        if found == expected { Ok(()) } else { Err(EnvError::BadLength { what, found, expected }) }
    }

    /// Checks all inputs of a step before anything moves.
    fn check(&self, envs: &[usize], actions: &[f32]) -> Result<(), EnvError> {
        let size = self.spec.action;
        if actions.len() != envs.len() * size {
            return Err(EnvError::BadLength {
                what: "the action array",
                found: actions.len(),
                expected: envs.len() * size,
            });
        }
        for (row, &index) in envs.iter().enumerate() {
            let env = self.env(index)?;
            env.ready(&self.spec, index)?;
            let action = &actions[row * size..(row + 1) * size];
            let bad = action.iter().position(|a| !a.is_finite());
            if let (Some(at), false) = (bad, env.resets_next(&self.spec)) {
                let why = format!("holds {} at index {at}", action[at]);
                return Err(EnvError::BadAction { env: index, why });
            }
        }
        Ok(())
    }
}

impl EnvPool {
    /// Pictures (n, H, W, 3) of the present state of environments `envs`.
    ///
    /// # Errors
    /// As [`EnvPool::env`], [`EnvError::NotReset`], or an error for an object that cannot be rendered.
    pub fn pictures(&self, envs: &[usize], picture: &PictureConfig) -> Result<Vec<u8>, EnvError> {
        let made = envs.par_iter().map(|&env| {
            let locked = self.env(env)?;
            let episode = locked.episode().ok_or(EnvError::NotReset { env })?;
            Ok(self.spec().observer.picture(&episode.pictured(self.spec())?, &episode.viewpoint().light, picture)?)
        });
        let made: Vec<_> = made.collect();
        Ok(made.into_iter().collect::<Result<Vec<_>, EnvError>>()?.concat())
    }

    /// The present pose of every camera, in the order of the config.
    ///
    /// # Errors
    /// [`EnvError::NotReset`] or [`EnvError::Busy`].
    pub fn cameras(&self) -> Result<Vec<CameraPoses>, EnvError> {
        let observer = &self.spec().observer;
        let mut poses = vec![Vec::with_capacity(self.len()); observer.mounted_cameras().len()];
        for env in 0..self.len() {
            let locked = self.env(env)?;
            let episode = locked.episode().ok_or(EnvError::NotReset { env })?;
            let hand = episode.episode().world().world_from_hand();
            for (poses, camera) in poses.iter_mut().zip(observer.cameras(episode.viewpoint(), &hand)?) {
                poses.push(*camera.world_from_camera());
            }
        }
        let cameras = observer.config().cameras.iter().zip(observer.mounted_cameras()).zip(poses);
        Ok(cameras
            .map(|((camera, lens), world_from_camera)| CameraPoses {
                name: camera.name.clone(),
                intrinsics: lens.intrinsics().matrix(),
                world_from_camera,
            })
            .collect())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::panic)]
mod tests;
