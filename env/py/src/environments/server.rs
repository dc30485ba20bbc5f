//! `graspbox._core.EnvironmentListener`: an environment server.

use crate::convert::{read_config, to_python};
use crate::environments::env_pool::EnvPool;
use crate::environments::listener::{Listener, wait_for};
use crate::errors::CoreError;
use graspbox_server::pem::PemError;
use graspbox_server::server::Server as Core;
use graspbox_server::{Fault, MadeEnvironments, MakeJob, ServerConfig, ServerError};
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};

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
fn fault(error: graspbox_gym::EnvError) -> Fault {
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
#[pyclass(frozen, extends = Listener, module = "graspbox._core")]
pub struct EnvironmentListener(Arc<Core>);

#[pymethods]
impl EnvironmentListener {
    /// Starts a server; `offer` has the contents of the first frame besides protocol and limits.
    #[new]
    fn new(
        py: Python<'_>,
        settings: &Bound<'_, PyAny>,
        offer: &Bound<'_, PyAny>,
    ) -> PyResult<PyClassInitializer<Self>> {
        let config: ServerConfig = read_config(settings, "ServerConfig")?;
        let offer: serde_json::Value = read_config(offer, "the offer")?;
        let core = py.detach(|| Core::start(config, &offer, fault)).map_err(CoreError::from)?;
        Ok(Listener::with(Arc::new(core), Self))
    }

    /// The next request for environments; None if none came within `seconds`.
    fn next_job(&self, py: Python<'_>, seconds: f64) -> PyResult<Option<Job>> {
        let job = wait_for(py, seconds, |wait| self.0.next_job(wait))?;
        Ok(job.map(|job| Job { request: job.request.clone(), job: Mutex::new(Some(job)) }))
    }
}

/// A request for environments: answer it once.
#[pyclass(frozen, module = "graspbox._core")]
pub struct Job {
    request: serde_json::Value,
    job: Mutex<Option<MakeJob>>,
}

#[pymethods]
impl Job {
    #[getter]
    fn request<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        to_python(py, &self.request)
    }

    /// Passes the environments to the client; without a `picture` they are not rendered.
    fn accept(
        &self,
        pool: &EnvPool,
        weights: Vec<f64>,
        picture: Option<&Bound<'_, PyAny>>,
        description: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let picture = picture.map(|picture| read_config(picture, "PictureConfig")).transpose()?;
        let description = read_config(description, "the description")?;
        let made = MadeEnvironments { pool: Arc::clone(&pool.core), weights, picture, description };
        self.answer(Ok(made));
        Ok(())
    }

    /// Sends the client an error instead; `kind` is the name of a class in `graspbox.errors`.
    fn refuse(&self, kind: String, field: String, message: String) {
        self.answer(Err(Fault { kind, field, message, ..Fault::default() }));
    }
}

impl Job {
    fn answer(&self, result: Result<MadeEnvironments, Fault>) {
        if let Some(job) = self.job.lock().unwrap_or_else(PoisonError::into_inner).take() {
            job.answer(result);
        }
    }
}
