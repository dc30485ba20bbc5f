//! All environments in one call, on the current rayon pool.

use crate::AgentError;
use crate::batch::Batch;
use crate::config::AgentConfig;
use crate::env::Env;
use crate::env_spec::EnvSpec;
use crate::objects::{Need, Objects};
use crate::reset_options::ResetOptions;
use crate::row_check::check_rows;
use graspbox_episode::EpisodeError;
use graspbox_mesh::in_range;
use rayon::prelude::*;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Most environments in a pool. `tests/rust/footprint.rs` bounds the memory of one world.
pub const MOST_ENVS: usize = 65_536;

/// Environments side by side; a single one is a pool of one.
pub struct EnvPool {
    spec: EnvSpec,
    envs: Vec<Mutex<Env>>,
    /// Environments that were sent off and not received yet.
    away: Vec<AtomicBool>,
    /// Set to call back what was sent off; the next ones that are sent get a flag of their own.
    recall: Mutex<Arc<AtomicBool>>,
}

/// The message of a panic.
pub fn panic_text(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().copied();
    text.or_else(|| payload.downcast_ref::<String>().map(String::as_str)).unwrap_or("no message").to_owned()
}

/// What a step of several environments returned.
#[derive(Clone, Debug, PartialEq)]
pub struct Stepped {
    /// One row per environment.
    pub now: Batch,
    /// The last results of episodes that ended and were followed by the next one in this step; one row each.
    pub last: Batch,
}

impl EnvPool {
    /// Makes `count` environments that sample from `objects`; each needs a reset before its first step.
    ///
    /// # Errors
    /// No environment or more than [`MOST_ENVS`], a setting out of range, a hand that cannot be simulated, or
    /// [`AgentError::WrongSize`] for a row of an observation.
    pub fn new(objects: Arc<Objects>, config: AgentConfig, count: usize) -> Result<Self, AgentError> {
        in_range("num_envs", count as f64, 1.0..=MOST_ENVS as f64, "")?;
        Self::with_spec(EnvSpec::new(objects, config)?, count)
    }

    fn with_spec(spec: EnvSpec, count: usize) -> Result<Self, AgentError> {
        check_rows(&spec)?;
        Ok(Self {
            spec,
            envs: (0..count).map(|_| Mutex::default()).collect(),
            away: (0..count).map(|_| AtomicBool::new(false)).collect(),
            recall: Mutex::default(),
        })
    }

