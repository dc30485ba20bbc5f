//! Errors as sent to a client.

use graspbox_gym::EnvError;

/// An error on the wire: `{type, field, message, object}`.
#[derive(Clone, Debug, Default, PartialEq, Eq, thiserror::Error)]
#[error("{message}")]
pub struct Fault {
    /// Name of the class in `graspbox.errors`; `KeyboardInterrupt` for a call that was cancelled.
    pub kind: String,
    /// The invalid field of the command; empty if there is none in particular.
    pub field: String,
    /// The message of the local error.
    pub message: String,
    /// Name of an unusable object, if another one could replace it; empty for every other error.
    pub object: String,
}

/// Converts an error of environments; the names of Python's classes are not known here.
pub type Classify = fn(EnvError) -> Fault;

impl Fault {
    /// An argument that is wrong.
    pub fn config(field: impl Into<String>, message: impl Into<String>) -> Self {
        Self { kind: "ConfigError".to_owned(), field: field.into(), message: message.into(), ..Self::default() }
    }

    /// A defect of the server.
    pub fn internal(message: impl Into<String>) -> Self {
        let message =
            format!("internal error of the server, please report it together with the input: {}", message.into());
        Self { kind: "InternalError".to_owned(), message, ..Self::default() }
    }

    /// A cancelled call.
    pub fn interrupted() -> Self {
        let message = "the call was cancelled; environments that it had not reached are as they were".to_owned();
        Self { kind: "KeyboardInterrupt".to_owned(), message, ..Self::default() }
    }
}
