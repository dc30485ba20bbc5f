//! What changes in a session: its commands, its answers, its connection.

use crate::command::Request;
use crate::environment::{Arrival, Environment};
use crate::fault::Fault;
use crate::hub::Lease;
use bytes::Bytes;
use std::collections::VecDeque;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use tokio::sync::mpsc::UnboundedSender;

/// What a connection is to write.
#[derive(Clone, Debug)]
pub enum Outgoing {
    /// A frame.
    Frame(Bytes),
    /// The session is over, and why.
    Close(&'static str),
}

/// A command that waits, or what is wrong with it; errors are answered in order too.
pub type Waiting = (Option<u64>, Result<Request, Fault>);

/// What changes in a session.
#[derive(Default)]
pub struct State {
    /// The environments; none before they are made.
    pub environment: Option<Arc<Environment>>,
    /// Their number, taken off those that are left.
    pub lease: Option<Lease>,
    /// Commands that wait.
    pub waiting: VecDeque<Waiting>,
    /// Set to stop the command that runs; none where none does.
    pub running: Option<Arc<AtomicBool>>,
    /// Environments of `send` that came back.
    pub arrivals: VecDeque<Arrival>,
    /// The last command that came in.
    pub received: u64,
    /// Answers that the client has not acknowledged, where it may come back.
    pub kept: VecDeque<(u64, Bytes)>,
    /// Bytes handed to the connection and not written yet.
    pub unsent: usize,
    /// Number of the connection that is written to, and its queue.
    pub connection: Option<(u64, UnboundedSender<Outgoing>)>,
    /// How long the session waits for a lost connection.
    pub grace: Duration,
    /// What a client must know to take the session up again.
    pub secret: u64,
    /// When the connection was lost; none while there is one.
    pub lost: Option<Instant>,
    /// When the last command came or ended.
    pub used: Option<Instant>,
    /// The session is over.
    pub ended: bool,
}

/// Does a command; the answer as a frame.
type Work = Box<dyn FnOnce(&AtomicBool) -> Result<Vec<u8>, Fault> + Send>;

/// A command that takes time.
pub struct Job {
    /// Its number.
    pub id: u64,
    /// Set to stop it.
    pub stop: Arc<AtomicBool>,
    /// It takes less than a change of threads is worth.
    pub short: bool,
    /// It takes so long that steps of others must not wait for it.
    pub long: bool,
    /// What it does.
    pub work: Work,
}

impl Job {
    /// A command that `work` does.
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

/// Forgets answers that the client has.
pub fn acknowledge(state: &mut State, seen: u64) {
    while state.kept.front().is_some_and(|(id, _)| *id <= seen) {
        state.kept.pop_front();
    }
}

/// Stops what runs, and turns what waits into errors.
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

/// Ends a session, and why.
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
