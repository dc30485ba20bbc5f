//! A session: the environments of one client, its commands in order, and its answers until they are acknowledged.
//!
//! A session does not need its connection: it continues while the client is disconnected, and keeps unacknowledged answers.

use crate::config::{MAX_KEPT, MAX_UNSENT, MAX_WAITING};
use crate::serving::environment::{Arrival, Environment};
use crate::serving::hub::Hub;
use crate::serving::session_state::{Job, Outgoing, State, acknowledge, cancel, end, nothing_made};
use crate::wire::answer;
use crate::wire::command::{Command, Request};
use crate::wire::fault::Fault;
use bytes::Bytes;
use graspbox_gym::caught;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::runtime::Handle;
use tokio::sync::mpsc::UnboundedSender;

pub struct Session {
    pub id: u64,
    /// Address of the client that began it.
    pub peer: SocketAddr,
    pub(crate) hub: Arc<Hub>,
    state: Mutex<State>,
}

impl Session {
    /// A session without environments; clients resume it with `secret`.
    pub fn new(id: u64, secret: u64, peer: SocketAddr, hub: Arc<Hub>) -> Arc<Self> {
        let state = State { secret, used: Some(Instant::now()), ..State::default() };
        Arc::new(Self { id, peer, hub, state: Mutex::new(state) })
    }

    pub(crate) fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Switches to `connection`: answers after `seen` are resent.
    ///
    /// * `resumed`: number of the command that resumed the session, which is answered first.
    ///
    /// None if answers that the client needs are gone.
    pub fn attach(&self, connection: (u64, UnboundedSender<Outgoing>), seen: u64, resumed: Option<u64>) -> Option<()> {
        let mut state = self.lock();
        let state = &mut *state;
        acknowledge(state, seen);
        if state.ended || state.kept.front().is_some_and(|(first, _)| *first > seen + 1 && state.grace > Duration::ZERO)
        {
            return None;
        }
        if let Some((_, old)) = state.connection.take() {
            drop(old.send(Outgoing::Close("the session was taken up by another connection")));
        }
        state.unsent = 0;
        if let Some(id) = resumed {
            let mut frame = answer::begin(id, 1, 0);
            frame.text("received");
            frame.unsigned(state.received);
            drop(connection.1.send(Outgoing::Frame(frame.into_bytes().into())));
        }
        for (_, frame) in &state.kept {
            state.unsent += frame.len();
            drop(connection.1.send(Outgoing::Frame(frame.clone())));
        }
        state.connection = Some(connection);
        state.lost = None;
        Some(())
    }

    /// The connection `number` is lost. True if the session is over, because it cannot be resumed.
    pub fn detach(&self, number: u64) -> bool {
        let mut state = self.lock();
        if state.connection.as_ref().is_none_or(|(own, _)| *own != number) {
            return state.ended;
        }
        state.connection = None;
        state.unsent = 0;
        state.lost = Some(Instant::now());
        let over = state.ended || state.grace.is_zero();
        if !over {
            tracing::info!("session {} waits for its client, whose connection is lost", self.id);
        }
        over
    }

    /// True if `secret` is that of this session.
    pub fn knows(&self, secret: u64) -> bool {
        // Compared as hashes, in constant time.
        let hash = |number: u64| blake3::hash(&number.to_le_bytes());
        let state = self.lock();
        !state.grace.is_zero() && hash(state.secret) == hash(secret)
    }

    /// True if a client may send another command.
    pub fn has_room(&self) -> bool {
        self.lock().waiting.len() < MAX_WAITING
    }

    /// True once it has environments, or they are being made.
    pub fn is_made(&self) -> bool {
        self.lock().lease.is_some()
    }

    /// True while a command runs or waits, steps are pending, or answers have not been written.
    pub fn is_busy(&self) -> bool {
        let state = self.lock();
        let away = state.environment.as_ref().is_some_and(|environment| environment.pool.away() > 0);
        state.running.is_some() || !state.waiting.is_empty() || away || state.unsent > 0
    }

    /// True if its time limit without a client, or without a command, has passed.
    pub fn is_over(&self, idle: Duration) -> bool {
        let state = self.lock();
        let lost = state.lost.is_some_and(|since| since.elapsed() > state.grace);
        let unused = state.running.is_none() && state.used.is_some_and(|since| since.elapsed() > idle);
        state.ended || lost || unused
    }

