//! All environments in one call, on the current rayon pool.

use crate::AgentError;
use crate::batch::Batch;
use crate::config::AgentConfig;
use crate::env::Env;
use crate::env_spec::EnvSpec;
use crate::initial_state::ResetOptions;
use crate::objects::Objects;
use graspbox_episode::EpisodeError;
use rayon::prelude::*;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Environments side by side; a single one is a pool of one.
pub struct EnvPool {
    spec: EnvSpec,
    slots: Vec<Mutex<Env>>,
    /// Environments that were sent off and not received yet.
    away: Vec<AtomicBool>,
}

/// What a panic said.
pub fn panic_text(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().copied();
    text.or_else(|| payload.downcast_ref::<String>().map(String::as_str)).unwrap_or("no message").to_owned()
}

/// What a step of all environments showed.
#[derive(Clone, Debug, PartialEq)]
pub struct Stepped {
    /// One row an environment.
    pub now: Batch,
    /// What episodes showed last that ended and began anew in this step; one row each.
    pub last: Batch,
}

impl EnvPool {
    /// Makes `count` environments that draw from `objects`; each needs a reset before its first step.
    ///
    /// # Errors
    /// No environment, a setting out of range, or a hand whose kinematics fail.
    pub fn new(objects: Arc<Objects>, config: AgentConfig, count: usize) -> Result<Self, AgentError> {
        if count == 0 {
            return Err(AgentError::BadConfig { field: "num_envs", value: 0.0, expected: "at least 1" });
        }
        Ok(Self {
            spec: EnvSpec::new(objects, config)?,
            slots: (0..count).map(|_| Mutex::default()).collect(),
            away: (0..count).map(|_| AtomicBool::new(false)).collect(),
        })
    }

    /// What every environment shares.
    pub fn spec(&self) -> &EnvSpec {
        &self.spec
    }

    /// Number of environments.
    pub fn len(&self) -> usize {
        self.slots.len()
    }

    /// Never true: a pool without environments is refused.
    pub fn is_empty(&self) -> bool {
        self.slots.is_empty()
    }

