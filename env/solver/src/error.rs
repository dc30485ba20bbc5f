//! What may be wrong with a model.

/// Why a hand and an object cannot be simulated.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ModelError {
    /// A convex part encloses no volume.
    #[error("convex part {part} of the object is flat")]
    FlatPart {
        /// Its index.
        part: usize,
    },
    /// The tree is not as its description says.
    #[error("{why} (index {index})")]
    BadTree {
        /// What is wrong.
        why: &'static str,
        /// Of the body, coordinate, cable or pair that is meant.
        index: usize,
    },
}
