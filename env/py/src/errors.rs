//! Mapping of the core's errors to Python exceptions.
//!
//! The classes are defined in `graspbox.errors`, since Rust cannot give an exception two bases.

use graspbox_arm::ArmError;
use graspbox_episode::EpisodeError;
use graspbox_gym::EnvError;
use graspbox_gym::json::BadConfig;
use graspbox_hand::HandError;
use graspbox_mesh::MeshError;
use graspbox_perception::PerceptionError;
use graspbox_plan::PlanError;
use graspbox_render::RenderError;
use graspbox_sim::SimError;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;
use std::path::{Path, PathBuf};

/// Errors of a call into the core.
#[derive(Debug, thiserror::Error)]
pub enum CoreError {
    /// A configuration value or an argument is invalid.
    #[error("{0}")]
    Config(String),
    /// A file cannot be read or written.
    #[error("{source}: {path}")]
    File {
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// The mesh or its file is invalid.
    #[error("{0}")]
    Mesh(String),
    /// A hand's files are invalid.
    #[error("{0}")]
    Hand(String),
    /// An arm's files are invalid, or it cannot carry the hand.
    #[error("{0}")]
    Arm(String),
    /// Nothing can be planned for this object or hand.
    #[error("{0}")]
    Plan(String),
    /// The object cannot be simulated.
    #[error("{0}")]
    Simulation(String),
    /// A server cannot be reached, or the session on it is lost.
    #[error("{0}")]
    Connection(String),
    /// An object cannot be used; another one might.
    #[error("{error}")]
    Object { name: String, error: Box<CoreError> },
    /// The call was stopped by a signal.
    #[error("the call was interrupted")]
    Interrupted,
    /// A defect of graspbox.
    #[error("internal error, please report it together with the input: {0}")]
    Internal(String),
}

impl CoreError {
    /// Name of the class in `graspbox.errors` (for an interruption, Python's own).
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Config(_) => "ConfigError",
            Self::File { .. } => "FileError",
            Self::Mesh(_) => "MeshError",
            Self::Hand(_) => "HandError",
            Self::Arm(_) => "ArmError",
            Self::Plan(_) => "PlanError",
            Self::Simulation(_) => "SimulationError",
            Self::Connection(_) => "ConnectionLostError",
            Self::Object { error, .. } => error.kind(),
            Self::Interrupted => "KeyboardInterrupt",
            Self::Internal(_) => "InternalError",
        }
    }

    /// An error about the file at `path`, which the message names.
    pub fn in_file(error: MeshError, path: &Path) -> Self {
        match error {
            MeshError::UnknownFormat { .. } => error.into(),
            _ => Self::from(error).about(&format!("`{}`", path.display())),
        }
    }

    /// The same error with its subject first; errors of files name the file already.
    pub fn about(self, what: &str) -> Self {
        let named = |text: String| format!("{what}: {text}");
        match self {
            Self::Config(text) => Self::Config(named(text)),
            Self::Mesh(text) => Self::Mesh(named(text)),
            Self::Plan(text) => Self::Plan(named(text)),
            Self::Simulation(text) => Self::Simulation(named(text)),
            Self::Object { name, error } => Self::Object { name, error: Box::new(error.about(what)) },
            other => other,
        }
    }

    /// The same error as an error of an object.
    fn of_object(self, name: Option<String>) -> Self {
        match name {
            Some(name) if !matches!(self, Self::Object { .. }) => Self::Object { name, error: Box::new(self) },
            _ => self,
        }
    }
}

impl From<BadConfig> for CoreError {
    fn from(error: BadConfig) -> Self {
        Self::Config(error.to_string())
    }
}

impl From<MeshError> for CoreError {
    fn from(error: MeshError) -> Self {
        match error {
            MeshError::Io { path, source } | MeshError::Write { path, source } => Self::File { path, source },
            MeshError::OutOfRange(_)
            | MeshError::BadParameter { .. }
            | MeshError::BadScale { .. }
            | MeshError::OutOfMemory { .. }
            | MeshError::UnknownMode { .. } => Self::Config(error.to_string()),
            _ => Self::Mesh(error.to_string()),
        }
    }
}

impl From<HandError> for CoreError {
    fn from(error: HandError) -> Self {
        match error {
            HandError::Io { path, source } => Self::File { path, source },
            _ => Self::Hand(error.to_string()),
        }
    }
}

impl From<ArmError> for CoreError {
    fn from(error: ArmError) -> Self {
        match error {
            ArmError::TooHeavy { .. } | ArmError::MountedInArm { .. } => Self::Arm(error.to_string()),
            _ => Self::Config(error.to_string()),
        }
    }
}

