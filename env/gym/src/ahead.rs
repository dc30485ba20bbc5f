//! Background preparation on one thread.
//!
//! Nothing depends on it: a thread that needs a result which is not ready computes it itself, with the same result. If the background thread is
//! working on that result, the other thread waits; work that another thread has begun is not started again. The background thread starts with
//! the first job of a process; forked children do not have it, and prepare nothing in the background.

use rayon::{ThreadPool, ThreadPoolBuilder};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Most queued jobs; further ones are dropped, and done when they are needed.
const MOST_QUEUED: usize = 1024;
/// Stack of the thread, bytes: hull and tree code recurses.
const STACK: usize = 8 << 20;

/// A piece of work of a thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Work {
    /// The preparation of the object with this index.
    Object(usize),
    /// A scene at rest, by the seed of its layout.
    Scene(u64),
}

/// The background thread, and the work of all threads.
pub struct Ahead {
    /// The process that started the thread, and a pool of one thread, on which nested parallel loops stay.
    pool: Mutex<Option<(u32, ThreadPool)>>,
    queued: Arc<AtomicUsize>,
    workers: Arc<Workers>,
}

#[derive(Default)]
struct Workers {
    /// Work in progress.
    at: Mutex<BTreeMap<Work, Working>>,
    changed: Condvar,
}

#[derive(Clone, Copy, Debug, Default)]
struct Working {
    /// The process whose background thread works on it. A child that was forked meanwhile does not have the thread, and does not wait.
    ahead: Option<u32>,
    /// Number of other threads that work on it.
    claims: usize,
}

/// Work in progress; it ends when this is dropped.
pub struct Claim<'a> {
    workers: &'a Workers,
    work: Work,
    ahead: bool,
}

impl Workers {
    fn lock(&self) -> MutexGuard<'_, BTreeMap<Work, Working>> {
        // A poisoned lock is harmless: no change inside it is partial.
        self.at.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Claims `work` for the calling thread; waits while the background thread works on it.
    fn claim(&self, work: Work) -> Claim<'_> {
        let mut at = self.lock();
        while at.get(&work).is_some_and(|working| working.ahead == Some(std::process::id())) {
            at = self.changed.wait(at).unwrap_or_else(PoisonError::into_inner);
        }
        at.entry(work).or_default().claims += 1;
        Claim { workers: self, work, ahead: false }
    }

    /// Claims `work` for the background thread, unless another thread works on it.
    fn begin(&self, work: Work) -> Option<Claim<'_>> {
        let mut at = self.lock();
        if at.contains_key(&work) {
            return None;
        }
        at.insert(work, Working { ahead: Some(std::process::id()), claims: 0 });
        Some(Claim { workers: self, work, ahead: true })
    }
}

impl Drop for Claim<'_> {
    fn drop(&mut self) {
        let mut at = self.workers.lock();
        if let Some(working) = at.get_mut(&self.work) {
            if self.ahead {
                working.ahead = None;
            } else {
                working.claims -= 1;
            }
            if working.ahead.is_none() && working.claims == 0 {
                at.remove(&self.work);
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
    /// Claims `work` for the calling thread; waits while the background thread works on it.
    ///
    /// Two threads may claim the same work: a rayon worker may run another worker's task in the meantime, and would wait for itself.
    pub fn claim(&self, work: Work) -> Claim<'_> {
        self.workers.claim(work)
    }

    /// Queues `job`, unless the queue is full. It is skipped if another thread does `work` by then; a job that panics is dropped.
    pub fn spawn(&self, work: Work, job: impl FnOnce() + Send + 'static) {
        let mut pool = self.pool.lock().unwrap_or_else(PoisonError::into_inner);
        if pool.is_none() {
            let builder = ThreadPoolBuilder::new().num_threads(1).stack_size(STACK);
            // Without the thread, everything is done when it is needed.
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
            if let Some(claim) = workers.begin(work) {
                // No thread waits for the result; the one that needs it meets the same panic.
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
            // Dropping the pool would wake its thread, which exists in the parent only.
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
    fn a_job_in_progress_is_awaited() {
        let ahead = Ahead::default();
        let (started, begun) = channel();
        let (go, wait) = channel::<()>();
        let done = Arc::new(AtomicUsize::new(0));
        let count = Arc::clone(&done);
        ahead.spawn(Work::Object(7), move || {
            started.send(()).unwrap();
            wait.recv().unwrap();
            count.fetch_add(1, Ordering::SeqCst);
        });
        begun.recv().unwrap();
        // Other work is free.
        drop(ahead.claim(Work::Object(8)));
        let late = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(20));
            go.send(()).unwrap();
        });
        drop(ahead.claim(Work::Object(7)));
        assert_eq!(done.load(Ordering::SeqCst), 1);
        late.join().unwrap();
    }

    #[test]
    fn a_job_in_progress_is_not_begun_again_and_a_panic_ends_only_its_job() {
        let ahead = Ahead::default();
        let done = Arc::new(AtomicUsize::new(0));
        let count = |by: usize| {
            let done = Arc::clone(&done);
            move || {
                done.fetch_add(by, Ordering::SeqCst);
            }
        };
        let claim = ahead.claim(Work::Object(1));
        ahead.spawn(Work::Object(1), count(100));
        ahead.spawn(Work::Object(2), || std::panic::resume_unwind(Box::new("no job today")));
        ahead.spawn(Work::Object(2), count(1));
        let (sender, finished) = channel();
        ahead.spawn(Work::Object(3), move || sender.send(()).unwrap());
        finished.recv().unwrap();
        drop(claim);
        assert_eq!(done.load(Ordering::SeqCst), 1);
        drop(ahead.claim(Work::Object(2)));
    }

    /// A child that was forked while the background thread worked has no such thread, and does the work itself.
    #[test]
    fn no_process_waits_for_the_thread_of_another() {
        let ahead = Ahead::default();
        let other = std::process::id() + 1;
        ahead.workers.lock().insert(Work::Scene(1), Working { ahead: Some(other), claims: 0 });
        drop(ahead.claim(Work::Scene(1)));
    }
}
