//! Errors of a model or of a saved state, and the bounds of restored numbers.

use nalgebra::{Isometry3, Vector3};

/// Why a hand and an object cannot be simulated.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ModelError {
    /// A convex part encloses no volume.
    #[error("convex part {part} of object {object} is flat")]
    FlatPart { object: usize, part: usize },
    /// More objects than a world may have.
    #[error("{count} objects are too many; a world has at most {}", crate::limits::MAX_OBJECTS)]
    TooManyObjects { count: usize },
    /// More walls than a world may have.
    #[error("{count} walls are too many; a world has at most {}", crate::limits::MAX_WALLS)]
    TooManyWalls { count: usize },
    /// The tree breaks a rule of [`crate::tree`].
    #[error("{why} (index {index})")]
    BadTree {
        /// The rule that is broken.
        why: &'static str,
        /// Index of the body, coordinate, cable or pair.
        index: usize,
    },
}

/// Why a saved state cannot be taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum StateError {
    /// It is of another hand or object.
    #[error("its {what} are not those of this hand and object")]
    OtherModel {
        /// The part that differs.
        what: &'static str,
    },
    /// A number in it is not finite, or larger than any world's.
    #[error("its {what} are impossible")]
    Impossible {
        /// Where the number is.
        what: &'static str,
    },
}

/// Farthest place, metres: a fall of a minute.
pub(crate) const FARTHEST: f64 = 2e4;

/// Whether all numbers are at most `limit` from 0; NaN is not.
pub(crate) fn is_within<'a>(numbers: impl IntoIterator<Item = &'a f64>, limit: f64) -> bool {
    numbers.into_iter().all(|x| x.abs() <= limit)
}

/// Whether a pose is one, and not farther away than anything falls.
pub(crate) fn is_pose(pose: &Isometry3<f64>) -> bool {
    is_place(&pose.translation.vector) && (pose.rotation.coords.norm() - 1.0).abs() < 1e-6
}

/// Whether a place is not farther away than anything falls.
pub(crate) fn is_place(place: &Vector3<f64>) -> bool {
    is_within(place, FARTHEST)
}

/// Whether a vector has the length 1.
pub(crate) fn is_unit(vector: &Vector3<f64>) -> bool {
    (vector.norm() - 1.0).abs() < 1e-3
}
