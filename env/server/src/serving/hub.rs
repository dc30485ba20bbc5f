//! State shared by all sessions of a server: settings, counters, threads, and the number of free environments.

use crate::config::ServerConfig;
use crate::metrics::Metrics;
use crate::serving::environment::MadeEnvironments;
use crate::wire::fault::{Classify, Fault};
use rayon::ThreadPool;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, PoisonError};

/// State shared by all sessions.
pub struct Hub {
    /// Settings.
    pub config: ServerConfig,
    /// Counters.
    pub metrics: Arc<Metrics>,
    /// Threads that step environments.
    pub pool: ThreadPool,
    /// Threads that prepare objects: preparation is slow, and steps must not wait for it.
    pub background: ThreadPool,
    /// Names errors.
    pub classify: Classify,
    /// The server is stopping: nothing new begins.
    pub draining: AtomicBool,
    envs: AtomicUsize,
    /// Commands that run.
    running: AtomicUsize,
    makers: Mutex<Sender<MakeJob>>,
}

impl Hub {
    /// A hub whose environments are made by the receiver of `makers`.
    pub fn new(
        config: ServerConfig,
        [pool, background]: [ThreadPool; 2],
        classify: Classify,
        makers: Sender<MakeJob>,
    ) -> Self {
        Self {
            config,
            pool,
            background,
            classify,
            metrics: Arc::default(),
            draining: AtomicBool::new(false),
            envs: AtomicUsize::new(0),
            running: AtomicUsize::new(0),
            makers: Mutex::new(makers),
        }
    }

    /// Begins a short command on the current thread, if fewer run than there are threads; returns the number of the others.
    pub fn begin_short(&self) -> Option<usize> {
        let most = self.config.threads;
        let begun = |running| (running < most).then_some(running + 1);
        self.running.fetch_update(Ordering::AcqRel, Ordering::Relaxed, begun).ok()
    }

    /// A command begins on the threads of the server.
    pub fn begin_one(&self) {
        self.running.fetch_add(1, Ordering::AcqRel);
    }

    /// A command has ended.
    pub fn end_one(&self) {
        self.running.fetch_sub(1, Ordering::AcqRel);
    }

    /// Reserves `count` of the free environments for the client at `peer`.
    ///
    /// # Errors
    /// More than are free.
    pub fn lease(self: &Arc<Self>, count: usize, peer: SocketAddr) -> Result<Lease, Fault> {
        let most = self.config.max_envs;
        let taken = self.envs.fetch_update(Ordering::AcqRel, Ordering::Acquire, |taken| {
            taken.checked_add(count).filter(|sum| *sum <= most)
        });
        match taken {
            Ok(_) => {
                self.metrics.sessions.inc();
                self.metrics.environments.inc_by(count as i64);
                Ok(Lease { hub: Arc::clone(self), count })
            }
            Err(taken) => {
                self.metrics.refuse("environments", &peer);
                let message = format!(
                    "num_envs is {count}; this server has {} of {most} environments left; give at most as many",
                    most.saturating_sub(taken)
                );
                Err(Fault::config("num_envs", message))
            }
        }
    }

    /// Passes a request to the makers of environments.
    pub fn make(&self, job: MakeJob) {
        // Without a receiver, the dropped job reports an error to its session.
        drop(self.makers.lock().unwrap_or_else(PoisonError::into_inner).send(job));
    }
}

/// The reserved environments of a session; dropping this frees them.
pub struct Lease {
    hub: Arc<Hub>,
    count: usize,
}

impl Drop for Lease {
    fn drop(&mut self) {
        self.hub.envs.fetch_sub(self.count, Ordering::AcqRel);
        self.hub.metrics.sessions.dec();
        self.hub.metrics.environments.dec_by(self.count as i64);
    }
}

/// Callback for the result of a [`MakeJob`].
type Reply = Box<dyn FnOnce(Result<MadeEnvironments, Fault>) + Send>;

/// A request for environments, to be answered once; dropping it is an error.
pub struct MakeJob {
    /// Environment id, number, objects and keywords.
    pub request: serde_json::Value,
    /// Set when its client no longer waits.
    unwanted: Arc<AtomicBool>,
    reply: Option<Reply>,
}

impl MakeJob {
    /// A request, and the callback for its result.
    pub fn new<F>(request: serde_json::Value, unwanted: Arc<AtomicBool>, reply: F) -> Self
    where
        F: FnOnce(Result<MadeEnvironments, Fault>) + Send + 'static,
    {
        Self { request, unwanted, reply: Some(Box::new(reply)) }
    }

    /// True while its client waits.
    pub fn is_wanted(&self) -> bool {
        !self.unwanted.load(Ordering::Acquire)
    }

    pub fn answer(mut self, result: Result<MadeEnvironments, Fault>) {
        if let Some(reply) = self.reply.take() {
            reply(result);
        }
    }
}

impl Drop for MakeJob {
    fn drop(&mut self) {
        if let Some(reply) = self.reply.take() {
            reply(Err(Fault::internal("environments were not made")));
        }
    }
}
