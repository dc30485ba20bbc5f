//! Rapier's collision shapes of the object and of the hand's links.

use super::frames;
use crate::SimError;
use crate::object::Geometry;
use graspbox_hand::{Collider, Shape};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use rapier3d::math::{Pose, Rotation};
use rapier3d::prelude::SharedShape;
use std::f64::consts::FRAC_PI_2;

/// The object's collision shape in its own frame.
///
/// # Errors
/// [`SimError::NoParts`], or [`SimError::FlatPart`] as of object 0.
pub(crate) fn object(geometry: &Geometry) -> Result<SharedShape, SimError> {
    let cylinder_up = Pose::from_rotation(Rotation::from_rotation_x(std::f32::consts::FRAC_PI_2));
    Ok(match geometry {
        Geometry::Cuboid(h) => {
            let h = frames::lengths(h);
            SharedShape::cuboid(h.x, h.y, h.z)
        }
        Geometry::Ball { radius } => SharedShape::ball(frames::length(*radius)),
        Geometry::Cylinder { radius, half_length } => SharedShape::compound(vec![(
            cylinder_up,
            SharedShape::cylinder(frames::length(*half_length), frames::length(*radius)),
        )]),
        Geometry::Parts(parts) => {
            let mut shapes = Vec::with_capacity(parts.len());
            for (part, hull) in parts.iter().enumerate() {
                // Parry's own hull of the vertices drops vertices of flat sides.
                let vertices = hull.vertices().iter().map(frames::point).collect();
                let hull =
                    SharedShape::convex_mesh(vertices, hull.faces()).ok_or(SimError::FlatPart { object: 0, part })?;
                shapes.push((Pose::IDENTITY, hull));
            }
            match shapes.len() {
                0 => return Err(SimError::NoParts),
                1 => shapes.swap_remove(0).1,
                _ => SharedShape::compound(shapes),
            }
        }
    })
}

/// The collision shape of one collider of a link.
pub(crate) fn of_link(shape: &Shape) -> SharedShape {
    match *shape {
        Shape::Cuboid(h) => {
            let h = frames::lengths(&h);
            SharedShape::cuboid(h.x, h.y, h.z)
        }
        Shape::Sphere { radius } => SharedShape::ball(frames::length(radius)),
        Shape::Cylinder { radius, half_length } => {
            SharedShape::cylinder(frames::length(half_length), frames::length(radius))
        }
    }
}

/// Pose of rapier's shape of a collider in its link: rapier's cylinders have their axis along y, URDF's along z.
pub(crate) fn link_from_engine(collider: &Collider) -> Isometry3<f64> {
    match collider.shape {
        Shape::Cylinder { .. } => {
            collider.link_from_shape * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), FRAC_PI_2)
        }
        Shape::Cuboid(_) | Shape::Sphere { .. } => collider.link_from_shape,
    }
}
