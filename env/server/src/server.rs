//! Environment server: starts, drains, ends.

use crate::config::{MAX_WAITING, SPARE_CONNECTIONS, ServerConfig};
use crate::error::ServerError;
use crate::gate::Gate;
use crate::listener;
use crate::metrics::{Metrics, OPENMETRICS};
use crate::serving::connection;
use crate::serving::hub::{Hub, MakeJob};
use crate::serving::sessions::Sessions;
use crate::wire::command::COMMANDS;
use crate::wire::encode::Encoder;
use crate::wire::fault::Classify;
use crate::wire::value::{MAX_DEPTH, MAX_VALUES};
use axum::extract::State;
use axum::extract::ws::WebSocketUpgrade;
use axum::http::header::CONTENT_TYPE;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use axum::{Extension, Router};
use bytes::Bytes;
use graspbox_mesh::in_range;
use rayon::{ThreadPool, ThreadPoolBuilder};
use std::net::SocketAddr;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tokio::runtime::{Builder, Runtime};
use tokio::sync::Semaphore;
use tokio::time::interval;

/// Version of the protocol; it increases with every incompatible change.
pub const PROTOCOL: u64 = 1;
/// Threads that read and write, besides those that execute short commands.
const IO_THREADS: usize = 1;
/// Stack of a thread that steps environments, bytes: that of a main thread, since hull and tree code recurses.
const STACK: usize = 8 << 20;

/// A running server.
pub struct Server {
    runtime: Mutex<Option<Runtime>>,
    sessions: Arc<Sessions>,
    address: SocketAddr,
    makers: Mutex<Receiver<MakeJob>>,
}

/// State of the request handlers.
#[derive(Clone)]
struct HandlerState {
    sessions: Arc<Sessions>,
    gate: Arc<Gate>,
    hello: Bytes,
    slots: Arc<Semaphore>,
}

/// A running server of environments or of a policy; dropping it stops it.
pub trait RunningServer: Send + Sync {
    /// The address on which it listens.
    fn address(&self) -> SocketAddr;

    /// Its counters, in the text format of OpenMetrics.
    fn metrics(&self) -> String;

    /// Refuses new sessions, connections and HTTP requests.
    fn drain(&self);

    /// True while requests run or wait, or answers have not been written.
    fn is_busy(&self) -> bool;

    /// Ends everything, also running requests; to wait for them, poll [`RunningServer::is_busy`] after [`RunningServer::drain`].
    fn stop(&self);
}

impl Server {
    /// Starts a server.
    ///
    /// * `offer`: contents of the first frame besides the protocol and the limits: a JSON object.
    /// * `classify`: names the errors of environments.
    ///
    /// # Errors
    /// A setting out of range, an unusable address, or unusable TLS files.
    pub fn start(config: ServerConfig, offer: &serde_json::Value, classify: Classify) -> Result<Self, ServerError> {
        check(&config)?;
        let tls = listener::tls(&config)?;
        let pools = [workers(config.threads, "serve")?, workers(config.threads, "prepare")?];
        let runtime = io_runtime(config.threads)?;
        let (listener, bound) = listener::bind(&runtime, &config)?;
        let (sender, makers) = channel();
        let hub = Arc::new(Hub::new(config, pools, classify, sender));
        let sessions = Arc::new(Sessions::new(hub));
        let config = &sessions.hub.config;
        let state = HandlerState {
            gate: Arc::new(Gate::new(config.token.as_deref(), &config.origins)),
            hello: hello(config, offer),
            slots: Arc::new(Semaphore::new(config.max_sessions + SPARE_CONNECTIONS)),
            sessions: Arc::clone(&sessions),
        };
        let most = config.max_sessions + SPARE_CONNECTIONS;
        let hub = Arc::clone(&sessions.hub);
        runtime.spawn(listener::accept(listener, tls, router(state), most, move || Arc::clone(&hub.metrics)));
        let reaped = Arc::clone(&sessions);
        runtime.spawn(async move {
            let mut ticks = interval(Duration::from_secs(1));
            loop {
                ticks.tick().await;
                reaped.reap();
            }
        });
        Ok(Self { runtime: Mutex::new(Some(runtime)), sessions, address: bound, makers: Mutex::new(makers) })
    }

    /// The next request for environments; none if none comes within `wait`.
    pub fn next_job(&self, wait: Duration) -> Option<MakeJob> {
        let makers = self.makers.lock().unwrap_or_else(PoisonError::into_inner);
        let until = Instant::now() + wait;
        loop {
            let job = makers.recv_timeout(until.saturating_duration_since(Instant::now())).ok()?;
            // Requests of disconnected clients are dropped.
            if job.is_wanted() {
                return Some(job);
            }
        }
    }
}

impl RunningServer for Server {
    fn address(&self) -> SocketAddr {
        self.address
    }

    fn metrics(&self) -> String {
        self.sessions.hub.metrics.text()
    }

    fn drain(&self) {
        self.sessions.hub.draining.store(true, Ordering::Release);
    }

    /// True while commands run or wait, steps are pending, or answers have not been written.
    fn is_busy(&self) -> bool {
        self.sessions.are_busy()
    }

    fn stop(&self) {
        self.drain();
        self.sessions.end_all("the server is stopping");
        shut_down(&self.runtime);
    }
}

