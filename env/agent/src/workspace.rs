//! Boxes and distances of the workspace, world frame, metres: z is up, the table's top is at z = 0, its middle at the origin.

/// Least corner of the box that the grasp frame stays in: the box reaches an object near the middle from every side, and lifts it.
pub const WORKSPACE_LOW: [f64; 3] = [-0.35, -0.35, 0.0];
/// Greatest corner of that box.
pub const WORKSPACE_HIGH: [f64; 3] = [0.35, 0.35, 0.75];

/// Least corner of the box of hand positions that a decision chooses from: a hand's reach around objects near the table's middle.
pub const DECISION_LOW: [f64; 3] = [-0.25, -0.25, 0.0];
/// Greatest corner of that box.
pub const DECISION_HIGH: [f64; 3] = [0.25, 0.25, 0.40];

/// The object is lost when its centre of mass is further than this from the vertical through the table's middle: it has left the
/// workspace. No episode begins there.
pub const LOST_DISTANCE: f64 = 0.5;
/// The object is lost when its centre of mass is lower than this: it is off the table.
pub const LOST_HEIGHT: f64 = 0.0;
