//! Table and ground: boxes whose tops are at z = 0 and below it.

/// Side of the table top, metres.
pub const TABLE_SIDE: f64 = 1.2;
/// Thickness of the table top, and of the ground, metres.
pub const TABLE_THICKNESS: f64 = 0.1;
/// Height of the table top above the ground, metres: a usual table.
pub const TABLE_HEIGHT: f64 = 0.75;
/// Side of the ground, metres: further than anything rolls in an episode.
pub const GROUND_SIDE: f64 = 20.0;
