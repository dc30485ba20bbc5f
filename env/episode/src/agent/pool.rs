//! All environments in one call, on the current rayon pool.

use crate::EpisodeError;
use crate::agent::batch::Batch;
use crate::agent::config::AgentConfig;
use crate::agent::objects::Objects;
use crate::agent::rules::Rules;
use crate::agent::slot::Slot;
use crate::agent::start::StartOptions;
use rayon::prelude::*;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Environments side by side; a single one is a pool of one.
pub struct Pool {
    rules: Rules,
    slots: Vec<Mutex<Slot>>,
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

impl Pool {
    /// Makes `count` environments that draw from `objects`; each needs a reset before its first step.
    ///
    /// # Errors
    /// No environment, a setting out of range, or a hand whose kinematics fail.
    pub fn new(objects: Arc<Objects>, config: AgentConfig, count: usize) -> Result<Self, EpisodeError> {
        if count == 0 {
            return Err(EpisodeError::BadConfig { field: "num_envs", value: 0.0, expected: "at least 1" });
        }
        Ok(Self {
            rules: Rules::new(objects, config)?,
            slots: (0..count).map(|_| Mutex::default()).collect(),
            away: (0..count).map(|_| AtomicBool::new(false)).collect(),
        })
    }

    /// What every environment shares.
    pub fn rules(&self) -> &Rules {
        &self.rules
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
    pub fn slot(&self, env: usize) -> Result<MutexGuard<'_, Slot>, EpisodeError> {
        let count = self.slots.len();
        let away = self.away.get(env).ok_or(EpisodeError::NoSuchEnv { env, count })?;
        if away.load(Ordering::Acquire) {
            return Err(EpisodeError::Busy { env });
        }
        Ok(self.lock(env))
    }

    fn lock(&self, env: usize) -> MutexGuard<'_, Slot> {
        // A slot changes as a whole at the end of a reset; a step that panicked leaves a world that a reset replaces.
        self.slots[env].lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn all_here(&self) -> Result<(), EpisodeError> {
        match self.away.iter().position(|away| away.load(Ordering::Acquire)) {
            Some(env) => Err(EpisodeError::Busy { env }),
            None => Ok(()),
        }
    }

    /// Does `work` with every environment that it comes to before `stop` is set; the others stay as they are.
    fn each<F>(&self, stop: &AtomicBool, work: F) -> Result<(), EpisodeError>
    where
        F: Fn(usize, &mut Slot) -> Result<(), EpisodeError> + Sync,
    {
        // One by one: a step in contact takes several times as long as one in the air.
        let results: Vec<Option<Result<(), EpisodeError>>> = (0..self.len())
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
            return Err(EpisodeError::Cancelled { done, total });
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
        options: &StartOptions,
    ) -> Result<Batch, EpisodeError> {
        self.reset_until(&AtomicBool::new(false), seeds, mask, options)
    }

