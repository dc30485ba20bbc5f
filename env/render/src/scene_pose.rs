//! Objects, fixed boxes and hand of a scene at one instant.

use crate::hand_model::HandModel;
use crate::labels::TABLE;
use crate::scene::is_near;
use crate::{Camera, Channels, Detail, Frame, Instance, Job, Light, Model, RenderError, render_batch, shapes};
use nalgebra::{Isometry3, Vector3};

const TABLE_COLOR: [f32; 3] = [0.80, 0.75, 0.68];
const GROUND_COLOR: [f32; 3] = [0.78, 0.79, 0.81];
const WALL_COLOR: [f32; 3] = [0.62, 0.66, 0.70];

/// An object of a scene at one instant.
#[derive(Clone, Debug)]
pub struct ObjectPose<'a> {
    /// Its geometry.
    pub model: &'a Model,
    pub color: [f32; 3],
    pub label: u8,
    pub world_from_object: Isometry3<f64>,
}

impl<'a> ObjectPose<'a> {
    /// Its instance for the renderer.
    pub(crate) fn instance(&self) -> Instance<'a> {
        Instance {
            model: self.model,
            world_from_model: self.world_from_object,
            color: self.color,
            label: self.label,
            casts_shadow: true,
        }
    }
}

/// Kind of a fixed box, which determines its colour and whether it casts a shadow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoxKind {
    /// A wall of a bin.
    Wall,
    /// The table top; it casts no shadow.
    Table,
    /// The ground below it; it casts no shadow.
    Ground,
}

/// A box that does not move.
#[derive(Clone, Debug)]
pub struct FixedBox {
    kind: BoxKind,
    model: Model,
    world_from_box: Isometry3<f64>,
}

impl FixedBox {
    /// Builds the model of a box.
    ///
    /// * `half`: half sides, metres.
    /// * `world_from_box`: pose of its middle.
    ///
    /// # Errors
    /// [`RenderError::Named`] for a box that is flat or too large.
    pub fn new(kind: BoxKind, half: Vector3<f64>, world_from_box: Isometry3<f64>) -> Result<Self, RenderError> {
        let name = match kind {
            BoxKind::Wall => "a wall",
            BoxKind::Table => "the table",
            BoxKind::Ground => "the ground",
        };
        let model = shapes::cuboid(half, 0.0).and_then(|mesh| Model::new(&mesh));
        Ok(Self { kind, model: model.map_err(|error| error.of(name))?, world_from_box })
    }

    fn instance(&self) -> Instance<'_> {
        let color = match self.kind {
            BoxKind::Wall => WALL_COLOR,
            BoxKind::Table => TABLE_COLOR,
            BoxKind::Ground => GROUND_COLOR,
        };
        Instance {
            model: &self.model,
            world_from_model: self.world_from_box,
            color,
            label: TABLE,
            casts_shadow: self.kind == BoxKind::Wall,
        }
    }
}

/// Poses of all bodies in the scene at one instant.
#[derive(Clone, Debug)]
pub struct ScenePose<'a> {
    pub objects: Vec<ObjectPose<'a>>,
    /// Walls, table and ground.
    pub fixed: &'a [FixedBox],
    /// The grasp frame.
    pub world_from_hand: Isometry3<f64>,
    /// The hand's links; empty to leave the hand out.
    pub world_from_links: Vec<Isometry3<f64>>,
}

impl ScenePose<'_> {
    /// All instances to render; those without a finite pose, as in a simulation that diverged, are left out.
    ///
    /// * `hand`: the model of the hand; `None` leaves it out.
    #[must_use]
    pub fn instances<'b>(&'b self, hand: Option<&'b HandModel>) -> Vec<Instance<'b>> {
        let objects = self.objects.iter().map(ObjectPose::instance);
        // Roughly front to back, to overwrite fewer pixels.
        let mut all: Vec<_> = hand.iter().flat_map(|hand| hand.instances(&self.world_from_links)).collect();
        all.extend(objects.filter(|instance| is_near(&instance.world_from_model)));
        all.extend(self.fixed.iter().map(FixedBox::instance));
        all
    }
}

/// Renders a scene without a hand from each camera; frames in the order of the cameras.
///
/// # Errors
/// [`RenderError`] for a fixed box whose pose is not finite.
pub fn render_views(
    scene_pose: &ScenePose,
    cameras: &[Camera],
    light: &Light,
    channels: Channels,
    detail: Detail,
) -> Result<Vec<Frame>, RenderError> {
    let instances = scene_pose.instances(None);
    let job = |camera: &Camera| Job { instances: &instances, camera: *camera, light: *light, channels };
    let jobs: Vec<_> = cameras.iter().map(job).collect();
    render_batch(&jobs, detail).map_err(|error| error.of("a view"))
}
