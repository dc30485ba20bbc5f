//! From a mesh to the model that is simulated: a cleaned surface, convex parts, mass and inertia.

use crate::EpisodeError;
use graspbox_hand::Hand;
use graspbox_mesh::{CleanOptions, Mass, MassProperties, PartsParams, TriMesh, convex_hull, in_range};
use graspbox_plan::Obstacle;
use graspbox_sim::scenery::TABLE_SIDE;
use graspbox_sim::{Geometry, ObjectModel};
use nalgebra::{Isometry3, Point3, Vector3};
use std::path::Path;
use std::sync::Arc;

/// Density of an object without a known mass, kg/m3: a choice, since household objects are hollow or loosely filled.
pub const DEFAULT_DENSITY: f64 = 400.0;

/// Tolerance of [`Body::rests_at`], metres: an object within this distance of the table touches it.
pub const TOUCHING: f64 = 0.002;
/// Least length of the longest side of an object, metres: ten times the penetration cap of contacts.
pub const LEAST_SIDE: f64 = 0.005;
/// Greatest length of the shortest side of an object, as a multiple of the width of the open hand. Meshes of larger objects are probably in
/// another unit.
pub const SPANS: f64 = 2.0;
/// Least mass of an object, kg: less than a grain of rice.
pub const LEAST_MASS: f64 = 1e-5;
/// Greatest mass of an object, kg: several times the payload of a hand on one arm.
pub const GREATEST_MASS: f64 = 25.0;
/// Density of osmium, the densest element, kg/m3.
pub const DENSEST: f64 = 22_590.0;

/// Input of [`Body::prepare`].
#[derive(Clone, Debug)]
pub struct ObjectSpec {
    pub name: String,
    /// Surface, object frame, metres.
    pub mesh: TriMesh,
    /// Mass, kg; `None` for the mass of a solid of [`DEFAULT_DENSITY`].
    pub mass: Option<f64>,
    /// Convex parts as points, if they are known; `None` to decompose the mesh.
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
    /// Cleans the mesh, decomposes it into convex parts (cached in the folder `cache`, if there is one) and computes its mass properties:
    /// [`graspbox_mesh::mass_properties`] of the enclosed volume.
    ///
    /// # Errors
    /// [`EpisodeError::Mesh`] for a mesh that cannot be repaired or has no volume, [`EpisodeError::Sim`] for an invalid mass,
    /// [`EpisodeError::Plan`] for a mesh that cannot be queried.
    pub fn prepare(spec: &ObjectSpec, cache: Option<&Path>) -> Result<Self, EpisodeError> {
        Self::prepare_with(spec, &PartsParams::default(), cache)
    }

    /// As [`Body::prepare`], with other parts.
    ///
    /// # Errors
    /// As [`Body::prepare`]; [`EpisodeError::Mesh`] also for settings of the parts out of range.
    pub fn prepare_with(spec: &ObjectSpec, params: &PartsParams, cache: Option<&Path>) -> Result<Self, EpisodeError> {
        let mesh_error = |source| EpisodeError::Mesh { object: spec.name.clone(), source };
        let (mesh, _) = graspbox_mesh::clean(&spec.mesh, &CleanOptions::default()).map_err(mesh_error)?;
        let mass = spec.mass.map_or(Mass::Density(DEFAULT_DENSITY), Mass::Kilograms);
        let hulls = match &spec.parts {
            Some(parts) => parts.iter().map(|points| convex_hull(points)).collect::<Result<Vec<_>, _>>(),
            None => graspbox_mesh::convex_parts(&mesh, params, cache).map(|cut| cut.parts),
        };
        let parts: Arc<[TriMesh]> = hulls.map_err(mesh_error)?.into();
        let mass = graspbox_mesh::mass_properties(&mesh, mass).map_err(mesh_error)?;
        Self::assemble(spec.name.clone(), mesh, parts, mass)
    }

    /// A body of what an earlier [`Body::prepare`] made.
    ///
    /// * `mesh`, `parts`, `mass`: those of that body.
    ///
    /// # Errors
    /// [`EpisodeError::Sim`] or [`EpisodeError::Plan`] for what no body has.
    pub fn assemble(
        name: String,
        mesh: TriMesh,
        parts: Arc<[TriMesh]>,
        mass: MassProperties,
    ) -> Result<Self, EpisodeError> {
        let model =
            ObjectModel::new(&Geometry::Parts(Arc::clone(&parts)), mass.mass, mass.center_of_mass, mass.inertia)
                .map_err(|source| EpisodeError::Sim { object: name.clone(), source })?;
        let obstacle =
            Obstacle::new(&mesh, &parts).map_err(|source| EpisodeError::Plan { object: name.clone(), source })?;
        Ok(Self { name, mesh, parts, mass, model, obstacle: Arc::new(obstacle) })
    }

    /// The object with every length times `scale`, of the same density.
    ///
    /// # Errors
    /// [`EpisodeError::OutOfRange`] for a scale outside 0.001 to 1000, [`EpisodeError::Sim`] for an object that is too small to simulate then.
    pub fn scaled(&self, scale: f64) -> Result<Self, EpisodeError> {
        in_range("scale", scale, 1e-3..=1e3, "")?;
        let (of, cube) = (&self.mass, scale.powi(3));
        let mass = MassProperties {
            mass: of.mass * cube,
            volume: of.volume * cube,
            center_of_mass: of.center_of_mass * scale,
            inertia: of.inertia * (cube * scale * scale),
            method: of.method,
        };
        let parts = self.parts.iter().map(|part| part.scaled(scale)).collect();
        Self::assemble(self.name.clone(), self.mesh.scaled(scale), parts, mass)
    }

