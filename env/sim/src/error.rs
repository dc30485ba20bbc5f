//! What can be wrong with a world; each variant is a sentence about the input.

use graspbox_mesh::OutOfRange;

/// What is wrong with a physics setting, an object or a snapshot.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SimError {
    /// A setting is out of its range.
    #[error("physics setting {0}")]
    OutOfRange(#[from] OutOfRange),
    /// The object has nothing to collide with.
    #[error("the object has no convex part; decompose its mesh first")]
    NoParts,
    /// A convex part is flat or broken.
    #[error("convex part {part} of the object has no volume; drop it or thicken the mesh there")]
    FlatPart {
        /// Index of the part.
        part: usize,
    },
    /// Mass or inertia cannot be.
    #[error("the object's {what} is {value}, but it must be finite and positive")]
    BadMass {
        /// `mass` or `inertia`.
        what: &'static str,
        /// What was given.
        value: f64,
    },
    /// An engine cannot simulate the hand.
    #[error("the engine `{engine}` cannot simulate the hand `{hand}`: {why}; choose another engine")]
    BadHand {
        /// Name of the hand.
        hand: String,
        /// Name of the engine.
        engine: &'static str,
        /// The reason.
        why: String,
    },
    /// An actuator command is NaN or infinite.
    #[error("the command to actuator {actuator} is not a finite number")]
    BadCommand {
        /// Index of the actuator.
        actuator: usize,
    },
    /// The snapshot is not one of this version, or is damaged.
    #[error("the snapshot cannot be restored: {why}")]
    BadSnapshot {
        /// The reason.
        why: String,
    },
}
