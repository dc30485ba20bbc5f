//! `graspbox._core.PolicyListener`: a policy server.

use crate::convert::read_config;
use crate::environments::frames::{to_python, write};
use crate::environments::listener::{Listener, wait_for};
use crate::errors::CoreError;
use graspbox_server::policy_server::PolicyServer as Core;
use graspbox_server::{Encoder, Fault, PolicyJob as CoreJob, ServerConfig, Transport, decode};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

/// A running policy server; `next_jobs` returns its requests.
#[pyclass(frozen, extends = Listener, module = "graspbox._core")]
pub struct PolicyListener(Arc<Core>);

#[pymethods]
impl PolicyListener {
    /// Starts a server; `metadata` is the first frame of a connection.
    #[new]
    fn new(
        py: Python<'_>,
        settings: &Bound<'_, PyAny>,
        metadata: &Bound<'_, PyAny>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let config: ServerConfig = read_config(settings, "ServerConfig")?;
        let metadata: serde_json::Value = read_config(metadata, "the metadata")?;
        let core = py.detach(|| Core::start(&config, &metadata)).map_err(CoreError::from)?;
        Ok(Listener::with(Arc::new(core), Self))
    }

    /// The next requests, at most `most`; an empty list if none came within `seconds`.
    fn next_jobs(&self, py: Python<'_>, most: usize, seconds: f64) -> PyResult<Vec<PolicyJob>> {
        let jobs = wait_for(py, seconds, |wait| Some(self.0.next_jobs(most, wait)).filter(|jobs| !jobs.is_empty()))?;
        Ok(jobs.into_iter().flatten().map(PolicyJob::new).collect())
    }

    /// Numbers of the connections ended since the last call.
    fn gone(&self) -> Vec<u64> {
        self.0.gone()
    }

    /// Counts a decision.
    fn decided(&self, seconds: f64) {
        self.0.decided(seconds);
    }
}

/// A request for a decision: answer it once.
#[pyclass(frozen, module = "graspbox._core")]
pub struct PolicyJob {
    /// Number of its connection; 0 for a POST.
    #[pyo3(get)]
    connection: u64,
    /// True if it came as JSON.
    #[pyo3(get)]
    json: bool,
    since: Instant,
    job: Mutex<Option<CoreJob>>,
}

#[pymethods]
impl PolicyJob {
    /// The body of a POST, bytes.
    fn body<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let job = self.job.lock().unwrap_or_else(PoisonError::into_inner);
        let body = job.as_ref().ok_or_else(answered)?.body.clone();
        Ok(PyBytes::new(py, &body))
    }

    /// The observation of a frame: arrays are numpy arrays.
    fn observation<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let body = {
            let job = self.job.lock().unwrap_or_else(PoisonError::into_inner);
            job.as_ref().ok_or_else(answered)?.body.clone()
        };
        let value = decode(&body).map_err(|error| CoreError::Config(error.to_string()))?;
        to_python(py, &value, None)
    }

    /// Seconds since it arrived.
    #[getter]
    fn age(&self) -> f64 {
        self.since.elapsed().as_secs_f64()
    }

    /// Answers a frame with a dictionary.
    fn answer(&self, value: &Bound<'_, PyAny>) -> PyResult<()> {
        let mut frame = Encoder::default();
        write(&mut frame, value, "the answer", 0)?;
        self.reply(Ok(frame.into_bytes()));
        Ok(())
    }

    /// Answers a POST with JSON text.
    fn answer_json(&self, text: &str) {
        self.reply(Ok(text.as_bytes().to_vec()));
    }

    /// Sends the client an error instead of a decision; `kind` is the name of a class in `graspbox.errors`, `field` an entry of the request.
    fn refuse(&self, kind: String, field: String, message: String) {
        self.reply(Err(Fault { kind, field, message, ..Fault::default() }));
    }
}

impl PolicyJob {
    fn new(job: CoreJob) -> Self {
        let (connection, json, since) = (job.connection, job.form == Transport::Json, job.since);
        Self { connection, json, since, job: Mutex::new(Some(job)) }
    }

    fn reply(&self, result: Result<Vec<u8>, Fault>) {
        if let Some(job) = self.job.lock().unwrap_or_else(PoisonError::into_inner).take() {
            job.answer(result);
        }
    }
}

fn answered() -> CoreError {
    CoreError::Config("this request has been answered already".to_owned())
}
