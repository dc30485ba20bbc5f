//! Models and colours of hand, table and ground, and the render scene of the current state.

use crate::VisionError;
use graspbox_camera::{CameraError, Instance, Model, shapes};
use graspbox_hand::{Collider, Hand, JointKind, Material, Shape};
use graspbox_mesh::{TriMesh, in_range};
use graspbox_sim::scenery::{GROUND_SIDE, TABLE_HEIGHT, TABLE_SIDE, TABLE_THICKNESS};
use graspbox_sim::{Wall, World};
use nalgebra::{Isometry3, Rotation3, Translation3, Vector3};

/// Label of background pixels.
pub const BACKGROUND: u8 = 0;
/// Label of the table, the ground below it, and walls.
pub const TABLE: u8 = 1;
/// Label of the object, or of the first of several: [`object_label`] has those of the others.
pub const OBJECT: u8 = 2;
/// Label of the hand's link 0, the base; link i has this plus i.
pub const FIRST_LINK: u8 = 3;

/// Bevel of the edges of the hand's boxes, as a share of the shortest half side; at most [`MOST_BEVEL`].
const BEVEL_SHARE: f64 = 0.3;
/// Greatest bevel, metres.
const MOST_BEVEL: f64 = 0.006;
/// Half the width of a knuckle, and its radius, as shares of the shortest half side of its link.
const KNUCKLE: [f64; 2] = [0.85, 0.8];
/// Sides of a knuckle.
const KNUCKLE_COLUMNS: usize = 16;
/// Sides of a cylinder or ball of the hand.
const COLUMNS: usize = 32;

const TABLE_COLOR: [f32; 3] = [0.80, 0.75, 0.68];
const GROUND_COLOR: [f32; 3] = [0.78, 0.79, 0.81];
const WALL_COLOR: [f32; 3] = [0.62, 0.66, 0.70];
const BASE_COLOR: [f32; 3] = [0.36, 0.39, 0.44];
const PALM_COLOR: [f32; 3] = [0.13, 0.36, 0.46];
const LINK_COLOR: [f32; 3] = [0.80, 0.82, 0.85];
const KNUCKLE_COLOR: [f32; 3] = [0.30, 0.32, 0.36];
const TIP_COLOR: [f32; 3] = [0.66, 0.69, 0.74];
const PAD_COLOR: [f32; 3] = [0.15, 0.48, 0.60];
/// Colours of objects.
const OBJECT_COLORS: [[f32; 3]; 8] = [
    [0.86, 0.33, 0.24],
    [0.93, 0.62, 0.20],
    [0.95, 0.80, 0.30],
    [0.45, 0.66, 0.33],
    [0.74, 0.45, 0.66],
    [0.90, 0.50, 0.45],
    [0.60, 0.42, 0.30],
    [0.55, 0.50, 0.80],
];

/// Colour of an object, a function of its name alone.
#[must_use]
pub fn object_color(name: &str) -> [f32; 3] {
    // FNV-1a.
    let mix = |hash: u64, byte: u8| (hash ^ u64::from(byte)).wrapping_mul(0x100_0000_01b3);
    let hash = name.bytes().fold(0xcbf2_9ce4_8422_2325, mix);
    OBJECT_COLORS[((hash >> 32) % OBJECT_COLORS.len() as u64) as usize]
}

/// Label of object `index` of a scene with a hand of `links` links: the first has [`OBJECT`], the others follow the links.
#[must_use]
pub fn object_label(index: usize, links: usize) -> u8 {
    match index {
        0 => OBJECT,
        _ => (usize::from(FIRST_LINK) + links + index - 1).min(usize::from(u8::MAX)) as u8,
    }
}

/// Index of the object with a label: the inverse of [`object_label`].
#[must_use]
pub fn object_index(label: u8, links: usize) -> usize {
    match label {
        OBJECT => 0,
        _ => (usize::from(label) + 1).saturating_sub(usize::from(FIRST_LINK) + links),
    }
}

/// A part of a link that has one colour.
struct Part {
    link: usize,
    model: Model,
    color: [f32; 3],
}

/// Render models of the scene without objects and walls; built once per hand.
pub struct VisualModels {
    parts: Vec<Part>,
    /// Table top and ground; `None` leaves them out.
    table: Option<[Model; 2]>,
}

/// An object of a scene at one instant.
#[derive(Clone, Debug)]
pub struct ObjectPose<'a> {
    /// Its geometry.
    pub model: &'a Model,
    /// Its colour.
    pub color: [f32; 3],
    /// Its label.
    pub label: u8,
    /// Its pose.
    pub world_from_object: Isometry3<f64>,
}