    /// Environment `env`, for as long as nobody else needs it.
    ///
    /// # Errors
    /// An index that does not exist, or an environment that was sent off.
    pub fn slot(&self, env: usize) -> Result<MutexGuard<'_, Env>, AgentError> {
        let count = self.slots.len();
        let away = self.away.get(env).ok_or(AgentError::NoSuchEnv { env, count })?;
        if away.load(Ordering::Acquire) {
            return Err(AgentError::Busy { env });
        }
        Ok(self.lock(env))
    }

    fn lock(&self, env: usize) -> MutexGuard<'_, Env> {
        // A slot changes as a whole at the end of a reset; a step that panicked leaves a world that a reset replaces.
        self.slots[env].lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn all_here(&self) -> Result<(), AgentError> {
        match self.away.iter().position(|away| away.load(Ordering::Acquire)) {
            Some(env) => Err(AgentError::Busy { env }),
            None => Ok(()),
        }
    }

    /// Does `work` with every environment that it comes to before `stop` is set; the others stay as they are.
    fn each<F>(&self, stop: &AtomicBool, work: F) -> Result<(), AgentError>
    where
        F: Fn(usize, &mut Env) -> Result<(), AgentError> + Sync,
    {
        // One by one: a step in contact takes several times as long as one in the air.
        let results: Vec<Option<Result<(), AgentError>>> = (0..self.len())
            .into_par_iter()
            .with_max_len(1)
            .map(|env| {
                let mut slot = self.lock(env);
                (!stop.load(Ordering::Acquire)).then(|| work(env, &mut slot))
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
    /// * `seeds`: one an environment; none continues its stream.
    ///
    /// # Errors
    /// Lists of another length, an environment's first reset without a seed, an option that cannot be, or an object that cannot be
    /// prepared; the error of the first environment is given.
    pub fn reset(
        &self,
        seeds: &[Option<u64>],
        mask: Option<&[bool]>,
        options: &ResetOptions,
    ) -> Result<Batch, AgentError> {
        self.reset_until(&AtomicBool::new(false), seeds, mask, options)
    }

    /// As [`EnvPool::reset`], until `stop` is set.
    ///
    /// # Errors
    /// As [`EnvPool::reset`], and [`AgentError::Cancelled`] where environments were left as they were.
    pub fn reset_until(
        &self,
        stop: &AtomicBool,
        seeds: &[Option<u64>],
        mask: Option<&[bool]>,
        options: &ResetOptions,
    ) -> Result<Batch, AgentError> {
        self.all_here()?;
        self.has_length("seeds", seeds.len())?;
        if let Some(mask) = mask {
            self.has_length("the reset mask", mask.len())?;
        }
        let wanted = |env: usize| mask.is_none_or(|m| m[env]);
        self.each(stop, |env, slot| match wanted(env) {
            true => slot.reset(&self.spec, env, seeds[env], options),
            false => slot.ready_to_show(env),
        })?;
        Ok(self.now())
    }

    /// One step of every environment.
    ///
    /// * `actions`: one row an environment, in [-1, 1]; where an environment begins anew, its row is ignored.
    ///
    /// # Errors
    /// A list of another length, a number that is not finite, or an environment that cannot step: then nothing was moved.
    pub fn step(&self, actions: &[f32]) -> Result<Stepped, AgentError> {
        self.step_until(&AtomicBool::new(false), actions)
    }

    /// As [`EnvPool::step`], until `stop` is set.
    ///
    /// # Errors
    /// As [`EnvPool::step`], and [`AgentError::Cancelled`] where environments were left as they were.
    pub fn step_until(&self, stop: &AtomicBool, actions: &[f32]) -> Result<Stepped, AgentError> {
        self.all_here()?;
        let envs: Vec<usize> = (0..self.len()).collect();
        self.check(&envs, actions)?;
        let size = self.spec.action;
        self.each(stop, |env, slot| slot.step(&self.spec, env, &actions[env * size..(env + 1) * size]))?;
        Ok(self.stepped())
    }

    /// Sends environments off to step on the current rayon pool; `done` is called for each, in whatever order they arrive, and
    /// nobody can use one until it is reported by [`EnvPool::arrived`].
    ///
    /// # Errors
    /// As [`EnvPool::step`], or an environment that is still away; what happens on the way, a panic too, reaches `done`.
    pub fn send<F>(self: &Arc<Self>, envs: &[usize], actions: &[f32], done: F) -> Result<(), AgentError>
    where
        F: Fn(usize, Result<Stepped, AgentError>) + Clone + Send + 'static,
    {
        self.check(envs, actions)?;
        let mut named = vec![false; self.len()];
        if let Some(&env) = envs.iter().find(|env| std::mem::replace(&mut named[**env], true)) {
            return Err(AgentError::Busy { env });
        }
        let size = self.spec.action;
        for (row, &env) in envs.iter().enumerate() {
            self.away[env].store(true, Ordering::Release);
            let (pool, done) = (Arc::clone(self), done.clone());
            let action = actions[row * size..(row + 1) * size].to_vec();
            rayon::spawn(move || {
                let step = || {
                    let mut slot = pool.lock(env);
                    slot.step(&pool.spec, env, &action).map(|()| pool.rows(env, &slot))
                };
                // Nobody waits for this task: a panic would end the process, and silence would leave the receiver waiting.
                let result = catch_unwind(AssertUnwindSafe(step)).unwrap_or_else(|payload| {
                    let why = panic_text(payload.as_ref());
                    Err(AgentError::Broken { env, why })
                });
                done(env, result);
            });
        }
        Ok(())
    }

    /// Number of environments that were sent off and not received yet.
    pub fn away(&self) -> usize {
        self.away.iter().filter(|away| away.load(Ordering::Acquire)).count()
    }

    /// An environment that was sent off is back: it can be stepped, reset or looked at again.
    pub fn arrived(&self, env: usize) {
        if let Some(away) = self.away.get(env) {
            away.store(false, Ordering::Release);
        }
    }

    /// Every environment as it stands.
    pub fn now(&self) -> Batch {
        let mut batch = Batch::new(&self.spec, self.len());
        for env in 0..self.len() {
            batch.push(&self.spec, env, self.lock(env).outcome());
        }
        batch
    }

    fn stepped(&self) -> Stepped {
        let mut stepped = Stepped { now: Batch::new(&self.spec, self.len()), last: Batch::new(&self.spec, 0) };
        for env in 0..self.len() {
            let slot = self.lock(env);
            stepped.now.push(&self.spec, env, slot.outcome());
            if let Some(last) = slot.last() {
                stepped.last.push(&self.spec, env, last);
            }
        }
        stepped
    }

    /// Takes up a state that [`Env::save`] gave; environment `env` as it stands then.
    ///
    /// # Errors
    /// As [`EnvPool::slot`] and [`Env::restore`].
    pub fn restore(&self, env: usize, state: &[u8]) -> Result<Batch, AgentError> {
        let mut slot = self.slot(env)?;
        slot.restore(&self.spec, state)?;
        Ok(self.rows(env, &slot).now)
    }

    fn rows(&self, env: usize, slot: &Env) -> Stepped {
        let mut stepped = Stepped { now: Batch::new(&self.spec, 1), last: Batch::new(&self.spec, 0) };
        stepped.now.push(&self.spec, env, slot.outcome());
        if let Some(last) = slot.last() {
            stepped.last.push(&self.spec, env, last);
        }
        stepped
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
        for (row, &env) in envs.iter().enumerate() {
            let slot = self.slot(env)?;
            slot.ready(&self.spec, env)?;
            let action = &actions[row * size..(row + 1) * size];
            let bad = action.iter().position(|a| !a.is_finite());
            if let (Some(index), false) = (bad, slot.resets_next(&self.spec)) {
                return Err(AgentError::BadAction { env, why: format!("holds {} at index {index}", action[index]) });
            }
        }
        Ok(())
    }
}
