//! Models and colours of a hand.

use crate::labels::FIRST_LINK;
use crate::scene::is_near;
use crate::{Instance, Model, RenderError, shapes};
use graspbox_hand::{Collider, Hand, JointKind, Material, Shape};
use graspbox_mesh::{TriMesh, in_range};
use nalgebra::{Isometry3, Rotation3, Translation3, Vector3};

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

const BASE_COLOR: [f32; 3] = [0.36, 0.39, 0.44];
const PALM_COLOR: [f32; 3] = [0.13, 0.36, 0.46];
const LINK_COLOR: [f32; 3] = [0.80, 0.82, 0.85];
const KNUCKLE_COLOR: [f32; 3] = [0.30, 0.32, 0.36];
const TIP_COLOR: [f32; 3] = [0.66, 0.69, 0.74];
const PAD_COLOR: [f32; 3] = [0.15, 0.48, 0.60];

/// A part of a link that has one colour.
struct Part {
    link: usize,
    model: Model,
    color: [f32; 3],
}

/// Render models of a hand's links.
pub struct HandModel {
    parts: Vec<Part>,
}

impl HandModel {
    /// Builds the models of `hand`.
    ///
    /// # Errors
    /// [`RenderError`] for a hand with a shape that cannot be rendered, or with more links than there are labels (252).
    pub fn new(hand: &Hand) -> Result<Self, RenderError> {
        in_range("number of links of the hand", hand.links.len() as f64, 1.0..=f64::from(u8::MAX - FIRST_LINK), "")?;
        let make = || {
            let mut parts = Vec::new();
            for link in 0..hand.links.len() {
                for material in [Material::Bare, Material::Pad] {
                    parts.extend(part(hand, link, material)?);
                }
                parts.extend(knuckle(hand, link)?);
            }
            Ok(Self { parts })
        };
        make().map_err(|error: RenderError| error.of(format!("the hand {:?}", hand.name)))
    }

    /// The links at their poses; those without a finite pose are left out.
    pub fn instances<'a>(&'a self, world_from_links: &'a [Isometry3<f64>]) -> impl Iterator<Item = Instance<'a>> {
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
}

/// The shapes of one material of a link as one model; `None` if the link has none.
fn part(hand: &Hand, link: usize, material: Material) -> Result<Option<Part>, RenderError> {
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
fn knuckle(hand: &Hand, link: usize) -> Result<Option<Part>, RenderError> {
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

fn solid(collider: &Collider) -> Result<TriMesh, RenderError> {
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