impl<'a> ObjectPose<'a> {
    /// What the renderer takes.
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

/// A wall: a box that does not move.
#[derive(Clone, Debug)]
pub struct WallModel {
    model: Model,
    world_from_wall: Isometry3<f64>,
}

impl WallModel {
    /// Builds the model of a wall.
    ///
    /// # Errors
    /// [`VisionError::Camera`] for a wall that is flat or too large.
    pub fn new(wall: &Wall) -> Result<Self, VisionError> {
        let model = shapes::cuboid(wall.half, 0.0).and_then(|mesh| Model::new(&mesh));
        let model = model.map_err(|source| VisionError::Camera { name: "a wall".into(), source })?;
        Ok(Self { model, world_from_wall: wall.world_from_wall })
    }
}

/// Poses of all bodies in the scene at one instant.
#[derive(Clone, Debug)]
pub struct ScenePose<'a> {
    /// The objects.
    pub objects: Vec<ObjectPose<'a>>,
    /// The walls.
    pub walls: &'a [WallModel],
    /// The grasp frame.
    pub world_from_hand: Isometry3<f64>,
    /// The hand's links; empty to leave the hand out.
    pub world_from_links: Vec<Isometry3<f64>>,
}

impl<'a> ScenePose<'a> {
    /// The current state of `world`. Links without a finite pose (in a simulation that diverged) are left out when it is rendered.
    ///
    /// * `objects`: as for [`ScenePose::objects`].
    #[must_use]
    pub fn of(world: &World, objects: Vec<ObjectPose<'a>>, walls: &'a [WallModel]) -> Self {
        let hand = world.hand();
        let world_from_hand = world.world_from_hand();
        let links = hand.hand_from_links(&world.configuration()).unwrap_or_default();
        Self {
            objects,
            walls,
            world_from_hand,
            world_from_links: links.into_iter().map(|link| world_from_hand * link).collect(),
        }
    }
}

impl VisualModels {
    /// Builds the models of `hand`, table and ground.
    ///
    /// # Errors
    /// [`VisionError`] for a hand with a shape that cannot be rendered, or with more links than there are labels (252).
    pub fn new(hand: &Hand) -> Result<Self, VisionError> {
        in_range("number of links of the hand", hand.links.len() as f64, 1.0..=f64::from(u8::MAX - FIRST_LINK), "")?;
        let make = || {
            let mut parts = Vec::new();
            for link in 0..hand.links.len() {
                for material in [Material::Bare, Material::Pad] {
                    parts.extend(part(hand, link, material)?);
                }
                parts.extend(knuckle(hand, link)?);
            }
            let table = Some(scenery()?);
            Ok(Self { parts, table })
        };
        make().map_err(|source| VisionError::Camera { name: format!("the hand {:?}", hand.name), source })
    }

    /// Models without a hand, with or without table and ground.
    ///
    /// # Errors
    /// None.
    pub fn bare(table: bool) -> Result<Self, VisionError> {
        let table = table.then(scenery).transpose();
        let table = table.map_err(|source| VisionError::Camera { name: "the table".into(), source })?;
        Ok(Self { parts: Vec::new(), table })
    }

    /// The hand alone; links without a finite pose are left out.
    pub fn hand<'a>(&'a self, world_from_links: &'a [Isometry3<f64>]) -> impl Iterator<Item = Instance<'a>> {
        let instance = |part: &'a Part| {
            Some(Instance {
                model: &part.model,
                world_from_model: *world_from_links.get(part.link)?,
                color: part.color,
                label: FIRST_LINK + part.link as u8,
                casts_shadow: true,
            })
        };
        let all = self.parts.iter().filter_map(instance);
        all.filter(|i| is_near(&i.world_from_model))
    }

    /// All instances to render; those without a finite pose are left out.
    #[must_use]
    pub fn instances<'a>(&'a self, scene_pose: &'a ScenePose) -> Vec<Instance<'a>> {
        let objects = scene_pose.objects.iter().map(ObjectPose::instance);
        let walls = scene_pose.walls.iter().map(|wall| Instance {
            model: &wall.model,
            world_from_model: wall.world_from_wall,
            color: WALL_COLOR,
            label: TABLE,
            casts_shadow: true,
        });
        let middles = [-TABLE_THICKNESS * 0.5, -TABLE_HEIGHT - TABLE_THICKNESS * 0.5];
        let heights = middles.into_iter().zip([TABLE_COLOR, GROUND_COLOR]);
        let scenery = self.table.iter().flatten().zip(heights).map(|(model, (z, color))| Instance {
            model,
            world_from_model: Isometry3::translation(0.0, 0.0, z),
            color,
            label: TABLE,
            casts_shadow: false,
        });
        let mut all = Vec::with_capacity(self.parts.len() + scene_pose.objects.len() + scene_pose.walls.len() + 2);
        // Roughly front to back, to overwrite fewer pixels.
        all.extend(self.hand(&scene_pose.world_from_links));
        all.extend(objects.filter(|instance| is_near(&instance.world_from_model)));
        all.extend(walls);
        all.extend(scenery);
        all
    }
}

