//! Volume, centre of mass and inertia of the solid that a mesh bounds, of uniform density.

use crate::clean::{compact, is_closed};
use crate::error::{MeshError, require};
use crate::hull::convex_hull;
use crate::trimesh::TriMesh;
use nalgebra::{Matrix3, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// How heavy the solid is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Mass {
    /// In all, kg.
    Kilograms(f64),
    /// kg/m3.
    Density(f64),
}

/// Which solid the figures are of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum MassMethod {
    /// The mesh itself, which is closed: exact.
    Closed,
    /// The convex parts given in its place; where two overlap, the overlap counts twice.
    ConvexParts,
    /// Its convex hull, because the mesh is open.
    ConvexHull,
}

/// Mass properties of a rigid body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct MassProperties {
    /// kg.
    pub mass: f64,
    /// m3.
    pub volume: f64,
    /// In the mesh's frame, metres.
    pub center_of_mass: Point3<f64>,
    /// About the centre of mass, along the mesh's axes, kg m2.
    pub inertia: Matrix3<f64>,
    /// Which solid this is.
    pub method: MassMethod,
}

/// Mass properties of the solid inside `mesh`.
///
/// A closed mesh is integrated exactly (signed tetrahedra), whichever way it is turned. An open mesh bounds nothing: its
/// convex hull is used instead, as [`MassProperties::method`] reports.
///
/// # Errors
/// [`MeshError::BadParameter`] for a mass or density that is not positive and finite; [`MeshError::Flat`] when there is no
/// volume at all.
pub fn mass_properties(mesh: &TriMesh, mass: Mass) -> Result<MassProperties, MeshError> {
    // Vertices without a face bound nothing: they must count neither for the size nor for the hull.
    let used = compact(mesh.vertices(), mesh.faces().to_vec())?;
    let closed = is_closed(mesh).then(|| Moments::of(&[mesh], reference(&used)));
    let size = used.extent();
    // A closed sheet (two sides of the same paper) has no volume either.
    if let Some(moments) = closed.filter(|m| m.volume.abs() > 1e-9 * size.powi(3)) {
        return finish(moments, mass, MassMethod::Closed);
    }
    let hull = convex_hull(used.vertices())?;
    finish(Moments::of(&[&hull], reference(&hull)), mass, MassMethod::ConvexHull)
}

/// Mass properties of a union of closed parts, as [`crate::convex_parts`] gives them; the fallback for open meshes that are
/// far from convex.
///
/// # Errors
/// As [`mass_properties`]; [`MeshError::Empty`] without parts.
pub fn mass_properties_of_parts(parts: &[TriMesh], mass: Mass) -> Result<MassProperties, MeshError> {
    let first = parts.first().ok_or(MeshError::Empty)?;
    let all: Vec<&TriMesh> = parts.iter().collect();
    finish(Moments::of(&all, reference(first)), mass, MassMethod::ConvexParts)
}

/// Integrals of 1, x and x x^T over a solid, about a reference point near it.
struct Moments {
    reference: Point3<f64>,
    volume: f64,
    first: Vector3<f64>,
    second: Matrix3<f64>,
}

impl Moments {
    /// Sums signed tetrahedra from the reference point to every face.
    ///
    /// For corners 0, a, b, c and six times the volume d: the integral of x is d (a + b + c) / 24, that of x x^T is
    /// d ((a + b + c)(a + b + c)^T + a a^T + b b^T + c c^T) / 120.
    fn of(meshes: &[&TriMesh], reference: Point3<f64>) -> Self {
        let (mut volume, mut first, mut second) = (0.0, Vector3::zeros(), Matrix3::zeros());
        for mesh in meshes {
            for face in 0..mesh.faces().len() {
                let [a, b, c] = mesh.triangle(face).map(|p| p - reference);
                let d = a.dot(&b.cross(&c));
                let sum = a + b + c;
                volume += d / 6.0;
                first += sum * (d / 24.0);
                second +=
                    (sum * sum.transpose() + a * a.transpose() + b * b.transpose() + c * c.transpose()) * (d / 120.0);
            }
        }
        Self { reference, volume, first, second }
    }
}

/// A point near the mesh: integrals about it do not lose digits when the object lies far from the origin.
fn reference(mesh: &TriMesh) -> Point3<f64> {
    let aabb = mesh.aabb();
    nalgebra::center(&aabb.min, &aabb.max)
}

fn finish(moments: Moments, mass: Mass, method: MassMethod) -> Result<MassProperties, MeshError> {
    let Moments { reference, volume: signed, first, second } = moments;
    // An inside-out mesh has every integral negated.
    let volume = signed.abs();
    if volume == 0.0 {
        return Err(MeshError::Flat { count: 0 });
    }
    let (mass, density) = match mass {
        Mass::Kilograms(m) => (positive("mass", m)?, m / volume),
        Mass::Density(rho) => (positive("density", rho)? * volume, rho),
    };
    let offset = first / signed;
    let about_com = second * signed.signum() - offset * offset.transpose() * volume;
    let inertia = (Matrix3::identity() * about_com.trace() - about_com) * density;
    let inertia = (inertia + inertia.transpose()) * 0.5;
    Ok(MassProperties { mass, volume, center_of_mass: reference + offset, inertia, method })
}

fn positive(name: &'static str, value: f64) -> Result<f64, MeshError> {
    require(value.is_finite() && value > 0.0, name, value, "it must be positive and finite").map(|()| value)
}
