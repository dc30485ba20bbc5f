//! Errors of environments and their inputs; each variant is a sentence about the input.

use graspbox_mesh::OutOfRange;

/// An error of an environment or its input.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum AgentError {
    /// Two criteria of success.
    #[error(
        "`trial.success` differs from `success`; an environment is judged by `success` alone, so leave the trial's as it is"
    )]
    TwoCriteria,
    /// A setting is out of its range.
    #[error(transparent)]
    OutOfRange(#[from] OutOfRange),
    /// A time step that does not divide the control period.
    #[error("`physics.dt` is {dt}, but it must be a whole fraction of the control period of {period} s")]
    BadTimeStep {
        /// What was given, seconds.
        dt: f64,
        /// The control period, seconds.
        period: f64,
    },
    /// An observation is asked for twice.
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
        /// What the renderer said.
        source: graspbox_camera::CameraError,
    },
    /// There is nothing to grasp.
    #[error("the list of objects is empty; give at least one")]
    NoObjects,
    /// There is no object of that index.
    #[error("there is no object {index}: there are {count}, counted from 0")]
    NoSuchObject {
        /// What was given.
        index: usize,
        /// How many there are.
        count: usize,
    },
    /// There is no object of that name.
    #[error("there is no object {name:?} in this set")]
    UnknownObject {
        /// What was given.
        name: String,
    },
    /// The hand's kinematics fail.
    #[error("the hand cannot be used: {source}")]
    BadHand {
        /// What the hand said.
        source: graspbox_hand::HandError,
    },
    /// The hand has no collision shapes that can be used.
    #[error("the hand cannot be used: {source}")]
    Unusable {
        /// What the planner said.
        source: graspbox_plan::PlanError,
    },
    /// An option of a reset is wrong.
    #[error("reset option `{option}`: {why}")]
    BadOption {
        /// Name of the option.
        option: &'static str,
        /// What is wrong, and what would be accepted.
        why: String,
    },
    /// No room for the open hand over the object.
    #[error(
        "object `{object}` leaves no room for the open hand inside the workspace; use a smaller object or give world_from_hand"
    )]
    NoRoom {
        /// Name of the object.
        object: String,
    },
    /// An action is wrong.
    #[error("the action of environment {env} {why}; nothing was moved")]
    BadAction {
        /// Index of the environment.
        env: usize,
        /// What is wrong.
        why: String,
    },
    /// An array has the wrong length.
    #[error("{what} has {found} entries; give {expected}")]
    BadLength {
        /// Name of the array.
        what: &'static str,
        /// Its length.
        found: usize,
        /// The right one.
        expected: usize,
    },
    /// There is no environment of that index.
    #[error("there is no environment {env}: there are {count}, counted from 0")]
    NoSuchEnv {
        /// What was given.
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
    /// The episode is over, and nothing resets it by itself.
    #[error("the episode of environment {env} is over; reset the environment before the next step")]
    Over {
        /// Index of the environment.
        env: usize,
    },
    /// An environment is still on its way.
    #[error("environment {env} is still stepping; receive its result first")]
    Busy {
        /// Index of the environment.
        env: usize,
    },
    /// A step of one environment panicked.
    #[error("environment {env} broke down ({why}); this is an error of graspbox: report it, and reset the environment")]
    Broken {
        /// Index of the environment.
        env: usize,
        /// What the panic said.
        why: String,
    },
    /// A reader of an observation does not fit its row.
    #[error(
        "the row of `{column}` has {expected} entries, but its reader gives {found}; this is an error of graspbox: report it"
    )]
    WrongSize {
        /// Name of the column.
        column: String,
        /// Entries that the reader gave.
        found: usize,
        /// Entries that the row says.
        expected: usize,
    },
    /// An object's description is incomplete or contradictory.
    #[error("object {object:?}: {why}")]
    BadObject {
        /// Name of the object.
        object: String,
        /// What is wrong, and what would be accepted.
        why: String,
    },
    /// Environments were called back before they stepped.
    #[error("{count} environments are awaited, but only {away} are on their way; the others were called back")]
    CalledBack {
        /// Environments that are awaited.
        count: usize,
        /// Environments on their way.
        away: usize,
    },
    /// A saved state does not fit.
    #[error("the state cannot be restored: {why}")]
    BadState {
        /// The reason.
        why: String,
    },
    /// The object, its scene or its trial.
    #[error(transparent)]
    Episode(#[from] graspbox_episode::EpisodeError),
    /// The cameras or an image.
    #[error(transparent)]
    Vision(#[from] graspbox_vision::VisionError),
}

impl AgentError {
    /// The same error where the first environment of a pool has the number `first` elsewhere.
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

    /// True if this object cannot be used but another one might.
    pub fn is_of_an_object(&self) -> bool {
        use graspbox_episode::EpisodeError;
        match self {
            Self::Episode(error) => matches!(
                error,
                EpisodeError::Sim { .. }
                    | EpisodeError::Mesh { .. }
                    | EpisodeError::Plan { .. }
                    | EpisodeError::NoRest { .. }
                    | EpisodeError::BadSize { .. }
                    | EpisodeError::BadMass { .. }
            ),
            Self::NoRoom { .. } | Self::NotRenderable { .. } => true,
            _ => false,
        }
    }
}