    /// Checks that the object fits table and hand in size and mass. Nearly always, one that does not is a file in another unit.
    ///
    /// * The longest side of the bounds is between [`LEAST_SIDE`] and the table's.
    /// * The shortest side is at most [`SPANS`] times the width of the open hand.
    /// * At least one convex part is no wider than the open hand: the fingers cannot oppose each other across a wider part. So a large crate
    ///   passes (the hand can hold its wall), and a solid block of the same size does not.
    /// * The mass is between [`LEAST_MASS`] and [`GREATEST_MASS`], and at most that of the bounds filled with [`DENSEST`].
    ///
    /// # Errors
    /// [`EpisodeError::BadSize`] or [`EpisodeError::BadMass`].
    pub fn check_fits(&self, hand: &Hand) -> Result<(), EpisodeError> {
        let bounds = self.mesh.aabb();
        let sides = bounds.max - bounds.min;
        let span = hand.open_span().map_err(|source| EpisodeError::Hand { hand: hand.name.clone(), source })?;
        let size = |why| Err(EpisodeError::BadSize { object: self.name.clone(), size: sides.into(), why });
        if sides.max() > TABLE_SIDE {
            return size(format!("the table is {TABLE_SIDE} m and the open hand {span:.2} m wide"));
        }
        if sides.min() > SPANS * span {
            return size(format!("the open hand is {span:.2} m wide"));
        }
        // If the bounds are narrow enough, so is every part.
        if sides.min() > span {
            let narrowest = self.parts.iter().map(narrowest).fold(f64::INFINITY, f64::min);
            if narrowest > span {
                return size(format!(
                    "the open hand is {span:.2} m wide, and the object's narrowest part is {narrowest:.2} m"
                ));
            }
        }
        if sides.max() < LEAST_SIDE {
            return size(format!("objects smaller than {LEAST_SIDE} m cannot be simulated"));
        }
        let mass = self.mass.mass;
        let refused = |why| Err(EpisodeError::BadMass { object: self.name.clone(), mass, why });
        if !(LEAST_MASS..=GREATEST_MASS).contains(&mass) {
            return refused(format!("the mass must be between {LEAST_MASS} and {GREATEST_MASS} kg"));
        }
        let most = DENSEST * sides.product();
        if mass > most {
            return refused(format!("its bounding box filled with osmium would weigh {most:.3} kg"));
        }
        Ok(())
    }

    /// True if the object would rest at `world_from_object`: its lowest point is at the height of the table, and its centre of mass is over its
    /// support polygon, both within [`TOUCHING`]. A geometric test; nothing is simulated.
    pub fn rests_at(&self, world_from_object: &Isometry3<f64>) -> bool {
        /// Number of directions in which the support polygon is tested.
        const SIDES: u32 = 32;
        let points: Vec<Point3<f64>> = self.mesh.vertices().iter().map(|p| world_from_object * p).collect();
        let lowest = points.iter().map(|p| p.z).fold(f64::INFINITY, f64::min);
        let center = world_from_object * self.mass.center_of_mass;
        let carries = |turn: u32| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(turn) / f64::from(SIDES)).sin_cos();
            let along = |p: &Point3<f64>| p.x * cos + p.y * sin;
            let feet = points.iter().filter(|p| p.z - lowest < TOUCHING);
            feet.map(along).fold(f64::NEG_INFINITY, f64::max) >= along(&center) - TOUCHING
        };
        lowest.abs() <= TOUCHING && (0..SIDES).all(carries)
    }

    pub fn name(&self) -> &str {
        &self.name
    }

    /// The cleaned surface, object frame, metres.
    pub fn mesh(&self) -> &TriMesh {
        &self.mesh
    }

    /// Convex parts, each a closed hull, object frame, metres; used by the simulation and the collision filter.
    pub fn parts(&self) -> &[TriMesh] {
        &self.parts
    }

    /// The mesh and its convex parts, prepared for collision queries at any pose.
    pub fn obstacle(&self) -> &Arc<Obstacle> {
        &self.obstacle
    }

    /// Mass, centre of mass, inertia, and the method by which they were computed.
    pub fn mass_properties(&self) -> &MassProperties {
        &self.mass
    }

    /// The physical model for the simulation.
    pub fn model(&self) -> &ObjectModel {
        &self.model
    }
}

/// Least extent of a convex part along its face normals and the axes, metres: an upper bound of its width.
fn narrowest(part: &TriMesh) -> f64 {
    let normals = (0..part.faces().len()).filter_map(|face| part.face_area_vector(face).try_normalize(0.0));
    let axes = (0..3).map(|axis| Vector3::ith(axis, 1.0));
    let extent = |direction: Vector3<f64>| {
        let along = part.vertices().iter().map(|p| p.coords.dot(&direction));
        let [low, high] = along.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)]);
        high - low
    };
    normals.chain(axes).map(extent).fold(f64::INFINITY, f64::min)
}
