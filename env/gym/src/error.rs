//! Errors of environments and their inputs; each variant is a sentence about the input.

use graspbox_mesh::OutOfRange;

/// An error of an environment or its input.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EnvError {
    /// Two criteria of success.
    #[error(
        "`trial.success` differs from `success`; environments use `success` only, so leave `trial.success` at its default"
    )]
    TwoCriteria,
    /// A setting is out of range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// A time step that does not divide the control period.
    #[error(
        "`physics.dt` is {dt}, but with `control_freq` {control_freq} it must be a whole fraction of the control period of {period} s"
    )]
    BadTimeStep {
        /// The time step that was passed, seconds.
        dt: f64,
        /// Actions per second.
        control_freq: f64,
        /// The control period, seconds.
        period: f64,
    },
    /// An observation is requested twice.
    #[error("the observation `{name}` is named twice; name it once")]
    Twice { name: String },
    #[error("goals need closed-loop control of a single object; choose another control mode and layout")]
    NoGoals,
    #[error("the control mode `{control}` moves the joints of an arm, but there is none; name one as `arm`")]
    NoArm { control: &'static str },
    /// At home, the arm touches something.
    #[error(
        "arm `{arm}` with its base at {base:?} m touches itself, the table or a wall at home; give another `base`, or another home in its arm.toml"
    )]
    ArmInTheWay { arm: String, base: [f64; 3] },
    /// No episode can begin.
    #[error(
        "arm `{arm}` with its base at {base:?} m reaches no place over object `{object}` where an episode could begin ({why}); give another `base`"
    )]
    NoStart { arm: String, object: String, base: [f64; 3], why: String },
    #[error(transparent)]
    Arm(#[from] graspbox_arm::ArmError),
    /// An observation of sensors that the hand does not have.
    #[error("the hand `{hand}` has no sensors for the observation `{name}`; leave it out")]
    NothingToObserve { name: &'static str, hand: String },
    /// An object cannot be rendered.
    #[error("object `{object}`: {source}")]
    NotRenderable { object: String, source: graspbox_render::RenderError },
    #[error("the list of objects is empty; give at least one")]
    NoObjects,
    #[error("there is no object {index}: there are {count}, counted from 0")]
    NoSuchObject { index: usize, count: usize },
    /// There is no object of that name.
    #[error("there is no object {name:?} in this set")]
    UnknownObject { name: String },
    /// The hand's kinematics fail.
    #[error("the hand cannot be used: {source}")]
    BadHand { source: graspbox_hand::HandError },
    /// The hand has no usable collision shapes.
    #[error("the hand cannot be used: {source}")]
    Unusable { source: graspbox_plan::PlanError },
    /// An option of a reset is invalid.
    #[error("reset option `{option}`: {why}")]
    BadOption {
        option: &'static str,
        /// The problem, and the accepted values.
        why: String,
    },
    /// There is no room for the open hand over the object.
    #[error(
        "object `{object}` leaves no room for the open hand inside the workspace; use a smaller object or give world_from_hand"
    )]
    NoRoom { object: String },
    /// An action is invalid.
    #[error("the action of environment {env} {why}; nothing was moved")]
    BadAction { env: usize, why: String },
    /// An array has the wrong length.
    #[error("{what} has {found} entries; give {expected}")]
    BadLength {
        what: &'static str,
        /// Its length.
        found: usize,
        /// The expected length.
        expected: usize,
    },
    /// There is no environment of that index.
    #[error("there is no environment {env}: there are {count}, counted from 0")]
    NoSuchEnv { env: usize, count: usize },
    /// The environment has no episode yet.
    #[error("environment {env} has no episode yet; reset it before the first step")]
    NotReset { env: usize },
    /// The first reset needs a seed.
    #[error("environment {env} has no random stream yet; give a seed at its first reset")]
    NotSeeded { env: usize },
    /// The episode is over, and the environment has no autoreset.
    #[error("the episode of environment {env} is over; reset the environment before the next step")]
    Over { env: usize },
    /// An environment has a pending step.
    #[error("environment {env} is still stepping; receive its result first")]
    Busy { env: usize },
    /// A step of one environment panicked.
    #[error(
        "a step of environment {env} panicked ({why}); this is an error of graspbox: report it, and reset the environment"
    )]
    Broken {
        env: usize,
        /// The message of the panic.
        why: String,
    },
    /// A reader of an observation does not fit its row.
    #[error(
        "the row of `{column}` has {expected} entries, but its reader writes {found}; this is an error of graspbox: report it"
    )]
    WrongSize {
        column: String,
        /// Number of entries that the reader wrote.
        found: usize,
        /// Number of entries of the row.
        expected: usize,
    },
    /// An object's description is incomplete or contradictory.
    #[error("object {object:?}: {why}")]
    BadObject {
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
    BadState { why: String },
    /// An object from a file cannot be used.
    #[error("`{}`: {source}", path.display())]
    InFile { path: std::path::PathBuf, source: Box<EnvError> },
    /// The object, its scene or its trial.
    #[error(transparent)]
    Episode(#[from] graspbox_episode::EpisodeError),
    /// The cameras or an image.
    #[error(transparent)]
    Render(#[from] graspbox_render::RenderError),
}

impl EnvError {
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
            Self::NoRoom { object } | Self::NotRenderable { object, .. } => Some(object),
            Self::InFile { source, .. } => source.object(),
            _ => None,
        }
    }
}
