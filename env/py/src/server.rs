//! `graspbox._core.Server`: environments for clients on other machines.

use crate::convert::config;
use crate::env_pool::EnvPool;
use crate::errors::CoreError;
use graspbox_server::server::Server as Core;
use graspbox_server::{Fault, Made, MakeJob, ServerConfig, ServerError};
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Time between two checks for signals.
const PATIENCE: Duration = Duration::from_millis(100);

impl From<ServerError> for CoreError {
    fn from(error: ServerError) -> Self {
        Self::Config(error.to_string())
    }
}

/// What a client is told of an error of environments.
fn fault(error: graspbox_agent::AgentError) -> Fault {
    let error = CoreError::from(error);
    match error {
        CoreError::Interrupted => Fault::interrupted(),
        other => Fault { kind: other.kind().to_owned(), field: String::new(), message: other.to_string() },
    }
}

/// A server that runs; requests for environments come out of `next_job`.
#[pyclass(frozen, module = "graspbox._core")]
pub struct Server(Core);

#[pymethods]
impl Server {
    /// Starts a server; `settings` and `offer` (what the first frame tells beside protocol and limits) are JSON.
    #[new]
    fn new(py: Python<'_>, settings: &str, offer: &str) -> PyResult<Self> {
        let config: ServerConfig = config(settings, "ServerConfig")?;
        let offer: serde_json::Value = crate::convert::config(offer, "the offer")?;
        Ok(Self(py.detach(|| Core::start(config, &offer, fault)).map_err(CoreError::from)?))
    }

    /// Host and port that it listens at.
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

    /// No session begins any more.
    fn drain(&self) {
        self.0.drain();
    }

    /// True while commands run.
    #[getter]
    fn busy(&self) -> bool {
        self.0.is_busy()
    }

    /// Ends all sessions; running commands are waited for with `patient`, 10 s at most.
    fn stop(&self, py: Python<'_>, patient: bool) {
        py.detach(|| self.0.stop(|| patient));
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
    /// Hands over the environments; `picture` (None: they are not rendered) and `description` are JSON.
    fn accept(&self, pool: &EnvPool, weights: Vec<f64>, picture: Option<&str>, description: &str) -> PyResult<()> {
        let picture = picture.map(|text| config(text, "PictureConfig")).transpose()?;
        let description = config(description, "the description")?;
        let made = Made { pool: Arc::clone(&pool.core), weights, picture, description };
        self.answer(Ok(made));
        Ok(())
    }

    /// Tells the client why there are none: `kind` is the name of a class in `graspbox.errors`.
    fn refuse(&self, kind: String, field: String, message: String) {
        self.answer(Err(Fault { kind, field, message }));
    }
}

impl Job {
    fn answer(&self, result: Result<Made, Fault>) {
        if let Some(job) = self.job.lock().unwrap_or_else(PoisonError::into_inner).take() {
            job.answer(result);
        }
    }
}
