//! Mutable state of a session: its commands, its answers, its connection.

use crate::serving::environment::{Arrival, Environment};
use crate::serving::hub::Lease;
use crate::wire::command::Request;
use crate::wire::fault::Fault;
use bytes::Bytes;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use tokio::sync::mpsc::UnboundedSender;

/// Output of a connection.
#[derive(Clone, Debug)]
pub enum Outgoing {
    Frame(Bytes),
    /// The end of the session, with the reason.
    Close(&'static str),
}

/// A waiting command, or the error of an invalid one; errors are answered in order too.
pub type Waiting = (Option<u64>, Result<Request, Fault>);

/// Mutable state of a session.
#[derive(Default)]
pub struct State {
    /// The environments; none before they are made.
    pub environment: Option<Arc<Environment>>,
    /// Their reservation.
    pub lease: Option<Lease>,
    /// Waiting commands.
    pub waiting: VecDeque<Waiting>,
    /// Set to stop the running command; none if none runs.
    pub running: Option<Arc<AtomicBool>>,
    /// Environments of `send` whose step has ended.
    pub arrivals: VecDeque<Arrival>,
    /// The last received command.
    pub received: u64,
    /// Unacknowledged answers, if the client may resume.
    pub kept: VecDeque<(u64, Bytes)>,
    /// Bytes queued on the connection and not written yet.
    pub unsent: usize,
    /// Number of the current connection, and its queue.
    pub connection: Option<(u64, UnboundedSender<Outgoing>)>,
    /// Time for which the session waits for a lost connection.
    pub grace: Duration,
    /// Secret with which a client resumes the session.
    pub secret: u64,
    /// Time at which the connection was lost; none while there is one.
    pub lost: Option<Instant>,
    /// Time at which the last command arrived or ended.
    pub used: Option<Instant>,
    /// The session is over.
    pub ended: bool,
}

/// Executes a command; the answer as a frame.
type Work = Box<dyn FnOnce(&AtomicBool) -> Result<Vec<u8>, Fault> + Send>;

/// A long command.
pub struct Job {
    pub id: u64,
    /// Set to stop it.
    pub stop: Arc<AtomicBool>,
    /// It takes less time than a change of threads.
    pub short: bool,
    /// It is so slow that steps of other sessions must not wait for it.
    pub long: bool,
    pub work: Work,
}

impl Job {
    /// A command executed by `work`.
    pub fn new<F>(id: u64, short: bool, work: F) -> Self
    where
        F: FnOnce(&AtomicBool) -> Result<Vec<u8>, Fault> + Send + 'static,
    {
        Self { id, stop: Arc::default(), short, long: false, work: Box::new(work) }
    }
}

/// The error of a command that needs environments.
pub fn nothing_made() -> Fault {
    Fault::config("command", "this session has no environments yet; begin with the command 'make'")
}

/// Drops acknowledged answers.
pub fn acknowledge(state: &mut State, seen: u64) {
    while state.kept.front().is_some_and(|(id, _)| *id <= seen) {
        state.kept.pop_front();
    }
}

/// Stops the running command, and turns waiting ones into errors.
pub fn cancel(state: &mut State) {
    if let Some(stop) = &state.running {
        stop.store(true, Ordering::Release);
    }
    if let Some(environment) = &state.environment {
        environment.pool.call_back();
    }
    for (_, request) in &mut state.waiting {
        *request = Err(Fault::interrupted());
    }
}

/// Ends a session with a reason.
pub fn end(state: &mut State, why: &'static str) {
    cancel(state);
    state.waiting.clear();
    state.kept.clear();
    state.arrivals.clear();
    state.ended = true;
    state.environment = None;
    state.lease = None;
    if let Some((_, connection)) = &state.connection {
        drop(connection.send(Outgoing::Close(why)));
    }
}
