//! From a mesh to what the simulation needs: a cleaned surface, convex parts, mass and inertia.

use crate::EpisodeError;
use graspbox_mesh::{CleanOptions, Mass, MassProperties, PartsParams, TriMesh, convex_hull};
use graspbox_plan::Obstacle;
use graspbox_sim::{Geometry, ObjectModel};
use nalgebra::Point3;
use std::path::Path;
use std::sync::Arc;

/// Density of an object without a published mass, kg/m3: our choice, since household objects are hollow
/// or filled loosely.
pub const DEFAULT_DENSITY: f64 = 400.0;

/// An object as it is given.
#[derive(Clone, Debug)]
pub struct ObjectSpec {
    /// Name.
    pub name: String,
    /// Surface, object frame, metres.
    pub mesh: TriMesh,
    /// Mass, kg; [`DEFAULT_DENSITY`] fills the mesh where none is given.
    pub mass: Option<f64>,
    /// Convex parts as points, where the maker of the object knows them better than a decomposition would.
    pub parts: Option<Vec<Vec<Point3<f64>>>>,
}

/// An object ready to be simulated.
#[derive(Clone, Debug)]
pub struct Body {
    name: String,
    mesh: TriMesh,
    parts: Arc<[TriMesh]>,
    mass: MassProperties,
    model: ObjectModel,
    obstacle: Arc<Obstacle>,
}

impl Body {
    /// Cleans the mesh, cuts it into convex parts (kept in the folder `cache`, if given) and weighs it.
    ///
    /// An open mesh bounds no solid: its mass is then spread over its convex parts, as `mass_properties().method` says.
    ///
    /// # Errors
    /// A mesh that cannot be repaired or spans no volume, or an impossible mass.
    pub fn prepare(spec: &ObjectSpec, cache: Option<&Path>) -> Result<Self, EpisodeError> {
        let mesh_error = |source| EpisodeError::Mesh { object: spec.name.clone(), source };
        let (mesh, report) = graspbox_mesh::clean(&spec.mesh, &CleanOptions::default()).map_err(mesh_error)?;
        let mass = spec.mass.map_or(Mass::Density(DEFAULT_DENSITY), Mass::Kilograms);
        let hulls = match &spec.parts {
            Some(parts) => parts.iter().map(|points| convex_hull(points)).collect::<Result<Vec<_>, _>>(),
            None => graspbox_mesh::convex_parts(&mesh, &PartsParams::default(), cache).map(|cut| cut.parts),
        };
        let parts: Arc<[TriMesh]> = hulls.map_err(mesh_error)?.into();
        let mass = if report.watertight {
            graspbox_mesh::mass_properties(&mesh, mass)
        } else {
            graspbox_mesh::mass_properties_of_parts(&parts, mass)
        };
        let mass = mass.map_err(mesh_error)?;
        let model =
            ObjectModel::new(&Geometry::Parts(Arc::clone(&parts)), mass.mass, mass.center_of_mass, mass.inertia)
                .map_err(|source| EpisodeError::Sim { object: spec.name.clone(), source })?;
        let obstacle =
            Obstacle::new(&mesh, &parts).map_err(|source| EpisodeError::Plan { object: spec.name.clone(), source })?;
        Ok(Self { name: spec.name.clone(), mesh, parts, mass, model, obstacle: Arc::new(obstacle) })
    }

    /// Name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The cleaned surface, object frame, metres.
    pub fn mesh(&self) -> &TriMesh {
        &self.mesh
    }

    /// Convex parts, each a closed hull, object frame, metres. Simulation and collision filter share them.
    pub fn parts(&self) -> &[TriMesh] {
        &self.parts
    }

    /// The mesh and its convex parts, ready for collision queries wherever the object rests.
    pub fn obstacle(&self) -> &Arc<Obstacle> {
        &self.obstacle
    }

    /// Mass, centre of mass, inertia, and how they were found.
    pub fn mass_properties(&self) -> &MassProperties {
        &self.mass
    }

    /// What the simulation takes.
    pub fn model(&self) -> &ObjectModel {
        &self.model
    }
}
