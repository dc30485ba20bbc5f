//! `graspbox._core.Client`: a session on a server; `PolicyClient`: a connection to a policy server.

use crate::environments::frames::{to_python, write};
use crate::errors::CoreError;
use bytes::Bytes;
use graspbox_server::client::greet;
use graspbox_server::client_socket::{Incoming, Socket};
use graspbox_server::{Client as Core, ClientError, ClientOptions, CodecError, Encoder, decode, segment};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use std::fs::File;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

impl From<ClientError> for CoreError {
    fn from(error: ClientError) -> Self {
        match error {
            ClientError::Unreachable { .. } | ClientError::SessionLost { .. } => Self::Connection(error.to_string()),
            ClientError::Certificates(error) => error.into(),
            _ => Self::Config(error.to_string()),
        }
    }
}

/// A session on a server; concurrent calls run one at a time.
#[pyclass(frozen, module = "graspbox._core")]
pub struct Client {
    core: Mutex<Core>,
    /// Shared memory of the server, once opened.
    segment: OnceLock<File>,
}

#[pymethods]
impl Client {
    /// Connects; after a lost connection the client tries to resume the session for `grace` seconds.
    #[new]
    #[pyo3(signature = (url, *, token, ca, grace))]
    fn new(py: Python<'_>, url: &str, token: Option<String>, ca: Option<String>, grace: f64) -> PyResult<Self> {
        let options = ClientOptions { token, ca };
        let grace = Duration::try_from_secs_f64(grace).map_err(|_| {
            CoreError::Config(format!("grace is {grace}; give a number of seconds that is not negative"))
        })?;
        let made = py.detach(|| Core::connect(url, options, grace));
        Ok(Self { core: Mutex::new(made.map_err(CoreError::from)?), segment: OnceLock::new() })
    }

    /// The first frame of the server.
    #[getter]
    fn hello<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let frame = self.lock().hello().clone();
        to_python(py, &decode(&frame).map_err(|error| self.foreign(&error))?, None)
    }

    /// Sends a command with its fields; returns its number.
    fn submit(&self, py: Python<'_>, command: &str, fields: &Bound<'_, PyDict>) -> PyResult<u64> {
        let mut body = Encoder::default();
        for (key, value) in fields {
            let key = key.cast::<PyString>()?.to_cow()?.into_owned();
            body.text(&key);
            write(&mut body, &value, &key, 0)?;
        }
        let (count, body) = (fields.len(), body.into_bytes());
        let sent = py.detach(|| self.lock().submit(command, count, |frame| frame.append(&body)));
        Ok(sent.map_err(CoreError::from)?)
    }

    /// The answer to a command; None if it has not come within a tenth of a second.
    fn poll<'py>(&self, py: Python<'py>, id: u64) -> PyResult<Option<Bound<'py, PyAny>>> {
        let Some(frame) = py.detach(|| self.lock().poll(id)).map_err(CoreError::from)? else {
            return Ok(None);
        };
        let value = decode(&frame).map_err(|error| self.foreign(&error))?;
        to_python(py, &value, self.segment.get()).map(Some)
    }

    /// Seconds since the connection was lost; None while there is one.
    fn lost(&self) -> Option<f64> {
        self.lock().lost().map(|time| time.as_secs_f64())
    }

    /// Opens the shared memory named by the server.
    fn open_segment(&self, name: &str) -> PyResult<()> {
        let opened = segment::open(name).map_err(|error| {
            CoreError::Config(format!(
                "the shared memory of {} cannot be opened ({error}): the server must run on this machine, as the same user; \
                 leave shm out",
                self.lock().url()
            ))
        })?;
        self.segment.get_or_init(|| opened);
        Ok(())
    }

    /// Discards the answer to a command.
    fn forget(&self, id: u64) {
        self.lock().forget(id);
    }

    /// Breaks the connection, as a network failure would: for tests.
    #[pyo3(name = "_break_off")]
    fn break_off(&self) {
        self.lock().break_off();
    }
}

impl Client {
    /// The error of a frame outside the protocol.
    fn foreign(&self, error: &CodecError) -> CoreError {
        ClientError::Protocol { url: self.lock().url().to_owned(), why: error.to_string() }.into()
    }

    fn lock(&self) -> MutexGuard<'_, Core> {
        self.core.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A connection to a policy server, which speaks openpi's protocol.
#[pyclass(frozen, module = "graspbox._core")]
pub struct PolicyClient {
    socket: Mutex<Socket>,
    metadata: Bytes,
}

#[pymethods]
impl PolicyClient {
    /// Connects, and reads the metadata.
    #[new]
    #[pyo3(signature = (url, *, token, ca))]
    fn new(py: Python<'_>, url: &str, token: Option<String>, ca: Option<String>) -> PyResult<Self> {
        let options = ClientOptions { token, ca };
        let (socket, metadata) = py.detach(|| greet(url, &options)).map_err(CoreError::from)?;
        Ok(Self { socket: Mutex::new(socket), metadata })
    }

    /// The first frame of the server.
    #[getter]
    fn metadata<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        to_python(py, &decode(&self.metadata).map_err(|error| CoreError::Config(error.to_string()))?, None)
    }

    /// Sends an observation.
    fn send(&self, py: Python<'_>, observation: &Bound<'_, PyDict>) -> PyResult<()> {
        let mut frame = Encoder::default();
        write(&mut frame, observation.as_any(), "the observation", 0)?;
        let frame = Bytes::from(frame.into_bytes());
        Ok(py.detach(|| self.lock().send(frame)).map_err(CoreError::from)?)
    }

    /// Waits for the next answer: a dictionary, or text, which is an error of the server.
    fn receive<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        loop {
            py.check_signals()?;
            match py.detach(|| self.lock().receive()).map_err(CoreError::from)? {
                None => {}
                Some(Incoming::Text(text)) => return Ok(PyString::new(py, &text).into_any()),
                Some(Incoming::Frame(frame)) => {
                    let value = decode(&frame).map_err(|error| CoreError::Config(error.to_string()))?;
                    return to_python(py, &value, None);
                }
            }
        }
    }
}

impl PolicyClient {
    fn lock(&self) -> MutexGuard<'_, Socket> {
        self.socket.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