impl From<PlanError> for CoreError {
    fn from(error: PlanError) -> Self {
        match error {
            PlanError::OutOfRange(_) | PlanError::TooMany { .. } => Self::Config(error.to_string()),
            _ => Self::Plan(error.to_string()),
        }
    }
}

impl From<PerceptionError> for CoreError {
    fn from(error: PerceptionError) -> Self {
        match error {
            PerceptionError::Render(source) => source.into(),
            PerceptionError::Mesh(source) => source.into(),
            PerceptionError::Hand(source) => source.into(),
            PerceptionError::Plan(source) => source.into(),
            PerceptionError::NothingCloses { .. } => Self::Hand(error.to_string()),
            _ => Self::Config(error.to_string()),
        }
    }
}

impl From<SimError> for CoreError {
    fn from(error: SimError) -> Self {
        match error {
            SimError::OutOfRange(_) => Self::Config(error.to_string()),
            _ => Self::Simulation(error.to_string()),
        }
    }
}

impl From<RenderError> for CoreError {
    fn from(error: RenderError) -> Self {
        match error {
            RenderError::Mesh(source) => source.into(),
            _ => Self::Config(error.to_string()),
        }
    }
}

impl From<EpisodeError> for CoreError {
    fn from(error: EpisodeError) -> Self {
        let object = error.object().map(str::to_owned);
        let found = match error {
            EpisodeError::OutOfRange(_) | EpisodeError::BadPreshape { .. } | EpisodeError::BadPose { .. } => {
                Self::Config(error.to_string())
            }
            EpisodeError::BadSize { .. } | EpisodeError::BadMass { .. } => Self::Mesh(error.to_string()),
            EpisodeError::Hand { .. } => Self::Hand(error.to_string()),
            EpisodeError::Cancelled { .. } => Self::Interrupted,
            EpisodeError::Mesh { object, source } => Self::from(source).about(&format!("object `{object}`")),
            EpisodeError::Plan { object, source } => Self::from(source).about(&format!("object `{object}`")),
            EpisodeError::Sim { source: source @ SimError::OutOfRange(_), .. } => source.into(),
            _ => Self::Simulation(error.to_string()),
        };
        found.of_object(object)
    }
}

impl From<EnvError> for CoreError {
    fn from(error: EnvError) -> Self {
        let object = error.object().map(str::to_owned);
        let found = match error {
            EnvError::Episode(source) => source.into(),
            EnvError::InFile { path, source } => Self::from(*source).about(&format!("`{}`", path.display())),
            EnvError::Render(source) => source.into(),
            EnvError::Broken { .. } | EnvError::WrongSize { .. } => Self::Internal(error.to_string()),
            EnvError::BadHand { source } => source.into(),
            EnvError::Unusable { source } => source.into(),
            EnvError::NotRenderable { object, source } => Self::from(source).about(&format!("object `{object}`")),
            EnvError::Arm(source) => source.into(),
            EnvError::NoRoom { .. } => Self::Simulation(error.to_string()),
            _ => Self::Config(error.to_string()),
        };
        found.of_object(object)
    }
}

/// The classes of `graspbox.errors`, looked up once.
fn class<'py>(py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyType>> {
    static MODULE: PyOnceLock<Py<PyModule>> = PyOnceLock::new();
    let module = MODULE.get_or_try_init(py, || py.import("graspbox.errors").map(Bound::unbind))?;
    Ok(module.bind(py).getattr(name)?.cast_into()?)
}

/// The Python exception for `error`.
fn exception(py: Python<'_>, error: CoreError) -> PyResult<PyErr> {
    let message = error.to_string();
    Ok(match error {
        CoreError::Interrupted => PyKeyboardInterrupt::new_err(()),
        CoreError::File { path, source } => {
            let class = class(py, "FileError")?;
            match source.raw_os_error() {
                // `OSError(errno, text, filename)` sets the attributes `errno` and `filename`.
                Some(code) => {
                    let text = py.import("os")?.call_method1("strerror", (code,))?.unbind();
                    PyErr::from_type(class, (code, text, path))
                }
                None => PyErr::from_type(class, message),
            }
        }
        CoreError::Object { name, error } => {
            let raised = exception(py, *error)?;
            raised.value(py).setattr("object", name)?;
            raised
        }
        other => PyErr::from_type(class(py, other.kind())?, message),
    })
}

impl From<CoreError> for PyErr {
    fn from(error: CoreError) -> Self {
        Python::attach(|py| exception(py, error).unwrap_or_else(|import_error| import_error))
    }
}
