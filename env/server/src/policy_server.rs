//! Policy server for openpi's clients: metadata first, then observations in and actions out.
//!
//! Deciders take [`PolicyJob`]s from the queue. Connections wait for decisions without a thread, and continue to answer pings.

use crate::config::{MAX_UNUSED_POLICY, PING, SESSION_OVER, SPARE_CONNECTIONS, ServerConfig, WRITE_TIMEOUT};
use crate::error::ServerError;
use crate::gate::Gate;
use crate::listener;
use crate::metrics::Metrics;
use crate::server::{RunningServer, check, counters, io_runtime, refused, shut_down};
use crate::serving::connection::{refuse, write};
use crate::wire::encode::Encoder;
use crate::wire::fault::Fault;
use axum::body::{Body, to_bytes};
use axum::extract::ws::{CloseFrame, Message, WebSocket, WebSocketUpgrade};
use axum::extract::{DefaultBodyLimit, State};
use axum::http::header::CONTENT_TYPE;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Extension, Router};
use bytes::Bytes;
use std::collections::VecDeque;
use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tokio::net::TcpListener;
use tokio::runtime::Runtime;
use tokio::sync::{Semaphore, oneshot};
use tokio::time::{interval, timeout};

/// Most waiting requests; more are refused.
const MAX_QUEUED: usize = 1024;
/// Most waiting frames of a connection.
const MAX_BEHIND: usize = 8;

/// Transport of a request and its answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transport {
    /// A frame of msgpack.
    Frame,
    /// The body of a POST, JSON.
    Json,
}

/// A request for a decision, to be answered once; dropping it is an error.
pub struct PolicyJob {
    pub form: Transport,
    /// The frame, or the body.
    pub body: Bytes,
    /// Number of its connection; 0 for a POST.
    pub connection: u64,
    /// Time of its arrival.
    pub since: Instant,
    reply: Option<oneshot::Sender<Result<Vec<u8>, Fault>>>,
}

impl PolicyJob {
    /// Answers it with a frame, or JSON.
    pub fn answer(mut self, result: Result<Vec<u8>, Fault>) {
        if let Some(reply) = self.reply.take() {
            // A disconnected client needs no answer.
            drop(reply.send(result));
        }
    }
}

/// The answer to a request, once there is one; an error if the request is dropped.
type Reply = oneshot::Receiver<Result<Vec<u8>, Fault>>;

/// State shared by connections and deciders.
struct PolicyState {
    gate: Gate,
    metadata: Bytes,
    metrics: Arc<Metrics>,
    max_message: usize,
    /// Seconds without a request after which a connection ends.
    idle_timeout: f64,
    slots: Arc<Semaphore>,
    draining: AtomicBool,
    connections: AtomicU64,
    queue: Mutex<VecDeque<PolicyJob>>,
    /// Requests whose answers have not been written.
    unanswered: AtomicUsize,
    /// Connections ended since the last query.
    gone: Mutex<Vec<u64>>,
    arrived: Condvar,
}

impl PolicyState {
    fn queue(&self) -> MutexGuard<'_, VecDeque<PolicyJob>> {
        self.queue.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn submit(&self, form: Transport, body: Bytes, connection: u64) -> Reply {
        let (reply, result) = oneshot::channel();
        self.metrics.received.inc_by(body.len() as u64);
        let mut queue = self.queue();
        if queue.len() < MAX_QUEUED {
            queue.push_back(PolicyJob { form, body, connection, since: Instant::now(), reply: Some(reply) });
            self.arrived.notify_one();
        } else {
            self.metrics.refuse("queue", &format_args!("connection {connection}"));
        }
        result
    }

    /// The answer to a dropped request.
    fn lost() -> Fault {
        Fault::config("", "this server has too many requests, or is stopping; try again later")
    }
}

/// A request from its arrival until its answer is written, or its client is disconnected.
struct Unanswered(Arc<PolicyState>);

impl Unanswered {
    fn new(state: &Arc<PolicyState>) -> Self {
        state.unanswered.fetch_add(1, Ordering::AcqRel);
        Self(Arc::clone(state))
    }
}

impl Drop for Unanswered {
    fn drop(&mut self) {
        self.0.unanswered.fetch_sub(1, Ordering::AcqRel);
    }
}

/// A running policy server.
pub struct PolicyServer {
    runtime: Mutex<Option<Runtime>>,
    state: Arc<PolicyState>,
    address: SocketAddr,
}