    /// As [`Pool::reset`], until `stop` is set.
    ///
    /// # Errors
    /// As [`Pool::reset`], and [`EpisodeError::Cancelled`] where environments were left as they were.
    pub fn reset_until(
        &self,
        stop: &AtomicBool,
        seeds: &[Option<u64>],
        mask: Option<&[bool]>,
        options: &StartOptions,
    ) -> Result<Batch, EpisodeError> {
        self.all_here()?;
        self.has_length("seeds", seeds.len())?;
        if let Some(mask) = mask {
            self.has_length("the reset mask", mask.len())?;
        }
        let wanted = |env: usize| mask.is_none_or(|m| m[env]);
        self.each(stop, |env, slot| match wanted(env) {
            true => slot.reset(&self.rules, env, seeds[env], options),
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
    pub fn step(&self, actions: &[f32]) -> Result<Stepped, EpisodeError> {
        self.step_until(&AtomicBool::new(false), actions)
    }

    /// As [`Pool::step`], until `stop` is set.
    ///
    /// # Errors
    /// As [`Pool::step`], and [`EpisodeError::Cancelled`] where environments were left as they were.
    pub fn step_until(&self, stop: &AtomicBool, actions: &[f32]) -> Result<Stepped, EpisodeError> {
        self.all_here()?;
        let envs: Vec<usize> = (0..self.len()).collect();
        self.check(&envs, actions)?;
        let size = self.rules.action;
        self.each(stop, |env, slot| slot.step(&self.rules, env, &actions[env * size..(env + 1) * size]))?;
        Ok(self.stepped())
    }

    /// Sends environments off to step on the current rayon pool; `done` is called for each, in whatever order they arrive, and
    /// nobody can use one until it is reported by [`Pool::arrived`].
    ///
    /// # Errors
    /// As [`Pool::step`], or an environment that is still away; what happens on the way, a panic too, reaches `done`.
    pub fn send<F>(self: &Arc<Self>, envs: &[usize], actions: &[f32], done: F) -> Result<(), EpisodeError>
    where
        F: Fn(usize, Result<Stepped, EpisodeError>) + Clone + Send + 'static,
    {
        self.check(envs, actions)?;
        let mut named = vec![false; self.len()];
        if let Some(&env) = envs.iter().find(|env| std::mem::replace(&mut named[**env], true)) {
            return Err(EpisodeError::Busy { env });
        }
        let size = self.rules.action;
        for (row, &env) in envs.iter().enumerate() {
            self.away[env].store(true, Ordering::Release);
            let (pool, done) = (Arc::clone(self), done.clone());
            let action = actions[row * size..(row + 1) * size].to_vec();
            rayon::spawn(move || {
                let step = || {
                    let mut slot = pool.lock(env);
                    slot.step(&pool.rules, env, &action).map(|()| pool.rows(env, &slot))
                };
                // Nobody waits for this task: a panic would end the process, and silence would leave the receiver waiting.
                let result = catch_unwind(AssertUnwindSafe(step)).unwrap_or_else(|payload| {
                    let why = panic_text(payload.as_ref());
                    Err(EpisodeError::Broken { env, why })
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
        let mut batch = Batch::new(&self.rules, self.len());
        for env in 0..self.len() {
            batch.push(&self.rules, env, self.lock(env).outcome());
        }
        batch
    }

    fn stepped(&self) -> Stepped {
        let mut stepped = Stepped { now: Batch::new(&self.rules, self.len()), last: Batch::new(&self.rules, 0) };
        for env in 0..self.len() {
            let slot = self.lock(env);
            stepped.now.push(&self.rules, env, slot.outcome());
            if let Some(last) = slot.last() {
                stepped.last.push(&self.rules, env, last);
            }
        }
        stepped
    }

    /// Takes up a state that [`Slot::save`] gave; environment `env` as it stands then.
    ///
    /// # Errors
    /// As [`Pool::slot`] and [`Slot::restore`].
    pub fn restore(&self, env: usize, state: &[u8]) -> Result<Batch, EpisodeError> {
        let mut slot = self.slot(env)?;
        slot.restore(&self.rules, state)?;
        Ok(self.rows(env, &slot).now)
    }

    fn rows(&self, env: usize, slot: &Slot) -> Stepped {
        let mut stepped = Stepped { now: Batch::new(&self.rules, 1), last: Batch::new(&self.rules, 0) };
        stepped.now.push(&self.rules, env, slot.outcome());
        if let Some(last) = slot.last() {
            stepped.last.push(&self.rules, env, last);
        }
        stepped
    }

    fn has_length(&self, what: &'static str, found: usize) -> Result<(), EpisodeError> {
        let expected = self.len();
        if found == expected { Ok(()) } else { Err(EpisodeError::BadLength { what, found, expected }) }
    }

    /// Everything that can be wrong with a step, before anything moves.
    fn check(&self, envs: &[usize], actions: &[f32]) -> Result<(), EpisodeError> {
        let size = self.rules.action;
        if actions.len() != envs.len() * size {
            return Err(EpisodeError::BadLength {
                what: "the action array",
                found: actions.len(),
                expected: envs.len() * size,
            });
        }
        for (row, &env) in envs.iter().enumerate() {
            let slot = self.slot(env)?;
            slot.ready(&self.rules, env)?;
            let action = &actions[row * size..(row + 1) * size];
            let bad = action.iter().position(|a| !a.is_finite());
            if let (Some(index), false) = (bad, slot.resets_next(&self.rules)) {
                return Err(EpisodeError::BadAction { env, why: format!("holds {} at index {index}", action[index]) });
            }
        }
        Ok(())
    }
}
