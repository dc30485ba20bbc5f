//! Dimensions of table and ground: boxes with their tops at z = 0 and at the ground's height.

/// Side of the table top, metres.
pub const TABLE_SIDE: f64 = 1.2;
/// Thickness of the table top, and of the ground, metres.
pub const TABLE_THICKNESS: f64 = 0.1;
/// Height of the table top above the ground, metres: that of a common table.
pub const TABLE_HEIGHT: f64 = 0.75;
/// Side of the ground, metres: farther than anything rolls in an episode.
pub const GROUND_SIDE: f64 = 20.0;
