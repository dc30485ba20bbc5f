//! Errors of environments and their inputs; each variant is a sentence about the input.

use graspbox_mesh::OutOfRange;

/// An error of an environment or its input.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AgentError {
    /// Two criteria of success.
    #[error(
        "`trial.success` differs from `success`; environments use `success` only, so leave `trial.success` at its default"
    )]
    TwoCriteria,
    /// A setting is out of range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// A time step that does not divide the control period.
    #[error("`physics.dt` is {dt}, but it must be a whole fraction of the control period of {period} s")]
    BadTimeStep {
        /// The time step that was passed, seconds.
        dt: f64,
        /// The control period, seconds.
        period: f64,
    },
    /// An observation is requested twice.
    #[error("the observation `{name}` is named twice; name it once")]
    Twice {
        /// Its name.
        name: String,
    },
    /// An observation of sensors that the hand does not have.
    #[error("the hand `{hand}` has no sensors for the observation `{name}`; leave it out")]
    NothingToObserve {
        /// Name of the observation.
        name: &'static str,
        /// Name of the hand.
        hand: String,
    },
    /// An object cannot be rendered.
    #[error("object `{object}`: {source}")]
    NotRenderable {
        /// Name of the object.
        object: String,
        /// The renderer's error.
        source: graspbox_camera::CameraError,
    },
    /// There are no objects.
    #[error("the list of objects is empty; give at least one")]
    NoObjects,
    /// There is no object of that index.
    #[error("there is no object {index}: there are {count}, counted from 0")]
    NoSuchObject {
        /// The index that was passed.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// There is no object of that name.
    #[error("there is no object {name:?} in this set")]
    UnknownObject {
        /// The name that was passed.
        name: String,
    },
    /// The hand's kinematics fail.
    #[error("the hand cannot be used: {source}")]
    BadHand {
        /// The hand's error.
        source: graspbox_hand::HandError,
    },
    /// The hand has no usable collision shapes.
    #[error("the hand cannot be used: {source}")]
    Unusable {
        /// The planner's error.
        source: graspbox_plan::PlanError,
    },
    /// An option of a reset is invalid.
    #[error("reset option `{option}`: {why}")]
    BadOption {
        /// Name of the option.
        option: &'static str,
        /// The problem, and the accepted values.
        why: String,
    },
    /// There is no room for the open hand over the object.
    #[error(
        "object `{object}` leaves no room for the open hand inside the workspace; use a smaller object or give world_from_hand"
    )]
    NoRoom {
        /// Name of the object.
        object: String,
    },
    /// An action is invalid.
    #[error("the action of environment {env} {why}; nothing was moved")]
    BadAction {
        /// Index of the environment.
        env: usize,
        /// The reason.
        why: String,
    },
    /// An array has the wrong length.
    #[error("{what} has {found} entries; give {expected}")]
    BadLength {
        /// Name of the array.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The expected length.
        expected: usize,
    },
    /// There is no environment of that index.
    #[error("there is no environment {env}: there are {count}, counted from 0")]
    NoSuchEnv {
        /// The index that was passed.
        env: usize,
        /// How many there are.
        count: usize,
    },
    /// The environment has no episode yet.
    #[error("environment {env} has no episode yet; reset it before the first step")]
    NotReset {
        /// Index of the environment.
        env: usize,
    },
    /// The first reset needs a seed.
    #[error("environment {env} has no random stream yet; give a seed at its first reset")]
    NotSeeded {
        /// Index of the environment.
        env: usize,
    },
    /// The episode is over, and the environment has no autoreset.
    #[error("the episode of environment {env} is over; reset the environment before the next step")]
    Over {
        /// Index of the environment.
        env: usize,
    },
    /// An environment has a pending step.
    #[error("environment {env} is still stepping; receive its result first")]
    Busy {
        /// Index of the environment.
        env: usize,
    },
    /// A step of one environment panicked.
    #[error(
        "a step of environment {env} panicked ({why}); this is an error of graspbox: report it, and reset the environment"
    )]
    Broken {
        /// Index of the environment.
        env: usize,
        /// The message of the panic.
        why: String,
    },
    /// A reader of an observation does not fit its row.
    #[error(
        "the row of `{column}` has {expected} entries, but its reader writes {found}; this is an error of graspbox: report it"
    )]
    WrongSize {
        /// Name of the column.
        column: String,
        /// Number of entries that the reader wrote.
        found: usize,
        /// Number of entries of the row.
        expected: usize,
    },
    /// An object's description is incomplete or contradictory.
    #[error("object {object:?}: {why}")]
    BadObject {
        /// Name of the object.
        object: String,
        /// The problem, and the accepted values.
        why: String,
    },
    /// Steps were cancelled before they began.
    #[error("{count} environments are awaited, but only {pending} steps are pending; the others were cancelled")]
    Cancelled {
        /// Number of environments that are awaited.
        count: usize,
        /// Number of pending steps.
        pending: usize,
    },
    /// A saved state does not fit.
    #[error("the state cannot be restored: {why}")]
    BadState {
        /// The reason.
        why: String,
    },
    /// An object from a file cannot be used.
    #[error("`{}`: {source}", path.display())]
    InFile {
        /// The file.
        path: std::path::PathBuf,
        /// The reason.
        source: Box<AgentError>,
    },
    /// The object, its scene or its trial.
    #[error(transparent)]
    Episode(#[from] graspbox_episode::EpisodeError),
    /// The cameras or an image.
    #[error(transparent)]
    Vision(#[from] graspbox_vision::VisionError),
}

impl AgentError {
    /// The same error with indices of environments counted from `first`.
    #[must_use]
    pub fn counted_from(mut self, first: usize) -> Self {
        if let Self::BadAction { env, .. }
        | Self::NoSuchEnv { env, .. }
        | Self::NotReset { env }
        | Self::NotSeeded { env }
        | Self::Over { env }
        | Self::Busy { env }
        | Self::Broken { env, .. } = &mut self
        {
            *env += first;
        }
        self
    }

    /// Name of the object that cannot be used, if another one might.
    pub fn object(&self) -> Option<&str> {
        match self {
            Self::Episode(error) => error.object(),
            Self::Vision(graspbox_vision::VisionError::Mesh { object, .. })
            | Self::NoRoom { object }
            | Self::NotRenderable { object, .. } => Some(object),
            Self::InFile { source, .. } => source.object(),
            _ => None,
        }
    }
}