impl PolicyServer {
    /// Starts a server.
    ///
    /// * `metadata`: the first frame of a connection: a JSON object.
    ///
    /// # Errors
    /// As [`crate::Server::start`].
    pub fn start(config: &ServerConfig, metadata: &serde_json::Value) -> Result<Self, ServerError> {
        check(config)?;
        let tls = listener::tls(config)?;
        let runtime = io_runtime(1)?;
        let (listener, address) = listener::bind(&runtime, config)?;
        let mut frame = Encoder::default();
        frame.json(metadata);
        let most = config.max_sessions + SPARE_CONNECTIONS;
        let state = Arc::new(PolicyState {
            gate: Gate::new(config.token.as_deref(), &config.origins),
            metadata: frame.into_bytes().into(),
            metrics: Arc::default(),
            max_message: config.max_message,
            idle_timeout: config.idle_timeout,
            slots: Arc::new(Semaphore::new(config.max_sessions)),
            draining: AtomicBool::new(false),
            connections: AtomicU64::new(1),
            queue: Mutex::default(),
            unanswered: AtomicUsize::new(0),
            gone: Mutex::default(),
            arrived: Condvar::new(),
        });
        spawn(&runtime, listener, tls, Arc::clone(&state), most);
        Ok(Self { runtime: Mutex::new(Some(runtime)), state, address })
    }

    /// The next requests, at most `most`; none if none come within `wait`.
    pub fn next_jobs(&self, most: usize, wait: Duration) -> Vec<PolicyJob> {
        let queue = self.state.queue();
        let (mut queue, _) = self
            .state
            .arrived
            .wait_timeout_while(queue, wait, |queue| queue.is_empty())
            .unwrap_or_else(PoisonError::into_inner);
        let mut jobs = Vec::new();
        while jobs.len() < most {
            let Some(job) = queue.pop_front() else { break };
            // A disconnected client needs no decision.
            if job.reply.as_ref().is_some_and(|reply| !reply.is_closed()) {
                jobs.push(job);
            }
        }
        jobs
    }

