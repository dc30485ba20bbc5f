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
    /// A finger of the hand cannot be simulated.
    #[error("finger `{finger}` cannot be simulated: {why}")]
    BadFinger {
        /// Name of the finger.
        finger: String,
        /// The reason.
        why: &'static str,
    },
    /// The hand's tree of joints cannot be simulated.
    #[error("hand `{hand}` cannot be simulated: {why}")]
    BadHand {
        /// Name of the hand.
        hand: String,
        /// The reason.
        why: String,
    },
    /// A motor command is NaN or infinite.
    #[error("the command to motor {motor} is not a finite number")]
    BadCommand {
        /// Index of the motor.
        motor: usize,
    },
    /// The snapshot is not one of this version, or is damaged.
    #[error("the snapshot cannot be restored: {why}")]
    BadSnapshot {
        /// The reason.
        why: String,
    },
}