/// Ends a runtime, once.
pub fn shut_down(runtime: &Mutex<Option<Runtime>>) {
    if let Some(runtime) = runtime.lock().unwrap_or_else(PoisonError::into_inner).take() {
        // Connections get their last frame, with the reason.
        std::thread::sleep(Duration::from_millis(50));
        runtime.shutdown_timeout(Duration::from_secs(1));
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stop();
    }
}

/// Worker threads of the sessions.
fn workers(count: usize, what: &'static str) -> Result<ThreadPool, ServerError> {
    ThreadPoolBuilder::new()
        .num_threads(count)
        .stack_size(STACK)
        .thread_name(move |i| format!("graspbox-{what}-{i}"))
        .build()
        .map_err(|error| ServerError::Threads(error.to_string()))
}

/// The threads that read and write; `threads` of them may execute short commands at once.
///
/// # Errors
/// Threads that cannot be started.
pub fn io_runtime(threads: usize) -> Result<Runtime, ServerError> {
    Builder::new_multi_thread()
        .worker_threads(threads + IO_THREADS)
        .thread_name("graspbox-io")
        .enable_io()
        .enable_time()
        .build()
        .map_err(|error| ServerError::Threads(error.to_string()))
}

/// Checks every setting.
///
/// # Errors
/// The first setting out of range.
pub fn check(config: &ServerConfig) -> Result<(), ServerError> {
    in_range("max_envs", config.max_envs as f64, 1.0..=65_536.0, "")?;
    in_range("max_sessions", config.max_sessions as f64, 1.0..=10_000.0, "")?;
    in_range("max_message", config.max_message as f64, 65_536.0..=1e9, "bytes")?;
    in_range("idle_timeout", config.idle_timeout, 1.0..=1e6, "s")?;
    in_range("max_grace", config.max_grace, 0.0..=86_400.0, "s")?;
    Ok(in_range("threads", config.threads as f64, 1.0..=1024.0, "")?)
}

/// The first frame: protocol, version, limits, commands, and the offer.
fn hello(config: &ServerConfig, offer: &serde_json::Value) -> Bytes {
    let limits = serde_json::json!({
        "max_envs": config.max_envs,
        "max_sessions": config.max_sessions,
        "max_message": config.max_message,
        "idle_timeout": config.idle_timeout,
        "max_grace": config.max_grace,
        "waiting_commands": MAX_WAITING,
        "depth": MAX_DEPTH,
        "values": MAX_VALUES,
        "text": crate::wire::fields::MAX_TEXT,
    });
    let mut whole = serde_json::json!({
        "protocol": "graspbox",
        "protocol_version": PROTOCOL,
        "version": env!("CARGO_PKG_VERSION"),
        "commands": COMMANDS.iter().map(|(name, ..)| *name).collect::<Vec<_>>(),
        "limits": limits,
    });
    if let (Some(whole), Some(offer)) = (whole.as_object_mut(), offer.as_object()) {
        whole.extend(offer.clone());
    }
    let mut frame = Encoder::default();
    frame.json(&whole);
    frame.into_bytes().into()
}

fn router(state: HandlerState) -> Router {
    Router::new()
        .route("/", get(connect))
        .route("/healthz", get(health))
        .route("/metrics", get(metrics))
        .with_state(state)
}

async fn health(State(state): State<HandlerState>) -> (StatusCode, &'static str) {
    if state.sessions.hub.draining.load(Ordering::Acquire) {
        (StatusCode::SERVICE_UNAVAILABLE, "stopping\n")
    } else {
        (StatusCode::OK, "OK\n")
    }
}

async fn metrics(
    State(state): State<HandlerState>,
    Extension(peer): Extension<SocketAddr>,
    headers: HeaderMap,
) -> Response {
    let metrics = &state.sessions.hub.metrics;
    match state.gate.admits(&headers) {
        Ok(()) => counters(metrics),
        Err(reason) => refused(metrics, reason, peer),
    }
}

/// The page of counters.
pub fn counters(metrics: &Metrics) -> Response {
    ([(CONTENT_TYPE, OPENMETRICS)], metrics.text()).into_response()
}

/// Refuses a request for a reason that [`Gate::admits`] gave.
pub fn refused(metrics: &Metrics, reason: &'static str, peer: SocketAddr) -> Response {
    metrics.refuse(reason, &peer);
    match reason {
        "token" => (StatusCode::UNAUTHORIZED, "give the token of this server: Authorization: Bearer TOKEN\n"),
        _ => (StatusCode::FORBIDDEN, "this server does not take browser pages of this origin\n"),
    }
    .into_response()
}

async fn connect(
    State(state): State<HandlerState>,
    Extension(peer): Extension<SocketAddr>,
    headers: HeaderMap,
    upgrade: WebSocketUpgrade,
) -> Response {
    if let Err(reason) = state.gate.admits(&headers) {
        return refused(&state.sessions.hub.metrics, reason, peer);
    }
    let Ok(slot) = Arc::clone(&state.slots).try_acquire_owned() else {
        state.sessions.hub.metrics.refuse("connections", &peer);
        return (StatusCode::SERVICE_UNAVAILABLE, "this server has too many connections; try again later\n")
            .into_response();
    };
    let most = state.sessions.hub.config.max_message;
    let upgrade = upgrade.max_message_size(most).max_frame_size(most).protocols(["graspbox"]);
    upgrade.on_upgrade(move |socket| async move {
        let metrics = Arc::clone(&state.sessions.hub.metrics);
        metrics.connections.inc();
        connection::serve(socket, peer, state.sessions, state.hello).await;
        metrics.connections.dec();
        drop(slot);
    })
}
