//! Sizes of the largest world.

/// Most objects of a world: pairs of bodies grow with its square.
pub const MAX_OBJECTS: usize = 64;
/// Most walls of a world.
pub const MAX_WALLS: usize = 64;
