//! Boxes and distances of the workspace, world frame, metres: z is up, the table's top is at z = 0, its middle at the origin.

use std::f64::consts::PI;

/// Distance of an arm's base from the table's middle, unless it is given, as a share of the arm's length: on the table along x, opposite the camera
/// `front`, its own x axis towards the middle. The whole workspace is then within reach of arms of common proportions.
pub const BASE_DISTANCE: f64 = 0.55;

/// Least corner of the box in which the grasp frame stays: large enough to reach an object near the middle from every side and to lift it.
pub const WORKSPACE_LOW: [f64; 3] = [-0.35, -0.35, 0.0];
/// Greatest corner of that box.
pub const WORKSPACE_HIGH: [f64; 3] = [0.35, 0.35, 0.75];

/// Least corner of the box of hand positions in a decision: a hand's reach around objects near the table's middle.
pub const DECISION_LOW: [f64; 3] = [-0.25, -0.25, 0.0];
/// Greatest corner of that box.
pub const DECISION_HIGH: [f64; 3] = [0.25, 0.25, 0.40];

/// Least corner of the box of grasp centres in a decision about a point: where objects near the table's middle are held.
pub const POINT_LOW: [f64; 3] = [-0.12, -0.12, 0.0];
/// Greatest corner of that box.
pub const POINT_HIGH: [f64; 3] = [0.12, 0.12, 0.25];
/// Greatest tilt of the hand from facing down in such a decision, radians.
pub const POINT_TILT: f64 = PI / 4.0;

/// Greatest distance of the object's centre of mass from the vertical through the table's middle: beyond it the object has left the workspace and is
/// lost. No episode begins there.
pub const LOST_DISTANCE: f64 = 0.5;
/// Least height of the object's centre of mass: below it the object is off the table and lost.
pub const LOST_HEIGHT: f64 = 0.0;
