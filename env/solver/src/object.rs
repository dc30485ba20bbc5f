//! The free object: convex parts, mass and inertia.

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use parry3d::shape::SharedShape;
use std::f64::consts::FRAC_PI_2;

use crate::tree::Primitive;
use crate::units;

/// A convex part of the object, in the object's frame, metres.
#[derive(Clone, Debug)]
pub enum ObjectPart {
    /// A closed convex polyhedron.
    Hull {
        /// Corners.
        vertices: Vec<Point3<f64>>,
        /// Triangles, counter-clockwise from outside.
        faces: Vec<[u32; 3]>,
    },
    /// A primitive, centred on the frame.
    Primitive(Primitive),
}

/// The free object.
#[derive(Clone, Debug)]
pub struct Object {
    /// Convex parts.
    pub parts: Vec<ObjectPart>,
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass, object frame, metres.
    pub center: Point3<f64>,
    /// Inertia about the centre of mass, axes of the object, kg m2.
    pub inertia: Matrix3<f64>,
    pub friction: f64,
}

impl ObjectPart {
    /// The part as a parry shape, and its pose in the object; `None` for a hull without volume.
    pub(crate) fn shape(&self) -> Option<(SharedShape, Isometry3<f64>)> {
        match self {
            Self::Primitive(primitive) => Some(primitive.shape()),
            Self::Hull { vertices, faces } => {
                let vertices = vertices.iter().map(units::point).collect();
                // Parry's own hull of the vertices drops vertices of flat sides.
                Some((SharedShape::convex_mesh(vertices, faces)?, Isometry3::identity()))
            }
        }
    }
}

impl Primitive {
    /// The primitive as a parry shape, and its pose in the part's frame: parry's cylinders have their axis along y.
    pub(crate) fn shape(&self) -> (SharedShape, Isometry3<f64>) {
        match *self {
            Self::Cuboid(half) => {
                let half = units::lengths(&half);
                (SharedShape::cuboid(half.x, half.y, half.z), Isometry3::identity())
            }
            Self::Sphere { radius } => (SharedShape::ball(units::length(radius)), Isometry3::identity()),
            Self::Cylinder { radius, half_length } => {
                let shape = SharedShape::cylinder(units::length(half_length), units::length(radius));
                (shape, Isometry3::rotation(Vector3::x() * FRAC_PI_2))
            }
        }
    }
}

/// Corners on each rim of a cylinder, for contacts with planes: their chords are within 1 % of the radius of the rim.
const RIM_CORNERS: usize = 24;

/// Corners of a convex shape in its own frame, metres, and the radius of a ball about each of them.
pub(crate) fn corners(shape: &SharedShape) -> (Vec<Vector3<f64>>, f64) {
    if let Some(hull) = shape.as_convex_polyhedron() {
        return (hull.points().iter().map(|p| units::metres64(*p)).collect(), 0.0);
    }
    if let Some(cuboid) = shape.as_cuboid() {
        let half = units::metres64(cuboid.half_extents);
        let side = |i: usize, bit: usize| if i >> bit & 1 == 0 { -1.0 } else { 1.0 };
        let corner = |i| half.component_mul(&Vector3::new(side(i, 0), side(i, 1), side(i, 2)));
        return ((0..8).map(corner).collect(), 0.0);
    }
    if let Some(ball) = shape.as_ball() {
        return (vec![Vector3::zeros()], units::metres(ball.radius));
    }
    if let Some(cylinder) = shape.as_cylinder() {
        let (half, radius) = (units::metres(cylinder.half_height), units::metres(cylinder.radius));
        let corner = |i: usize| {
            let angle = (i / 2) as f64 / RIM_CORNERS as f64 * std::f64::consts::TAU;
            Vector3::new(radius * angle.cos(), if i.is_multiple_of(2) { -half } else { half }, radius * angle.sin())
        };
        return ((0..2 * RIM_CORNERS).map(corner).collect(), 0.0);
    }
    (Vec::new(), 0.0)
}
