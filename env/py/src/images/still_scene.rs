//! Objects and walls at rest, ready to be rendered without a hand.

use crate::convert::Floats;
use crate::errors::CoreError;
use crate::mesh::MeshData;
use graspbox_vision::visual_models::{object_color, object_label};
use graspbox_vision::{ObjectPose, ScenePose, WallModel};
use nalgebra::Isometry3;
use std::sync::Arc;

/// Objects and walls at rest.
pub(crate) struct StillScene {
    /// The objects, the first of which has the label of "the object", with their poses.
    pub objects: Vec<(Arc<MeshData>, Isometry3<f64>)>,
    /// Walls around them.
    pub walls: Vec<WallModel>,
}

impl StillScene {
    /// What the renderer takes, without a hand; `levels`: with levels of detail, not in full detail.
    pub(crate) fn pose(&self, levels: bool) -> Result<ScenePose<'_>, CoreError> {
        let mut objects = Vec::with_capacity(self.objects.len());
        for (index, (data, world_from_object)) in self.objects.iter().enumerate() {
            let (color, label) = (object_color(&data.spec.name), object_label(index, 0));
            let model = if levels { data.render_model()? } else { data.surface()? };
            objects.push(ObjectPose { model, color, label, world_from_object: *world_from_object });
        }
        let world_from_hand = Isometry3::identity();
        Ok(ScenePose { objects, walls: &self.walls, world_from_hand, world_from_links: Vec::new() })
    }
}

/// Models of walls from their poses (4, 4) and half extents, metres.
///
/// # Errors
/// A pose of another shape, or that is no rigid motion, or a wall that is flat or too large.
pub(crate) fn wall_models(walls: &[(Floats, [f64; 3])]) -> Result<Vec<WallModel>, CoreError> {
    Ok(crate::layout::walls(walls)?.iter().map(WallModel::new).collect::<Result<_, _>>()?)
}