    /// Connections ended since the last call.
    pub fn gone(&self) -> Vec<u64> {
        std::mem::take(&mut *self.state.gone.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Counts a decision.
    pub fn decided(&self, seconds: f64) {
        self.state.metrics.steps.inc();
        self.state.metrics.decision_seconds.observe(seconds);
    }
}

impl RunningServer for PolicyServer {
    fn address(&self) -> SocketAddr {
        self.address
    }

    fn metrics(&self) -> String {
        self.state.metrics.text()
    }

    fn drain(&self) {
        self.state.draining.store(true, Ordering::Release);
    }

    fn is_busy(&self) -> bool {
        self.state.unanswered.load(Ordering::Acquire) > 0
    }

    fn stop(&self) {
        self.drain();
        self.state.queue().clear();
        shut_down(&self.runtime);
    }
}

impl Drop for PolicyServer {
    fn drop(&mut self) {
        self.stop();
    }
}

fn spawn(
    runtime: &Runtime,
    listener: TcpListener,
    tls: Option<tokio_rustls::TlsAcceptor>,
    state: Arc<PolicyState>,
    most: usize,
) {
    let metrics = Arc::clone(&state.metrics);
    let router = Router::new()
        .route("/", get(connect))
        .route("/grasps", post(decide))
        .route("/healthz", get(health))
        .route("/metrics", get(count))
        .layer(DefaultBodyLimit::max(state.max_message))
        .with_state(state);
    runtime.spawn(listener::accept(listener, tls, router, most, move || Arc::clone(&metrics)));
}

async fn health(State(state): State<Arc<PolicyState>>) -> (StatusCode, &'static str) {
    if state.draining.load(Ordering::Acquire) {
        (StatusCode::SERVICE_UNAVAILABLE, "stopping\n")
    } else {
        (StatusCode::OK, "OK\n")
    }
}

async fn count(
    State(state): State<Arc<PolicyState>>,
    Extension(peer): Extension<SocketAddr>,
    headers: HeaderMap,
) -> Response {
    match state.gate.admits(&headers) {
        Ok(()) => counters(&state.metrics),
        Err(reason) => refused(&state.metrics, reason, peer),
    }
}

/// POST: JSON in, JSON out.
///
/// The handler reads the body: an extractor would read it before the token is checked, and without a timeout.
async fn decide(
    State(state): State<Arc<PolicyState>>,
    Extension(peer): Extension<SocketAddr>,
    headers: HeaderMap,
    body: Body,
) -> Response {
    if let Err(reason) = state.gate.admits(&headers) {
        return refused(&state.metrics, reason, peer);
    }
    if state.draining.load(Ordering::Acquire) {
        return json(StatusCode::SERVICE_UNAVAILABLE, fault_body(&PolicyState::lost()));
    }
    // A page of another origin could send a plain form without a preflight request.
    if headers.get(CONTENT_TYPE).is_none_or(|kind| !kind.as_bytes().starts_with(b"application/json")) {
        return (StatusCode::UNSUPPORTED_MEDIA_TYPE, "send JSON: Content-Type: application/json\n").into_response();
    }
    let read = timeout(Duration::from_secs(WRITE_TIMEOUT), to_bytes(body, state.max_message)).await;
    let Ok(Ok(body)) = read else {
        return (StatusCode::PAYLOAD_TOO_LARGE, "the body is too large, or comes too slowly\n").into_response();
    };
    let unanswered = Unanswered::new(&state);
    let result = state.submit(Transport::Json, body, 0).await;
    let (status, bytes) = match result {
        Ok(Ok(bytes)) => (StatusCode::OK, bytes),
        Ok(Err(fault)) => {
            state.metrics.faults.inc();
            let status = match fault.kind.as_str() {
                "InternalError" => StatusCode::INTERNAL_SERVER_ERROR,
                _ => StatusCode::BAD_REQUEST,
            };
            (status, fault_body(&fault))
        }
        Err(_) => (StatusCode::SERVICE_UNAVAILABLE, fault_body(&PolicyState::lost())),
    };
    state.metrics.sent.inc_by(bytes.len() as u64);
    drop(unanswered);
    json(status, bytes)
}

fn json(status: StatusCode, body: Vec<u8>) -> Response {
    (status, [(CONTENT_TYPE, "application/json")], body).into_response()
}

fn fault_body(fault: &Fault) -> Vec<u8> {
    let error = serde_json::json!({"type": fault.kind, "field": fault.field, "message": fault.message});
    serde_json::json!({ "error": error }).to_string().into_bytes()
}

async fn connect(
    State(state): State<Arc<PolicyState>>,
    Extension(peer): Extension<SocketAddr>,
    headers: HeaderMap,
    upgrade: WebSocketUpgrade,
) -> Response {
    if let Err(reason) = state.gate.admits(&headers) {
        return refused(&state.metrics, reason, peer);
    }
    let free = !state.draining.load(Ordering::Acquire);
    let Some(slot) = Arc::clone(&state.slots).try_acquire_owned().ok().filter(|_| free) else {
        state.metrics.refuse(if free { "sessions" } else { "stopping" }, &peer);
        return (StatusCode::SERVICE_UNAVAILABLE, "this server takes no more clients; try again later\n")
            .into_response();
    };
    let most = state.max_message;
    upgrade.max_message_size(most).max_frame_size(most).protocols(["graspbox"]).on_upgrade(move |socket| async move {
        state.metrics.sessions.inc();
        let number = state.connections.fetch_add(1, Ordering::Relaxed);
        tracing::info!("connection {number} begins, of {peer}");
        serve(socket, &state, number).await;
        tracing::info!("connection {number} ends");
        state.gone.lock().unwrap_or_else(PoisonError::into_inner).push(number);
        state.metrics.sessions.dec();
        drop(slot);
    })
}

/// Serves a client: one request at a time; pings are answered meanwhile.
async fn serve(mut socket: WebSocket, state: &Arc<PolicyState>, number: u64) {
    if !write(&mut socket, Message::Binary(state.metadata.clone())).await {
        return;
    }
    let mut behind: VecDeque<(Bytes, Unanswered)> = VecDeque::new();
    let mut deciding: Option<(Reply, Unanswered)> = None;
    let mut pings = interval(Duration::from_secs(PING));
    pings.reset();
    // A client without requests would occupy the place of another.
    let (mut heard, mut longest) = (Instant::now(), Duration::from_secs(PING * MAX_UNUSED_POLICY));
    loop {
        if deciding.is_none() {
            deciding = behind.pop_front().map(|(frame, own)| (state.submit(Transport::Frame, frame, number), own));
        }
        tokio::select! {
            result = decision(&mut deciding) => {
                let unanswered = deciding.take();
                let message = match result {
                    Ok(frame) => Message::Binary(frame.into()),
                    Err(fault) => {
                        state.metrics.faults.inc();
                        Message::Text(fault.message.into())
                    }
                };
                if !write(&mut socket, message).await {
                    return;
                }
                drop(unanswered);
            }
            message = socket.recv(), if behind.len() < MAX_BEHIND => match message {
                Some(Ok(Message::Binary(frame))) => {
                    (heard, longest) = (Instant::now(), Duration::from_secs_f64(state.idle_timeout));
                    behind.push_back((frame, Unanswered::new(state)));
                }
                Some(Ok(Message::Text(_))) => {
                    let wrong = "observations are binary frames of msgpack; this frame is text";
                    if !write(&mut socket, Message::Text(wrong.into())).await {
                        return;
                    }
                }
                Some(Ok(Message::Ping(_) | Message::Pong(_))) => {}
                Some(Err(error)) => return refuse(&mut socket, &error, state.max_message).await,
                Some(Ok(Message::Close(_))) | None => return,
            },
            _ = pings.tick() => {
                if deciding.is_none() && heard.elapsed() > longest {
                    let reason = format!("no request in {} s", longest.as_secs());
                    write(&mut socket, Message::Close(Some(CloseFrame { code: SESSION_OVER, reason: reason.into() }))).await;
                    return;
                }
                if !write(&mut socket, Message::Ping(Bytes::new())).await {
                    return;
                }
            },
        }
    }
}

/// The awaited decision; never resolves if there is none.
async fn decision(deciding: &mut Option<(Reply, Unanswered)>) -> Result<Vec<u8>, Fault> {
    match deciding {
        Some((reply, _)) => reply.await.unwrap_or_else(|_| Err(PolicyState::lost())),
        None => std::future::pending().await,
    }
}
