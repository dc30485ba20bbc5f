//! Table, ground and walls: boxes that do not move in the world.

use crate::SimError;
use graspbox_mesh::range::{in_range, is_pose};
pub use graspbox_solver::Wall;
use nalgebra::{Isometry3, Vector3};

/// Side of the table top, metres.
pub const TABLE_SIDE: f64 = 1.2;
/// Thickness of the table top, and of the ground, metres.
pub const TABLE_THICKNESS: f64 = 0.1;
/// Height of the table top above the ground, metres: that of a common table.
pub const TABLE_HEIGHT: f64 = 0.75;
/// Side of the ground, metres: farther than anything rolls in an episode.
pub const GROUND_SIDE: f64 = 20.0;

/// Table top and ground as boxes: poses of their middles in the world, half sides.
#[must_use]
pub fn slabs() -> [Wall; 2] {
    let slab = |side: f64, z: f64| Wall {
        world_from_wall: Isometry3::translation(0.0, 0.0, z),
        half: Vector3::new(side, side, TABLE_THICKNESS) * 0.5,
    };
    [slab(TABLE_SIDE, -TABLE_THICKNESS * 0.5), slab(GROUND_SIDE, -TABLE_HEIGHT - TABLE_THICKNESS * 0.5)]
}

/// Farthest place of a wall, metres.
const FARTHEST: f64 = 10.0;

/// The four walls of a bin without a lid that stands on the table about its centre.
///
/// * `inside`: sides of its floor along x and y, and height of its walls, metres.
/// * `thickness`: of the walls, metres.
#[must_use]
pub fn bin(inside: Vector3<f64>, thickness: f64) -> Vec<Wall> {
    let (outer, height) = (inside / 2.0 + Vector3::repeat(thickness / 2.0), inside.z / 2.0);
    let across = Vector3::new(thickness / 2.0, inside.y / 2.0 + thickness, height);
    let along = Vector3::new(inside.x / 2.0, thickness / 2.0, height);
    let wall = |x: f64, y: f64, half| Wall { world_from_wall: Isometry3::translation(x, y, height), half };
    vec![wall(-outer.x, 0.0, across), wall(outer.x, 0.0, across), wall(0.0, -outer.y, along), wall(0.0, outer.y, along)]
}

/// Refuses walls that are too many, too large, flat, or too far away.
pub(crate) fn check(walls: &[Wall]) -> Result<(), SimError> {
    if walls.len() > graspbox_solver::MAX_WALLS {
        return Err(SimError::TooManyWalls { count: walls.len() });
    }
    for wall in walls {
        is_pose("walls.world_from_wall", &wall.world_from_wall, FARTHEST)?;
        wall.half.iter().try_for_each(|half| in_range("walls.half", *half, 1e-4..=FARTHEST, "m"))?;
    }
    Ok(())
}
