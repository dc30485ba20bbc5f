//! Objects and fixed boxes, ready to be rendered without a hand.

use crate::convert::Floats;
use crate::errors::CoreError;
use crate::mesh::MeshData;
use graspbox_render::labels::{object_color, object_label};
use graspbox_render::{FixedBox, ObjectPose, ScenePose};
use nalgebra::Isometry3;
use std::sync::Arc;

/// Objects at rest and fixed boxes.
pub(crate) struct StillScene {
    /// The objects, the first of which has the label of "the object", with their poses.
    pub objects: Vec<(Arc<MeshData>, Isometry3<f64>)>,
    /// Walls, table and ground.
    pub fixed: Vec<FixedBox>,
}

impl StillScene {
    /// The render scene, without a hand; `levels`: with levels of detail, not in full detail.
    pub(crate) fn pose(&self, levels: bool) -> Result<ScenePose<'_>, CoreError> {
        let mut objects = Vec::with_capacity(self.objects.len());
        for (index, (data, world_from_object)) in self.objects.iter().enumerate() {
            let (color, label) = (object_color(&data.spec.name), object_label(index, 0));
            let model = if levels { data.render_model()? } else { data.surface()? };
            objects.push(ObjectPose { model, color, label, world_from_object: *world_from_object });
        }
        let world_from_hand = Isometry3::identity();
        Ok(ScenePose { objects, fixed: &self.fixed, world_from_hand, world_from_links: Vec::new() })
    }
}

/// Models of walls from their poses (4, 4) and half extents, metres, and of table and ground if `table` is set.
///
/// # Errors
/// A pose of another shape, or that is no rigid motion, or a wall that is flat or too large.
pub(crate) fn fixed_boxes(walls: &[(Floats, [f64; 3])], table: bool) -> Result<Vec<FixedBox>, CoreError> {
    Ok(graspbox_gym::scenery::fixed_boxes(&crate::layout::walls(walls)?, table)?)
}