/// Table top and ground.
fn scenery() -> Result<[Model; 2], CameraError> {
    let slab = |side: f64| {
        let half = Vector3::new(side, side, TABLE_THICKNESS) * 0.5;
        Model::new(&shapes::cuboid(half, 0.0)?)
    };
    Ok([slab(TABLE_SIDE)?, slab(GROUND_SIDE)?])
}

/// True if the renderer accepts the pose: finite, rigid, within 1 km.
pub(crate) fn is_near(pose: &Isometry3<f64>) -> bool {
    let translation = pose.translation.vector.iter().all(|x| x.abs() < 1e3);
    translation && (pose.rotation.coords.norm() - 1.0).abs() < 1e-6
}

/// The shapes of one material of a link as one model; `None` if the link has none.
fn part(hand: &Hand, link: usize, material: Material) -> Result<Option<Part>, CameraError> {
    let colliders = hand.links[link].colliders.iter().filter(|c| c.material == material);
    let (mut vertices, mut faces) = (Vec::new(), Vec::new());
    for collider in colliders {
        let mesh = solid(collider)?;
        let first = vertices.len() as u32;
        vertices.extend(mesh.vertices().iter().map(|v| collider.link_from_shape * v));
        faces.extend(mesh.faces().iter().map(|f| f.map(|v| v + first)));
    }
    if faces.is_empty() {
        return Ok(None);
    }
    let model = Model::new(&TriMesh::new(vertices, faces)?)?;
    let color = color(hand, link, material);
    Ok(Some(Part { link, model, color }))
}

/// A cylinder about the joint axis of a finger link. It fills the gap between the collision shapes in images; it has no collision shape.
fn knuckle(hand: &Hand, link: usize) -> Result<Option<Part>, CameraError> {
    let Some(joint) = hand.joints.iter().find(|j| j.child == link && j.kind == JointKind::Revolute) else {
        return Ok(None);
    };
    let least = |collider: &Collider| match collider.shape {
        Shape::Cuboid(half) if collider.material == Material::Bare => Some(half.min()),
        _ => None,
    };
    let Some(half) = hand.links[link].colliders.iter().find_map(least) else {
        return Ok(None);
    };
    let along = Rotation3::rotation_between(&Vector3::z(), &joint.axis).unwrap_or_else(|| {
        // Opposite directions: a cylinder is symmetric.
        Rotation3::identity()
    });
    let [width, radius] = KNUCKLE.map(|share| share * half);
    let mesh = shapes::cylinder(radius, width, KNUCKLE_COLUMNS)?;
    let turned = Isometry3::from_parts(Translation3::identity(), along.into());
    Ok(Some(Part { link, model: Model::new(&mesh.transformed(&turned))?, color: KNUCKLE_COLOR }))
}

fn solid(collider: &Collider) -> Result<TriMesh, CameraError> {
    match collider.shape {
        Shape::Cuboid(half) => shapes::cuboid(half, (BEVEL_SHARE * half.min()).min(MOST_BEVEL)),
        Shape::Cylinder { radius, half_length } => shapes::cylinder(radius, half_length, COLUMNS),
        Shape::Sphere { radius } => shapes::sphere(radius, COLUMNS),
    }
}

fn color(hand: &Hand, link: usize, material: Material) -> [f32; 3] {
    match (hand.chain_of_link(link), material) {
        (None, Material::Bare) => BASE_COLOR,
        (None, Material::Pad) => PALM_COLOR,
        (Some(_), Material::Pad) => PAD_COLOR,
        (Some(_), Material::Bare) if hand.is_tip(hand.carrier(link)) => TIP_COLOR,
        (Some(_), Material::Bare) => LINK_COLOR,
    }
}