    /// What every environment shares.
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
    /// An index that does not exist, or an environment that was sent off.
    pub fn env(&self, env: usize) -> Result<MutexGuard<'_, Env>, AgentError> {
        let count = self.envs.len();
        let away = self.away.get(env).ok_or(AgentError::NoSuchEnv { env, count })?;
        if away.load(Ordering::Acquire) {
            return Err(AgentError::Busy { env });
        }
        Ok(self.lock(env))
    }

    fn lock(&self, env: usize) -> MutexGuard<'_, Env> {
        // An environment changes as a whole at the end of a reset; a step that panicked leaves a world that a reset replaces.
        self.envs[env].lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn all_here(&self) -> Result<(), AgentError> {
        match self.away.iter().position(|away| away.load(Ordering::Acquire)) {
            Some(env) => Err(AgentError::Busy { env }),
            None => Ok(()),
        }
    }

    /// Runs `work` on every environment that it reaches before `stop` is set; the others stay as they are.
    fn each<F>(&self, stop: &AtomicBool, work: F) -> Result<(), AgentError>
    where
        F: Fn(usize, &mut Env) -> Result<(), AgentError> + Sync,
    {
        if let [env] = self.envs.as_slice() {
            // On the present thread: to change it takes longer than a short step.
            let mut env = env.lock().unwrap_or_else(PoisonError::into_inner);
            if stop.load(Ordering::Acquire) {
                return Err(EpisodeError::Cancelled { done: 0, total: 1 }.into());
            }
            return work(0, &mut env);
        }
        // One by one: a step in contact takes several times as long as one in the air.
        let results: Vec<Option<Result<(), AgentError>>> = (0..self.len())
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

    /// Begins new episodes where `mask` says so (everywhere without one); all rows come back.
    ///
    /// * `seeds`: one per environment; none continues its stream.
    ///
    /// # Errors
    /// Lists of another length, an environment's first reset without a seed, an option out of place, or an object that cannot be
    /// prepared; the error of the first environment is given.
    pub fn reset(
        &self,
        seeds: &[Option<u64>],
        mask: Option<&[bool]>,
        options: &ResetOptions,
    ) -> Result<Batch, AgentError> {
        self.reset_until(&AtomicBool::new(false), seeds, mask, std::slice::from_ref(options))
    }

    /// As [`EnvPool::reset`], until `stop` is set.
    ///
    /// * `options`: one for all environments, or one per environment.
    ///
    /// # Errors
    /// As [`EnvPool::reset`], and [`EpisodeError::Cancelled`] if some environments were left as they were.
    pub fn reset_until(
        &self,
        stop: &AtomicBool,
        seeds: &[Option<u64>],
        mask: Option<&[bool]>,
        options: &[ResetOptions],
    ) -> Result<Batch, AgentError> {
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
        self.ensure(stop, needs.filter_map(|index| self.lock(index).need(&self.spec, seeds[index], option(index))));
        self.each(stop, |index, env| match wanted(index) {
            true => env.reset(&self.spec, index, seeds[index], option(index)),
            false => env.ready_to_observe(index),
        })?;
        Ok(self.now())
    }

    /// Makes what environments need, each object once: those that begin together with the same object would each make it.
    fn ensure(&self, stop: &AtomicBool, needs: impl Iterator<Item = Need>) {
        let mut needs: Vec<Need> = needs.collect();
        needs.sort_by_key(|need| need.object);
        needs.par_chunk_by(|a, b| a.object == b.object).for_each(|needs| {
            for need in needs.iter().take_while(|_| !stop.load(Ordering::Acquire)) {
                // An error is found again, and reported, by the reset of the environment.
                drop(self.spec.objects.ensure(need));
            }
        });
    }

    /// One step of every environment.
    ///
    /// * `actions`: one row per environment, in [-1, 1]; the row of an environment that begins an episode instead is ignored.
    ///
    /// # Errors
    /// A list of another length, a number that is not finite, or an environment that cannot step: then nothing was moved.
    pub fn step(&self, actions: &[f32]) -> Result<Stepped, AgentError> {
        self.step_until(&AtomicBool::new(false), actions)
    }

    /// As [`EnvPool::step`], until `stop` is set.
    ///
    /// # Errors
    /// As [`EnvPool::step`], and [`EpisodeError::Cancelled`] if some environments were left as they were.
    pub fn step_until(&self, stop: &AtomicBool, actions: &[f32]) -> Result<Stepped, AgentError> {
        self.all_here()?;
        let envs: Vec<usize> = (0..self.len()).collect();
        self.check(&envs, actions)?;
        let size = self.spec.action;
        self.each(stop, |index, env| env.step(&self.spec, index, &actions[index * size..(index + 1) * size]))?;
        Ok(self.stepped())
    }

    /// Sends environments off to step on the current rayon pool; `done` is called for each, in the order in which they finish, and
    /// nobody can use one until it is reported by [`EnvPool::arrived`].
    ///
    /// # Errors
    /// As [`EnvPool::step`], or an environment that is still away. Errors of a step, panics included, reach `done`.
    pub fn send<F>(self: &Arc<Self>, envs: &[usize], actions: &[f32], done: F) -> Result<(), AgentError>
    where
        F: Fn(usize, Result<Stepped, AgentError>) + Clone + Send + 'static,
    {
        self.check(envs, actions)?;
        let mut named = vec![false; self.len()];
        if let Some(&env) = envs.iter().find(|env| std::mem::replace(&mut named[**env], true)) {
            return Err(AgentError::Busy { env });
        }
        let (size, actions) = (self.spec.action, actions.to_vec());
        self.dispatch(envs, done, move |pool, row, index| {
            let mut env = pool.lock(index);
            env.step(&pool.spec, index, &actions[row * size..(row + 1) * size])?;
            Ok(pool.row(index, &env))
        });
        Ok(())
    }

    /// Runs `work` for each of `envs` on the current rayon pool, unless they are called back before.
    ///
    /// * `work`: gets the pool, the place in `envs`, and the index of the environment.
    fn dispatch<F, W>(self: &Arc<Self>, envs: &[usize], done: F, work: W)
    where
        F: Fn(usize, Result<Stepped, AgentError>) + Clone + Send + 'static,
        W: Fn(&Self, usize, usize) -> Result<Stepped, AgentError> + Send + Sync + 'static,
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
                // Nobody waits for this task: a panic would end the process, and silence would leave the receiver waiting.
                let result = catch_unwind(AssertUnwindSafe(|| work(&pool, row, env))).unwrap_or_else(|payload| {
                    let why = panic_text(payload.as_ref());
                    Err(AgentError::Broken { env, why })
                });
                done(env, result);
            });
        }
    }

    fn recall(&self) -> MutexGuard<'_, Arc<AtomicBool>> {
        self.recall.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Calls back environments that were sent off: those that have not begun to step stay as they are and are here again soon, without
    /// a call of `done`; the others arrive as usual.
    pub fn call_back(&self) {
        std::mem::take(&mut *self.recall()).store(true, Ordering::Release);
    }

    /// Number of environments that were sent off and not received yet.
    pub fn away(&self) -> usize {
        self.away.iter().filter(|away| away.load(Ordering::Acquire)).count()
    }

    /// An environment that was sent off is here again: it can be stepped, reset or observed.
    pub fn arrived(&self, env: usize) {
        if let Some(away) = self.away.get(env) {
            away.store(false, Ordering::Release);
        }
    }

    /// The results of every environment as it stands.
    pub fn now(&self) -> Batch {
        let mut batch = Batch::new(&self.spec, self.len());
        for env in 0..self.len() {
            batch.push(&self.spec, env, self.lock(env).result());
        }
        batch
    }

    fn stepped(&self) -> Stepped {
        let mut stepped = Stepped { now: Batch::new(&self.spec, self.len()), last: Batch::new(&self.spec, 0) };
        for index in 0..self.len() {
            self.push(&mut stepped, index, &self.lock(index));
        }
        stepped
    }

    fn row(&self, index: usize, env: &Env) -> Stepped {
        let mut stepped = Stepped { now: Batch::new(&self.spec, 1), last: Batch::new(&self.spec, 0) };
        self.push(&mut stepped, index, env);
        stepped
    }

    fn push(&self, stepped: &mut Stepped, index: usize, env: &Env) {
        stepped.now.push(&self.spec, index, env.result());
        if let Some(last) = env.last() {
            stepped.last.push(&self.spec, index, last);
        }
    }

    /// Restores a state that [`Env::save`] gave; returns the results of environment `env` as it stands then.
    ///
    /// # Errors
    /// As [`EnvPool::env`] and [`Env::restore`].
    pub fn restore(&self, index: usize, state: &[u8]) -> Result<Batch, AgentError> {
        let mut env = self.env(index)?;
        env.restore(&self.spec, state)?;
        Ok(self.row(index, &env).now)
    }

    fn has_length(&self, what: &'static str, found: usize) -> Result<(), AgentError> {
        let expected = self.len();
        if found == expected { Ok(()) } else { Err(AgentError::BadLength { what, found, expected }) }
    }

    /// Everything that can be wrong with a step, before anything moves.
    fn check(&self, envs: &[usize], actions: &[f32]) -> Result<(), AgentError> {
        let size = self.spec.action;
        if actions.len() != envs.len() * size {
            return Err(AgentError::BadLength {
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
                return Err(AgentError::BadAction { env: index, why });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, clippy::panic)]
mod tests;
