//! The only module that releases the GIL.
//!
//! Work runs on a rayon pool of this process while the calling thread waits and checks for signals every `PATIENCE`. On
//! Ctrl-C it requests a stop, waits for `GRACE`, and abandons the work if it has not returned.

use crate::errors::CoreError;
use graspbox_gym::caught;
use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::collections::BTreeMap;
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Time between two checks for signals: a tenth of the documented second.
const PATIENCE: Duration = Duration::from_millis(100);
/// Time that cancelled work has to return before it is abandoned.
const GRACE: Duration = Duration::from_millis(500);
/// Stack of a pool thread, bytes: that of a main thread, since hull and tree code recurses.
const STACK: usize = 8 << 20;
/// Greatest number of threads.
const MAX_THREADS: usize = 1024;

/// Pools by process and size. A forked child finds its parent's pools here, whose threads it does not have.
static POOLS: Mutex<BTreeMap<(u32, usize), Arc<ThreadPool>>> = Mutex::new(BTreeMap::new());

/// The number of threads a call uses: `requested`, else `GRASPBOX_THREADS`, else every core.
///
/// # Errors
/// [`CoreError::Config`] for 0, more than 1024, or a variable that is not a number.
pub fn thread_count(requested: Option<usize>) -> Result<usize, CoreError> {
    let (count, origin) = match (requested, std::env::var("GRASPBOX_THREADS")) {
        (Some(count), _) => (count, "num_threads"),
        (None, Ok(text)) => {
            let count = text.trim().parse().map_err(|_| {
                CoreError::Config(format!("GRASPBOX_THREADS is {text:?}; set it to a number of threads or unset it"))
            })?;
            (count, "GRASPBOX_THREADS")
        }
        (None, Err(_)) => return Ok(std::thread::available_parallelism().map_or(1, usize::from)),
    };
    if (1..=MAX_THREADS).contains(&count) {
        Ok(count)
    } else {
        Err(CoreError::Config(format!("{origin} is {count}; give a number between 1 and {MAX_THREADS}")))
    }
}

/// Reads the argument `num_threads`: an integer of any kind (numpy's too), or None for the default.
///
/// # Errors
/// `ConfigError` for anything else, and for a number out of range.
pub fn threads(value: &Bound<'_, PyAny>) -> PyResult<Option<usize>> {
    if value.is_none() {
        return Ok(None);
    }
    let wrong = || {
        let shown = value.repr().map_or_else(|_| "not an integer".to_owned(), |text| text.to_string());
        CoreError::Config(format!("num_threads is {shown}; give an integer between 1 and {MAX_THREADS}, or None"))
    };
    let count = value.call_method0("__index__").and_then(|index| index.extract()).map_err(|_| wrong())?;
    if (1..=MAX_THREADS).contains(&count) { Ok(Some(count)) } else { Err(wrong().into()) }
}

/// The pool of this process with `count` threads, started at its first use.
fn pool(count: usize) -> Result<Arc<ThreadPool>, CoreError> {
    let build = || {
        ThreadPoolBuilder::new()
            .num_threads(count)
            .stack_size(STACK)
            .thread_name(|i| format!("graspbox-{i}"))
            .build()
            .map(Arc::new)
            .map_err(|error| CoreError::Internal(format!("cannot start {count} threads: {error}")))
    };
    // Do not wait for the lock: a fork may have copied it while it was held.
    let Ok(mut pools) = POOLS.try_lock() else {
        return build();
    };
    let pid = std::process::id();
    while let Some(key) = pools.keys().copied().find(|key| key.0 != pid) {
        // Dropping the pool would wake its threads, which exist in the parent only.
        std::mem::forget(pools.remove(&key));
    }
    if let Some(pool) = pools.get(&(pid, count)) {
        return Ok(Arc::clone(pool));
    }
    let pool = build()?;
    pools.insert((pid, count), Arc::clone(&pool));
    Ok(pool)
}

/// Waits for the result with the GIL released, taking it every [`PATIENCE`] to check for signals.
fn wait<T: Send>(
    py: Python<'_>,
    mut results: Receiver<Result<T, CoreError>>,
    stop: impl FnOnce(),
) -> PyResult<Result<T, CoreError>> {
    let lost = || CoreError::Internal("the worker ended without a result".into());
    loop {
        // The receiver is moved in and out, since it cannot be shared with another thread.
        let (answer, receiver) = py.detach(move || (results.recv_timeout(PATIENCE), results));
        results = receiver;
        match answer {
            Ok(result) => return Ok(result),
            Err(RecvTimeoutError::Disconnected) => return Ok(Err(lost())),
            Err(RecvTimeoutError::Timeout) => {}
        }
        if let Err(signal) = py.check_signals() {
            stop();
            py.detach(move || drop(results.recv_timeout(GRACE)));
            return Err(signal);
        }
    }
}

/// Runs `work` on a pool of `num_threads` threads without the GIL; rayon inside `work` stays on that pool.
///
/// * `stop`: called after a signal; it should make `work` return soon.
///
/// # Errors
/// The error of `work`, mapped by [`CoreError`]; `InternalError` for a panic; the signal handler's exception after a signal.
pub fn interruptible<T, E, F>(py: Python<'_>, num_threads: Option<usize>, stop: impl FnOnce(), work: F) -> PyResult<T>
where
    T: Send + 'static,
    E: Into<CoreError>,
    F: FnOnce() -> Result<T, E> + Send + 'static,
{
    let (sender, results) = sync_channel(1);
    pool(thread_count(num_threads)?)?.spawn(move || {
        let result = caught(|| work().map_err(Into::into), CoreError::Internal);
        // After an interruption there is no receiver.
        drop(sender.send(result));
    });
    let result = wait(py, results, stop);
    crate::log::emit(py);
    Ok(result??)
}

/// As [`interruptible`], for work that cannot be stopped: after a signal it is abandoned.
///
/// # Errors
/// As [`interruptible`].
pub fn detached<T, E, F>(py: Python<'_>, num_threads: Option<usize>, work: F) -> PyResult<T>
where
    T: Send + 'static,
    E: Into<CoreError>,
    F: FnOnce() -> Result<T, E> + Send + 'static,
{
    interruptible(py, num_threads, || (), work)
}

/// Waits without the GIL for the next value from other threads, for at most `PATIENCE`; `None` if none came.
///
/// # Errors
/// The signal handler's exception after a signal, even while results arrive; an internal error if no sender is left.
pub fn awaited<T: Send>(py: Python<'_>, results: &Mutex<Receiver<T>>) -> PyResult<Option<T>> {
    py.check_signals()?;
    let answer = py.detach(|| {
        let results = results.lock().unwrap_or_else(PoisonError::into_inner);
        results.recv_timeout(PATIENCE)
    });
    match answer {
        Ok(result) => Ok(Some(result)),
        Err(RecvTimeoutError::Timeout) => Ok(None),
        Err(RecvTimeoutError::Disconnected) => {
            Err(CoreError::Internal("the workers ended without a result".into()).into())
        }
    }
}

/// The number of threads that calls use: `requested`, or the default.
#[pyfunction]
#[pyo3(signature = (requested=None))]
pub fn num_threads(#[pyo3(from_py_with = threads)] requested: Option<usize>) -> PyResult<usize> {
    Ok(thread_count(requested)?)
}
