//! Work that is done ahead of its need, on one thread of its own.
//!
//! Nobody depends on it: what is not done in time is done by whoever needs it, with the same result. A thread that needs what is being
//! done waits for it, and what a thread is doing for itself is not begun a second time. The thread starts with the first job of a process
//! and does not exist in a forked child, where nothing is done ahead.

use rayon::{ThreadPool, ThreadPoolBuilder};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Most jobs that wait; further ones are left to those who need them.
const MOST_QUEUED: usize = 1024;
/// Stack of the thread, bytes: hull and tree code recurses.
const STACK: usize = 8 << 20;

/// A thread for work ahead, and who works on what.
pub struct Ahead {
    /// The process that started the thread, and a pool of one thread: loops that run in parallel elsewhere stay on it.
    pool: Mutex<Option<(u32, ThreadPool)>>,
    queued: Arc<AtomicUsize>,
    workers: Arc<Workers>,
}

#[derive(Default)]
struct Workers {
    /// By the key of the work.
    at: Mutex<BTreeMap<usize, Working>>,
    changed: Condvar,
}

#[derive(Clone, Copy, Debug, Default)]
struct Working {
    /// The thread of [`Ahead`].
    ahead: bool,
    /// Threads that do it for themselves.
    claims: usize,
}

/// Somebody's work on a key; it ends when this is dropped.
pub struct Claim<'a> {
    workers: &'a Workers,
    key: usize,
    ahead: bool,
}

impl Workers {
    fn lock(&self) -> MutexGuard<'_, BTreeMap<usize, Working>> {
        // Nothing inside the lock can leave the map half changed.
        self.at.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Work on `key` for oneself, once the thread ahead is not at it.
    fn claim(&self, key: usize) -> Claim<'_> {
        let mut at = self.lock();
        while at.get(&key).is_some_and(|working| working.ahead) {
            at = self.changed.wait(at).unwrap_or_else(PoisonError::into_inner);
        }
        at.entry(key).or_default().claims += 1;
        Claim { workers: self, key, ahead: false }
    }

    /// Work on `key` ahead, unless somebody is at it.
    fn begin(&self, key: usize) -> Option<Claim<'_>> {
        let mut at = self.lock();
        if at.contains_key(&key) {
            return None;
        }
        at.insert(key, Working { ahead: true, claims: 0 });
        Some(Claim { workers: self, key, ahead: true })
    }
}

impl Drop for Claim<'_> {
    fn drop(&mut self) {
        let mut at = self.workers.lock();
        if let Some(working) = at.get_mut(&self.key) {
            if self.ahead {
                working.ahead = false;
            } else {
                working.claims -= 1;
            }
            if !working.ahead && working.claims == 0 {
                at.remove(&self.key);
            }
        }
        self.workers.changed.notify_all();
    }
}

impl Default for Ahead {
    fn default() -> Self {
        Self { pool: Mutex::new(None), queued: Arc::default(), workers: Arc::default() }
    }
}

impl Ahead {
    /// Work on `key` for oneself; waits while the thread ahead is at it.
    ///
    /// Two threads may claim the same key: a thread that works in parallel may be given another's task meanwhile, and would wait for itself.
    pub fn claim(&self, key: usize) -> Claim<'_> {
        self.workers.claim(key)
    }

    /// Does `job`, some time, unless somebody works on `key` by then, or too much waits already. A job that panics is dropped.
    pub fn spawn(&self, key: usize, job: impl FnOnce() + Send + 'static) {
        let mut pool = self.pool.lock().unwrap_or_else(PoisonError::into_inner);
        if pool.is_none() {
            let builder = ThreadPoolBuilder::new().num_threads(1).stack_size(STACK);
            // Without a thread everything is done when it is needed.
            *pool =
                builder.thread_name(|_| "graspbox-ahead".into()).build().ok().map(|pool| (std::process::id(), pool));
        }
        let Some((process, pool)) = pool.as_ref() else { return };
        if *process != std::process::id() || self.queued.fetch_add(1, Ordering::AcqRel) >= MOST_QUEUED {
            self.queued.fetch_sub(1, Ordering::AcqRel);
            return;
        }
        let (queued, workers) = (Arc::clone(&self.queued), Arc::clone(&self.workers));
        pool.spawn(move || {
            queued.fetch_sub(1, Ordering::AcqRel);
            if let Some(claim) = workers.begin(key) {
                // Nobody waits for a result; whoever needs it meets the same panic.
                drop(catch_unwind(AssertUnwindSafe(job)));
                drop(claim);
            }
        });
    }
}

impl Drop for Ahead {
    fn drop(&mut self) {
        let pool = self.pool.get_mut().unwrap_or_else(PoisonError::into_inner).take();
        if let Some((process, pool)) = pool
            && process != std::process::id()
        {
            // Dropping a pool would wake its thread, which lives in the parent only.
            std::mem::forget(pool);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;
    use std::time::Duration;

    #[test]
    fn who_needs_what_is_being_done_waits_for_it() {
        let ahead = Ahead::default();
        let (started, begun) = channel();
        let (go, wait) = channel::<()>();
        let done = Arc::new(AtomicUsize::new(0));
        let count = Arc::clone(&done);
        ahead.spawn(7, move || {
            started.send(()).unwrap();
            wait.recv().unwrap();
            count.fetch_add(1, Ordering::SeqCst);
        });
        begun.recv().unwrap();
        // Another key is free.
        drop(ahead.claim(8));
        let late = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(20));
            go.send(()).unwrap();
        });
        drop(ahead.claim(7));
        assert_eq!(done.load(Ordering::SeqCst), 1);
        late.join().unwrap();
    }

    #[test]
    fn what_somebody_does_is_not_begun_again_and_a_panic_ends_its_job_alone() {
        let ahead = Ahead::default();
        let done = Arc::new(AtomicUsize::new(0));
        let count = |by: usize| {
            let done = Arc::clone(&done);
            move || {
                done.fetch_add(by, Ordering::SeqCst);
            }
        };
        let claim = ahead.claim(1);
        ahead.spawn(1, count(100));
        ahead.spawn(2, || std::panic::resume_unwind(Box::new("no job today")));
        ahead.spawn(2, count(1));
        let (sender, finished) = channel();
        ahead.spawn(3, move || sender.send(()).unwrap());
        finished.recv().unwrap();
        drop(claim);
        assert_eq!(done.load(Ordering::SeqCst), 1);
        drop(ahead.claim(2));
    }
}
