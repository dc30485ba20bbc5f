//! An object: collision geometry, mass and inertia, in the object frame.

use crate::SimError;
use graspbox_mesh::TriMesh;
use nalgebra::{Matrix3, Point3, Vector3};
use std::any::Any;
use std::sync::{Arc, Mutex, PoisonError};

/// Collision geometry in the object's frame.
#[derive(Clone, Debug, PartialEq)]
pub enum Geometry {
    /// Convex parts, each a closed hull from [`graspbox_mesh::convex_hull`].
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

/// The physical model of an object.
#[derive(Clone, Debug)]
pub struct ObjectModel {
    geometry: Geometry,
    mass: f64,
    center_of_mass: Point3<f64>,
    inertia: Matrix3<f64>,
    /// Collision shapes of each engine, made at first use and shared by all copies: one entry per type.
    shapes: Arc<Mutex<Vec<Arc<dyn Any + Send + Sync>>>>,
}

impl ObjectModel {
    /// Creates an object from geometry, mass (kg), centre of mass (object frame, m) and inertia about it (axes of the object frame, kg m2).
    ///
    /// # Errors
    /// [`SimError::NoParts`] or [`SimError::BadMass`].
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
        if matches!(geometry, Geometry::Parts(parts) if parts.is_empty()) {
            return Err(SimError::NoParts);
        }
        Ok(Self { geometry: geometry.clone(), mass, center_of_mass, inertia, shapes: Arc::default() })
    }

    /// Radius of a sphere about the centre of mass that contains the object, metres.
    pub fn radius(&self) -> f64 {
        let aside = self.center_of_mass.coords.norm();
        match &self.geometry {
            Geometry::Parts(parts) => {
                let vertices = parts.iter().flat_map(|part| part.vertices());
                vertices.map(|vertex| (vertex - self.center_of_mass).norm()).fold(0.0, f64::max)
            }
            Geometry::Cuboid(half) => aside + half.norm(),
            Geometry::Ball { radius } => aside + radius,
            Geometry::Cylinder { radius, half_length } => aside + radius.hypot(*half_length),
        }
    }

    /// A solid primitive of uniform density with mass `mass` (kg).
    ///
    /// # Errors
    /// As [`ObjectModel::new`]; [`SimError::NoParts`] for [`Geometry::Parts`], whose inertia must come from the mesh.
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

    /// Inertia about the centre of mass, axes of the object frame, kg m2.
    pub fn inertia(&self) -> Matrix3<f64> {
        self.inertia
    }

    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// An engine's collision shapes: `make` is called once per object and type `T`.
    ///
    /// # Errors
    /// Those of `make`, which the next call then tries again.
    pub(crate) fn shapes<T: Any + Send + Sync>(
        &self,
        make: impl FnOnce(&Geometry) -> Result<T, SimError>,
    ) -> Result<Arc<T>, SimError> {
        // A poisoned lock is harmless: an entry is complete before it is pushed.
        let mut shapes = self.shapes.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(found) = shapes.iter().find_map(|entry| Arc::clone(entry).downcast::<T>().ok()) {
            return Ok(found);
        }
        let made = Arc::new(make(&self.geometry)?);
        shapes.push(made.clone());
        Ok(made)
    }
}