    /// Queues a command, or the error of an invalid one.
    pub fn accept(self: &Arc<Self>, request: Result<Request, (Option<u64>, Fault)>) {
        let mut state = self.lock();
        let now = Instant::now();
        state.used = Some(now);
        let (id, request) = match request {
            Ok(request) => (Some(request.id), Ok(request)),
            Err((id, fault)) => (id, Err(fault)),
        };
        if let Some(id) = id {
            if !state.grace.is_zero() && id <= state.received {
                return; // It was resent after a lost connection, but had already arrived.
            }
            state.received = id;
        }
        if let Ok(Request { seen: Some(seen), .. }) = &request {
            acknowledge(&mut state, *seen);
        }
        if matches!(&request, Ok(Request { command: Command::Cancel, .. })) {
            cancel(&mut state);
        }
        state.waiting.push_back((id, request));
        drop(state);
        self.advance();
    }

    /// A frame of this many bytes was written.
    pub fn wrote(self: &Arc<Self>, bytes: usize) {
        let mut state = self.lock();
        let full = state.unsent > MAX_UNSENT;
        state.unsent = state.unsent.saturating_sub(bytes);
        let go_on = full && state.unsent <= MAX_UNSENT;
        drop(state);
        if go_on {
            self.advance();
        }
    }

    /// Begins as many of the next commands as possible.
    pub(crate) fn advance(self: &Arc<Self>) {
        loop {
            let job = self.next(&mut self.lock());
            let Some(job) = job else {
                return;
            };
            if job.short
                && let Some(others) = self.hub.begin_short()
            {
                // Another thread reads and writes meanwhile; a sleeping one has to be woken.
                if let (0, Ok(runtime)) = (others, Handle::try_current()) {
                    drop(runtime.spawn(async {}));
                }
                self.execute(job);
                self.hub.end_one();
                continue;
            }
            self.hub.begin_one();
            let session = Arc::clone(self);
            let pool = if job.long { &self.hub.background } else { &self.hub.pool };
            pool.spawn_fifo(move || {
                session.execute(job);
                session.hub.end_one();
                session.advance();
            });
            return;
        }
    }

    /// The next long command; short ones are answered at once.
    fn next(self: &Arc<Self>, state: &mut State) -> Option<Job> {
        while state.running.is_none() && !state.ended && state.unsent <= MAX_UNSENT {
            let job = match state.waiting.front()? {
                (_, Ok(Request { command: Command::Recv { count }, id, .. })) => {
                    let (count, id) = (*count, *id);
                    let awaited = self.awaited(state, count);
                    if matches!(awaited, Ok(None)) {
                        return None;
                    }
                    state.waiting.pop_front();
                    match awaited {
                        Ok(arrivals) => self.receive(state, id, arrivals.unwrap_or_default()),
                        Err(fault) => self.refuse(state, id, fault),
                    }
                }
                _ => match state.waiting.pop_front()? {
                    (_, Ok(request)) => self.begin(state, request),
                    (id, Err(fault)) => {
                        self.answer(state, id, Err(fault));
                        None
                    }
                },
            };
            if let Some(job) = job {
                state.running = Some(Arc::clone(&job.stop));
                return Some(job);
            }
        }
        None
    }

    /// Executes a job and answers.
    fn execute(&self, job: Job) {
        let result = caught(|| (job.work)(&job.stop), Fault::internal);
        let mut state = self.lock();
        state.running = None;
        state.used = Some(Instant::now());
        self.answer(&mut state, Some(job.id), result);
    }

    fn refuse(&self, state: &mut State, id: u64, fault: Fault) -> Option<Job> {
        self.answer(state, Some(id), Err(fault));
        None
    }

