//! `graspbox._core.Server`: an environment server.

use crate::convert::config;
use crate::environments::env_pool::EnvPool;
use crate::errors::CoreError;
use graspbox_server::pem::PemError;
use graspbox_server::server::Server as Core;
use graspbox_server::{Fault, Made, MakeJob, ServerConfig, ServerError};
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Time between two checks for signals.
const PATIENCE: Duration = Duration::from_millis(100);

impl From<ServerError> for CoreError {
    fn from(error: ServerError) -> Self {
        match error {
            ServerError::Pem(error) => error.into(),
            other => Self::Config(other.to_string()),
        }
    }
}

impl From<PemError> for CoreError {
    fn from(error: PemError) -> Self {
        match error {
            PemError::Unreadable { path, source } => Self::File { path: path.into(), source },
            PemError::Wrong { .. } => Self::Config(error.to_string()),
        }
    }
}

/// The message to a client about an error of environments.
fn fault(error: graspbox_agent::AgentError) -> Fault {
    let error = CoreError::from(error);
    match error {
        CoreError::Interrupted => Fault::interrupted(),
        other => {
            let object = match &other {
                CoreError::Object { name, .. } => name.clone(),
                _ => String::new(),
            };
            Fault { kind: other.kind().to_owned(), message: other.to_string(), object, ..Fault::default() }
        }
    }
}

/// A running server; `next_job` returns its requests for environments.
#[pyclass(frozen, module = "graspbox._core")]
pub struct Server(Core);

#[pymethods]
impl Server {
    /// Starts a server; `settings` and `offer` (contents of the first frame besides protocol and limits) are JSON.
    #[new]
    fn new(py: Python<'_>, settings: &str, offer: &str) -> PyResult<Self> {
        let config: ServerConfig = config(settings, "ServerConfig")?;
        let offer: serde_json::Value = crate::convert::config(offer, "the offer")?;
        Ok(Self(py.detach(|| Core::start(config, &offer, fault)).map_err(CoreError::from)?))
    }

    /// Host and port on which it listens.
    #[getter]
    fn address(&self) -> (String, u16) {
        (self.0.address().ip().to_string(), self.0.address().port())
    }

    /// The next request for environments; None if none came within `seconds`.
    fn next_job(&self, py: Python<'_>, seconds: f64) -> PyResult<Option<Job>> {
        let until = Instant::now() + Duration::try_from_secs_f64(seconds).unwrap_or_default();
        loop {
            py.check_signals()?;
            crate::log::emit(py);
            let left = until.saturating_duration_since(Instant::now());
            let job = py.detach(|| self.0.next_job(left.min(PATIENCE)));
            if job.is_some() || left <= PATIENCE {
                return Ok(job.map(|job| Job { request: job.request.to_string(), job: Mutex::new(Some(job)) }));
            }
        }
    }

    /// Its counters, in the text format of OpenMetrics.
    fn metrics(&self) -> String {
        self.0.metrics()
    }

    /// Refuses new sessions.
    fn drain(&self) {
        self.0.drain();
    }

    /// True while commands run or wait, steps are pending, or answers have not been written.
    #[getter]
    fn busy(&self) -> bool {
        self.0.is_busy()
    }

    /// Ends all sessions, also busy ones.
    fn stop(&self, py: Python<'_>) {
        py.detach(|| self.0.stop());
        crate::log::emit(py);
    }
}

/// A request for environments: answer it once.
#[pyclass(frozen, module = "graspbox._core")]
pub struct Job {
    /// The request, as JSON.
    #[pyo3(get)]
    request: String,
    job: Mutex<Option<MakeJob>>,
}

#[pymethods]
impl Job {
    /// Passes the environments to the client; `picture` (None: they are not rendered) and `description` are JSON.
    fn accept(&self, pool: &EnvPool, weights: Vec<f64>, picture: Option<&str>, description: &str) -> PyResult<()> {
        let picture = picture.map(|text| config(text, "PictureConfig")).transpose()?;
        let description = config(description, "the description")?;
        let made = Made { pool: Arc::clone(&pool.core), weights, picture, description };
        self.answer(Ok(made));
        Ok(())
    }

    /// Sends the client an error instead; `kind` is the name of a class in `graspbox.errors`.
    fn refuse(&self, kind: String, field: String, message: String) {
        self.answer(Err(Fault { kind, field, message, ..Fault::default() }));
    }
}

impl Job {
    fn answer(&self, result: Result<Made, Fault>) {
        if let Some(job) = self.job.lock().unwrap_or_else(PoisonError::into_inner).take() {
            job.answer(result);
        }
    }
}
