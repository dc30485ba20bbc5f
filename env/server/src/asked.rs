//! What a client asks for beside the environments themselves.

/// What a client asks for when its environments are made.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Asked {
    /// Depth images as uint16 millimetres.
    pub millimetres: bool,
    /// Number that the first environment has for the client, in errors.
    pub first: usize,
    /// Large arrays through shared memory.
    pub shm: bool,
    /// How long the session waits for a lost connection, seconds.
    pub grace: f64,
}