    /// The environments that a `recv` of `count` gets; none while their steps are pending.
    fn awaited(&self, state: &mut State, count: usize) -> Result<Option<Vec<Arrival>>, Fault> {
        let environment = state.environment.as_ref().ok_or_else(nothing_made)?;
        let away = environment.pool.away();
        if count == 0 || count > away {
            let message = format!("count is {count}; {away} steps are pending");
            return Err(Fault::config("count", message));
        }
        let failed = state.arrivals.iter().position(|(_, result)| result.is_err());
        if let Some(failed) = failed.filter(|failed| *failed < count) {
            return Ok(state.arrivals.remove(failed).map(|arrival| vec![arrival]));
        }
        Ok((state.arrivals.len() >= count).then(|| state.arrivals.drain(..count).collect()))
    }

    fn receive(self: &Arc<Self>, state: &mut State, id: u64, mut arrivals: Vec<Arrival>) -> Option<Job> {
        let environment = state.environment.clone()?;
        Some(Job::new(id, true, move |_| environment.received(id, &mut arrivals)))
    }

    fn begin(self: &Arc<Self>, state: &mut State, request: Request) -> Option<Job> {
        let id = request.id;
        match request.command {
            Command::Cancel => self.answer(state, Some(id), Ok(answer::begin(id, 0, 0).into_bytes())),
            Command::Close => {
                self.answer(state, Some(id), Ok(answer::begin(id, 0, 0).into_bytes()));
                self.close(state, "its client has closed it");
            }
            Command::Make { request, asked } => self.make(state, id, request, asked),
            command => match state.environment.clone() {
                None => self.answer(state, Some(id), Err(nothing_made())),
                Some(environment) => return Some(self.job(id, environment, command, request.shm)),
            },
        }
        None
    }

    fn job(self: &Arc<Self>, id: u64, environment: Arc<Environment>, command: Command, shm: bool) -> Job {
        let session = Arc::downgrade(self);
        let arrived = move |arrival: Arrival| {
            if let Some(session) = session.upgrade() {
                session.hub.metrics.steps.inc();
                session.lock().arrivals.push_back(arrival);
                session.advance();
            }
        };
        let hub = Arc::clone(&self.hub);
        let (short, long) = (environment.is_short(&command), matches!(command, Command::Prepare));
        let job = Job::new(id, short, move |stop| {
            let (steps, started) = (matches!(command, Command::Step { .. }), Instant::now());
            let frame = environment.run(id, command, shm, stop, arrived)?;
            if steps {
                hub.metrics.step_seconds.observe(started.elapsed().as_secs_f64());
                hub.metrics.steps.inc_by(environment.pool.len() as u64);
            }
            Ok(frame)
        });
        Job { long, ..job }
    }

    /// Answers once the environments are made, or have failed, and begins the next command.
    pub(crate) fn finish(self: &Arc<Self>, id: u64, frame: Result<Vec<u8>, Fault>) {
        let mut state = self.lock();
        state.running = None;
        state.used = Some(Instant::now());
        self.answer(&mut state, Some(id), frame);
        drop(state);
        self.advance();
    }

    pub(crate) fn answer(&self, state: &mut State, id: Option<u64>, frame: Result<Vec<u8>, Fault>) {
        let frame = frame.unwrap_or_else(|fault| {
            self.hub.metrics.faults.inc();
            answer::error(id, &fault)
        });
        let mut frame = frame;
        // Frames start with a capacity of 4 kB; most answers are shorter, and may be kept for long. A large one would be copied.
        if frame.capacity() > 2 * frame.len() {
            frame.shrink_to_fit();
        }
        let frame = Bytes::from(frame);
        if let Some(id) = id.filter(|_| !state.grace.is_zero()) {
            state.kept.push_back((id, frame.clone()));
            while state.kept.len() > MAX_KEPT
                || state.kept.len() > 1 && state.kept.iter().map(|(_, frame)| frame.len()).sum::<usize>() > MAX_UNSENT
            {
                state.kept.pop_front();
            }
        }
        if let Some((_, connection)) = &state.connection {
            state.unsent += frame.len();
            drop(connection.send(Outgoing::Frame(frame)));
        }
    }

    /// Ends the session; its environments are freed once the running command has ended.
    pub fn end(&self, why: &'static str) {
        self.close(&mut self.lock(), why);
    }

    fn close(&self, state: &mut State, why: &'static str) {
        if !state.ended && state.lease.is_some() {
            tracing::info!("session {} ends: {why}", self.id);
        }
        end(state, why);
    }
}
