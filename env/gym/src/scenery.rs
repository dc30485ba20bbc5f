//! Render models of walls, table and ground, and of a goal.

use graspbox_render::{BoxKind, FixedBox, Model, RenderError, shapes};
use graspbox_sim::Wall;
use graspbox_sim::scenery::slabs;

/// Colour of a goal in pictures.
pub const MARKER_COLOR: [f32; 3] = [0.85, 0.10, 0.10];
/// Radius of its ball, metres.
const MARKER_RADIUS: f64 = 0.012;

/// The ball that shows a goal in pictures.
///
/// # Errors
/// As [`shapes::sphere`], which takes this radius.
pub fn goal_marker() -> Result<Model, RenderError> {
    Model::new(&shapes::sphere(MARKER_RADIUS, 24)?)
}

/// Models of `walls`, and of table and ground if `table` is set.
///
/// # Errors
/// [`RenderError`] for a wall that is flat or too large.
pub fn fixed_boxes(walls: &[Wall], table: bool) -> Result<Vec<FixedBox>, RenderError> {
    let model = |kind, wall: &Wall| FixedBox::new(kind, wall.half, wall.world_from_wall);
    let mut boxes = walls.iter().map(|wall| model(BoxKind::Wall, wall)).collect::<Result<Vec<_>, _>>()?;
    if table {
        let [top, ground] = slabs();
        boxes.extend([model(BoxKind::Table, &top)?, model(BoxKind::Ground, &ground)?]);
    }
    Ok(boxes)
}
