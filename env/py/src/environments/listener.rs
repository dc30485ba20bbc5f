//! What the servers of environments and of policies share.

use graspbox_server::RunningServer;
use pyo3::PyClass;
use pyo3::prelude::*;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Time between two checks for signals.
const PATIENCE: Duration = Duration::from_millis(100);

/// A running server.
#[pyclass(frozen, subclass, module = "graspbox._core")]
pub struct Listener(Arc<dyn RunningServer>);

#[pymethods]
impl Listener {
    /// Host and port on which it listens.
    #[getter]
    fn address(&self) -> (String, u16) {
        (self.0.address().ip().to_string(), self.0.address().port())
    }

    /// Its counters, in the text format of OpenMetrics.
    fn metrics(&self) -> String {
        self.0.metrics()
    }

    /// Refuses new sessions, connections and HTTP requests.
    fn drain(&self) {
        self.0.drain();
    }

    /// True while requests run or wait, or answers have not been written.
    #[getter]
    fn busy(&self) -> bool {
        self.0.is_busy()
    }

    /// Ends all sessions and connections, also busy ones.
    fn stop(&self, py: Python<'_>) {
        py.detach(|| self.0.stop());
        crate::log::emit(py);
    }
}

impl Listener {
    /// The Python object of a server.
    pub fn with<T, S>(core: Arc<T>, own: fn(Arc<T>) -> S) -> PyClassInitializer<S>
    where
        T: RunningServer + 'static,
        S: PyClass<BaseType = Self>,
    {
        PyClassInitializer::from(Self(Arc::clone(&core) as Arc<dyn RunningServer>)).add_subclass(own(core))
    }
}

/// What `next` returns when called with the time that it may wait, within `seconds`; signals are checked meanwhile.
pub fn wait_for<T: Send>(
    py: Python<'_>,
    seconds: f64,
    next: impl Fn(Duration) -> Option<T> + Sync,
) -> PyResult<Option<T>> {
    let until = Instant::now() + Duration::try_from_secs_f64(seconds).unwrap_or_default();
    loop {
        py.check_signals()?;
        crate::log::emit(py);
        let left = until.saturating_duration_since(Instant::now());
        let found = py.detach(|| next(left.min(PATIENCE)));
        if found.is_some() || left <= PATIENCE {
            return Ok(found);
        }
    }
}
