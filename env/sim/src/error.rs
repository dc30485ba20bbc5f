//! Errors of a world; each variant is a sentence about the input.

use graspbox_mesh::OutOfRange;

/// An invalid physics setting, object, command or snapshot.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SimError {
    /// A setting is out of range.
    #[error("physics setting {0}")]
    OutOfRange(#[from] OutOfRange),
    /// The object has no collision geometry.
    #[error("the object has no convex part; decompose its mesh into convex parts first")]
    NoParts,
    /// A world without an object.
    #[error("there is no object; give one or more")]
    NoObjects,
    /// A convex part has no volume.
    #[error("convex part {part} of object {object} has no volume; remove it, or thicken the mesh there")]
    FlatPart { object: usize, part: usize },
    /// More objects than a world may have.
    #[error("{count} objects are too many; a world has at most {}", graspbox_solver::MAX_OBJECTS)]
    TooManyObjects { count: usize },
    /// More walls than a world may have.
    #[error("{count} walls are too many; a world has at most {}", graspbox_solver::MAX_WALLS)]
    TooManyWalls { count: usize },
    /// The poses are not one for each object.
    #[error("there are {poses} poses for {objects} objects; give one for each")]
    WrongPoses { poses: usize, objects: usize },
    /// Mass or inertia is not finite and positive.
    #[error("the object's {what} is {value}, but it must be finite and positive")]
    BadMass {
        /// `mass` or `inertia`.
        what: &'static str,
        value: f64,
    },
    /// An engine cannot simulate the hand.
    #[error("the engine `{engine}` cannot simulate the hand `{hand}`: {why}; choose another engine")]
    BadHand { hand: String, engine: &'static str, why: String },
    /// An actuator command is NaN or infinite.
    #[error("the command to actuator {actuator} is not a finite number")]
    BadCommand { actuator: usize },
    /// The snapshot is damaged, or belongs to another version or template.
    #[error("the snapshot cannot be restored: {why}")]
    BadSnapshot { why: String },
}
