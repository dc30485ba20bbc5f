//! Counters of a server, for Prometheus.

use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::{Histogram, exponential_buckets};
use prometheus_client::registry::Registry;
use std::collections::BTreeMap;
use std::fmt::Display;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Media type of [`Metrics::text`].
pub const OPENMETRICS: &str = "application/openmetrics-text; version=1.0.0; charset=utf-8";
/// Time between two lines of the log about refusals for the same reason.
const LOG_PAUSE: Duration = Duration::from_secs(1);

/// Log text of a reason.
fn log_text(reason: &str) -> &str {
    match reason {
        "token" => "it does not know the token",
        "origin" => "a browser page of its origin may not connect (--origin)",
        "connections" => "there are too many connections",
        "sessions" => "all sessions are in use (--max-sessions)",
        "environments" => "it asks for more environments than are left (--max-envs)",
        "queue" => "too many requests wait for a decision",
        "stopping" => "the server is stopping",
        other => other,
    }
}

/// Labels of a counter: one name.
type Named = Family<[(&'static str, &'static str); 1], Counter>;

/// Counters of a server.
pub struct Metrics {
    registry: Registry,
    /// Time of the last logged refusal and number of refusals not logged since then, by reason.
    logged: Mutex<BTreeMap<&'static str, (Option<Instant>, u64)>>,
    /// Open connections.
    pub connections: Gauge,
    /// Sessions with environments, or of policies.
    pub sessions: Gauge,
    pub environments: Gauge,
    /// Environment steps.
    pub steps: Counter,
    /// Bytes of received frames.
    pub received: Counter,
    /// Bytes of sent frames.
    pub sent: Counter,
    /// Refused connections and commands, by reason.
    pub refusals: Named,
    /// Commands that ended in an error.
    pub faults: Counter,
    /// Seconds per step of all environments of a session.
    pub step_seconds: Histogram,
    /// Seconds per decision of a policy.
    pub decision_seconds: Histogram,
}

impl Default for Metrics {
    fn default() -> Self {
        // From 10 us to 80 s.
        let buckets = || Histogram::new(exponential_buckets(1e-5, 2.0, 24));
        let mut registry = Registry::with_prefix("graspbox");
        let metrics = Self {
            connections: Gauge::default(),
            sessions: Gauge::default(),
            environments: Gauge::default(),
            steps: Counter::default(),
            received: Counter::default(),
            sent: Counter::default(),
            refusals: Named::default(),
            faults: Counter::default(),
            step_seconds: buckets(),
            decision_seconds: buckets(),
            registry: Registry::default(),
            logged: Mutex::default(),
        };
        registry.register("connections", "Open connections", metrics.connections.clone());
        registry.register("sessions", "Sessions", metrics.sessions.clone());
        registry.register("environments", "Environments", metrics.environments.clone());
        registry.register("steps", "Environment steps", metrics.steps.clone());
        registry.register("received_bytes", "Bytes of frames that came in", metrics.received.clone());
        registry.register("sent_bytes", "Bytes of frames that went out", metrics.sent.clone());
        registry.register("refusals", "Connections and commands refused, by reason", metrics.refusals.clone());
        registry.register("faults", "Commands that ended in an error", metrics.faults.clone());
        registry.register("step_seconds", "Seconds per step of a session", metrics.step_seconds.clone());
        registry.register("decision_seconds", "Seconds per decision", metrics.decision_seconds.clone());
        Self { registry, ..metrics }
    }
}

impl Metrics {
    /// Counts and logs a refusal; logs at most one per second and reason.
    ///
    /// * `whom`: the address, or the session.
    pub fn refuse(&self, reason: &'static str, whom: &dyn Display) {
        self.refusals.get_or_create(&[("reason", reason)]).inc();
        let mut logged = self.logged.lock().unwrap_or_else(PoisonError::into_inner);
        let (last, unlogged) = logged.entry(reason).or_default();
        if last.is_some_and(|last| last.elapsed() < LOG_PAUSE) {
            *unlogged += 1;
            return;
        }
        match std::mem::take(unlogged) {
            0 => tracing::warn!("{whom} is refused: {}", log_text(reason)),
            more => tracing::warn!("{whom} is refused, after {more} others: {}", log_text(reason)),
        }
        *last = Some(Instant::now());
    }

    /// All counters in the text format of OpenMetrics.
    pub fn text(&self) -> String {
        let mut text = String::new();
        // Writing to a string does not fail.
        encode(&mut text, &self.registry).unwrap_or_default();
        text
    }
}
