//! What a server counts, for Prometheus.

use prometheus_client::encoding::text::encode;
use prometheus_client::metrics::counter::Counter;
use prometheus_client::metrics::family::Family;
use prometheus_client::metrics::gauge::Gauge;
use prometheus_client::metrics::histogram::{Histogram, exponential_buckets};
use prometheus_client::registry::Registry;

/// Labels of a counter: one name.
type Named = Family<[(&'static str, &'static str); 1], Counter>;

/// What a server counts.
pub struct Metrics {
    registry: Registry,
    /// Open connections.
    pub connections: Gauge,
    /// Sessions with environments, or of policies.
    pub sessions: Gauge,
    /// Environments.
    pub environments: Gauge,
    /// Environment steps.
    pub steps: Counter,
    /// Bytes of frames that came in.
    pub received: Counter,
    /// Bytes of frames that went out.
    pub sent: Counter,
    /// Connections and commands that were refused, by reason.
    pub refusals: Named,
    /// Commands that ended in an error.
    pub faults: Counter,
    /// Seconds that a step of all environments of a session took.
    pub step_seconds: Histogram,
    /// Seconds that a decision of a policy took, from the first request of a batch.
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
        registry.register("decision_seconds", "Seconds per batch of decisions", metrics.decision_seconds.clone());
        Self { registry, ..metrics }
    }
}

impl Metrics {
    /// Counts a refusal.
    pub fn refuse(&self, reason: &'static str) {
        self.refusals.get_or_create(&[("reason", reason)]).inc();
    }

    /// All of it in the text format of OpenMetrics.
    pub fn text(&self) -> String {
        let mut text = String::new();
        // Writing to a string does not fail.
        encode(&mut text, &self.registry).unwrap_or_default();
        text
    }
}
