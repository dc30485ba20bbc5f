//! From a mesh to what the simulation needs: a cleaned surface, convex parts, mass and inertia.

use crate::EpisodeError;
use graspbox_hand::Hand;
use graspbox_mesh::{CleanOptions, Mass, MassProperties, PartsParams, TriMesh, convex_hull};
use graspbox_plan::Obstacle;
use graspbox_sim::scenery::TABLE_SIDE;
use graspbox_sim::{Geometry, ObjectModel};
use nalgebra::{Isometry3, Point3, Vector3};
use std::path::Path;
use std::sync::Arc;

/// Density of an object without a published mass, kg/m3: our choice, since household objects are hollow
/// or filled loosely.
pub const DEFAULT_DENSITY: f64 = 400.0;

/// An object within this of the table touches it, metres; it may tilt about a foot of this size.
pub const TOUCHING: f64 = 0.002;
/// Shortest longest side of an object, metres: ten times the depth to which contacts are resolved.
pub const LEAST_SIDE: f64 = 0.005;
/// Greatest shortest side of an object, as a multiple of the width of the open hand: what is larger is a file in another unit rather
/// than a thing to grasp by its wall.
pub const SPANS: f64 = 2.0;
/// Least mass of an object, kg: a grain of rice weighs more.
pub const LEAST_MASS: f64 = 1e-5;
/// Greatest mass of an object, kg: several times what a hand for one arm carries.
pub const GREATEST_MASS: f64 = 25.0;
/// Density of osmium, the densest element, kg/m3.
pub const DENSEST: f64 = 22_590.0;

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

    /// Refuses objects whose size or mass is no matter of hands and tables: nearly always a file in another unit.
    ///
    /// * The longest side of the bounds is between [`LEAST_SIDE`] and the table's.
    /// * The shortest side is at most [`SPANS`] times the width of the open hand.
    /// * At least one convex part is no wider than the open hand: fingers cannot oppose each other across a wider one. So a large crate
    ///   passes (a hand can hold its wall), and a solid block of the same size does not.
    /// * The mass is between [`LEAST_MASS`] and [`GREATEST_MASS`], and no greater than that of bounds filled with [`DENSEST`].
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
        // Where the bounds are narrow enough, so is a part.
        if sides.min() > span {
            let narrowest = self.parts.iter().map(narrowest).fold(f64::INFINITY, f64::min);
            if narrowest > span {
                return size(format!(
                    "the open hand is {span:.2} m wide and no part of it is narrower than {narrowest:.2} m"
                ));
            }
        }
        if sides.max() < LEAST_SIDE {
            return size(format!("what is smaller than {LEAST_SIDE} m cannot be simulated"));
        }
        let mass = self.mass.mass;
        let refused = |why| Err(EpisodeError::BadMass { object: self.name.clone(), mass, why });
        if !(LEAST_MASS..=GREATEST_MASS).contains(&mass) {
            return refused(format!("objects weigh between {LEAST_MASS} and {GREATEST_MASS} kg"));
        }
        let most = DENSEST * sides.product();
        if mass > most {
            return refused(format!("solid osmium of its outer dimensions would weigh {most:.3} kg"));
        }
        Ok(())
    }

    /// True where the object would stay at `world_from_object` by itself: it touches the table, no deeper or higher than [`TOUCHING`], and
    /// its centre of mass is over what it stands on, give or take as much. Geometry alone decides; nothing is simulated.
    pub fn rests_at(&self, world_from_object: &Isometry3<f64>) -> bool {
        /// Sides of the polygon that is tested for.
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

/// Least extent of a convex part along the normals of its faces and the axes, metres: an upper bound of its width.
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
