//! The object to grasp: collision geometry, mass and inertia, in its own frame.

use crate::{SimError, frames};
use graspbox_mesh::TriMesh;
use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use rapier3d::prelude::{MassProperties, SharedShape};
use std::sync::Arc;

/// Collision geometry in the object's frame.
#[derive(Clone, Debug, PartialEq)]
pub enum Geometry {
    /// Convex parts, each a closed convex hull as [`graspbox_mesh::convex_hull`] makes it.
    Parts(Arc<[TriMesh]>),
    /// A box by its half extents, centred on the frame.
    Cuboid(Vector3<f64>),
    /// A ball centred on the frame.
    Ball {
        /// Radius, metres.
        radius: f64,
    },
    /// A cylinder about z, centred on the frame.
    Cylinder {
        /// Radius, metres.
        radius: f64,
        /// Half its length, metres.
        half_length: f64,
    },
}

/// An object as the simulation knows it.
#[derive(Clone, Debug)]
pub struct ObjectModel {
    pub(crate) shape: SharedShape,
    pub(crate) mass_properties: MassProperties,
    mass: f64,
    center_of_mass: Point3<f64>,
}

impl ObjectModel {
    /// Takes geometry, mass (kg), centre of mass (object frame, m) and inertia about it (axes of the object frame, kg m2).
    ///
    /// # Errors
    /// [`SimError::NoParts`], [`SimError::FlatPart`] or [`SimError::BadMass`].
    pub fn new(
        geometry: &Geometry,
        mass: f64,
        center_of_mass: Point3<f64>,
        inertia: Matrix3<f64>,
    ) -> Result<Self, SimError> {
        if !(mass.is_finite() && mass > 0.0) {
            return Err(SimError::BadMass { what: "mass", value: mass });
        }
        let least = inertia.symmetric_eigenvalues().min();
        if !(least.is_finite() && least > 0.0) {
            return Err(SimError::BadMass { what: "inertia", value: least });
        }
        let shape = shape_of(geometry)?;
        let mass_properties =
            MassProperties::with_inertia_matrix(frames::point(&center_of_mass), mass as f32, frames::inertia(&inertia));
        Ok(Self { shape, mass_properties, mass, center_of_mass })
    }

    /// A solid primitive of uniform density with mass `mass` (kg).
    ///
    /// # Errors
    /// As [`ObjectModel::new`]; [`Geometry::Parts`] is refused as [`SimError::NoParts`], since its inertia must come from the mesh.
    pub fn solid(geometry: &Geometry, mass: f64) -> Result<Self, SimError> {
        let diagonal = match geometry {
            Geometry::Parts(_) => return Err(SimError::NoParts),
            Geometry::Cuboid(h) => {
                let s = h.component_mul(h);
                Vector3::new(s.y + s.z, s.x + s.z, s.x + s.y) / 3.0
            }
            Geometry::Ball { radius } => Vector3::repeat(0.4 * radius * radius),
            Geometry::Cylinder { radius, half_length } => {
                let side = radius * radius / 4.0 + half_length * half_length / 3.0;
                Vector3::new(side, side, radius * radius / 2.0)
            }
        };
        Self::new(geometry, mass, Point3::origin(), Matrix3::from_diagonal(&(diagonal * mass)))
    }

    /// Mass, kg.
    pub fn mass(&self) -> f64 {
        self.mass
    }

    /// Centre of mass, object frame, metres.
    pub fn center_of_mass(&self) -> Point3<f64> {
        self.center_of_mass
    }

    /// Height of the lowest point of the collision geometry above the table when the object is posed at `world_from_object`.
    pub fn lowest_point(&self, world_from_object: &Isometry3<f64>) -> f64 {
        frames::metres(self.shape.compute_aabb(&frames::pose(world_from_object)).mins.z)
    }
}

fn shape_of(geometry: &Geometry) -> Result<SharedShape, SimError> {
    use rapier3d::math::Pose;
    let cylinder_up = Pose::from_rotation(rapier3d::math::Rotation::from_rotation_x(std::f32::consts::FRAC_PI_2));
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
                // The engine's own hull leaves points of flat sides out.
                let vertices = hull.vertices().iter().map(frames::point).collect();
                let hull = SharedShape::convex_mesh(vertices, hull.faces()).ok_or(SimError::FlatPart { part })?;
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
