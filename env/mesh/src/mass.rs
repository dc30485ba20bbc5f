//! Volume, centre of mass and inertia of the solid that a mesh bounds, of uniform density.
//!
//! | module | purpose |
//! |---|---|
//! | `moments` | integrals over a solid, exact for a closed mesh |
//! | `solid` | the solid of shells that overlap, and of a surface with holes |

pub(crate) mod face_tree;
mod moments;
pub(crate) mod plan_view;
pub mod resting;
mod solid;

use crate::clean::{compact, is_closed};
use crate::error::{MeshError, require};
use crate::hull::convex_hull;
use crate::trimesh::TriMesh;
use moments::Moments;
use nalgebra::{Matrix3, Point3};
use serde::{Deserialize, Serialize};
use solid::{Lines, enclosed};

/// Mass of the solid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Mass {
    /// Total mass, kg.
    Kilograms(f64),
    /// Density, kg/m3.
    Density(f64),
}

/// The solid to which mass properties refer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum MassMethod {
    /// The volume bounded by a closed mesh: exact.
    Closed,
    /// The union of the closed shells of the mesh, which overlap: exact but for the overlap, which is measured along lines.
    Union,
    /// The volume around which an open mesh has a winding number of more than one half, on a grid.
    WindingNumber,
    /// The convex hull of the mesh, because it is open and encloses hardly anything.
    ConvexHull,
}

impl MassMethod {
    /// The substitute for a mesh that is not closed, as a sentence; `None` for the mesh itself.
    pub fn caveat(self) -> Option<&'static str> {
        match self {
            Self::Closed | Self::Union => None,
            Self::WindingNumber => Some(
                "the surface has holes, so that volume, mass, centre of mass and inertia are those of the space that it mostly encloses",
            ),
            Self::ConvexHull => Some(
                "the surface is open and encloses hardly anything, so that volume, mass, centre of mass and inertia are those of its convex hull",
            ),
        }
    }
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

/// Share of the volume that may be wound around more than once before it counts as an overlap: creases of scans are not measured.
const OVERLAP: f64 = 1e-4;
/// Least share of its hull's volume that the solid of an open mesh has: a bag with walls of 0.5 mm has 3 %.
const LEAST_SHARE: f64 = 0.01;

/// Mass properties of the solid inside `mesh`, of uniform density.
///
/// A closed mesh is integrated exactly (signed tetrahedra), regardless of its orientation; where its shells overlap, their union counts
/// once. The solid of an open mesh is the volume that it winds around, or its convex hull if that is almost 0: see
/// [`MassProperties::method`]. An open mesh, and one of many shells, must be oriented ([`crate::clean`](fn@crate::clean)).
///
/// # Errors
/// [`MeshError::BadParameter`] for a mass or density that is not positive and finite; [`MeshError::Flat`] when there is no
/// volume at all.
pub fn mass_properties(mesh: &TriMesh, mass: Mass) -> Result<MassProperties, MeshError> {
    // Vertices without a face bound nothing: they must count neither for the size nor for the hull.
    let used = compact(mesh.vertices(), mesh.faces().to_vec())?;
    let found = if is_closed(mesh) { closed(&used) } else { open(&used) };
    if let Some((moments, method)) = found {
        let properties = finish(&moments, mass, method)?;
        // A surface without volume, because of rounding or tangles, is no solid.
        if properties.inertia.symmetric_eigenvalues().min() > 0.0 {
            return Ok(properties);
        }
    }
    let hull = convex_hull(used.vertices())?;
    finish(&Moments::of(&hull, reference(&hull)), mass, MassMethod::ConvexHull)
}

/// The solid of a closed mesh; `None` for one without volume.
fn closed(mesh: &TriMesh) -> Option<(Moments, MassMethod)> {
    let exact = Moments::of(mesh, reference(mesh));
    if let Some(Lines { signed, union }) = Lines::measure(mesh)
        && (signed.volume - union.volume).abs() > OVERLAP * union.volume
    {
        // The lines' error is that of both sums alike, and cancels: equal shells in one place give their exact moments.
        let outward = Moments::zero(exact.reference).plus(&exact, exact.volume.signum());
        let share = union.volume / signed.volume;
        return Some((union.plus(&outward.plus(&signed, -1.0), share), MassMethod::Union));
    }
    // A closed sheet (two sides of one surface) has no volume.
    (exact.volume.abs() > 1e-9 * mesh.extent().powi(3)).then_some((exact, MassMethod::Closed))
}

/// The solid of an open mesh; `None` where it is no more than a sheet.
fn open(mesh: &TriMesh) -> Option<(Moments, MassMethod)> {
    let solid = enclosed(mesh)?;
    let hull = convex_hull(mesh.vertices()).ok()?;
    (solid.volume > LEAST_SHARE * hull.signed_volume()).then_some((solid, MassMethod::WindingNumber))
}

/// A point near the mesh: integrals about it do not lose digits when the object lies far from the origin.
fn reference(mesh: &TriMesh) -> Point3<f64> {
    let aabb = mesh.aabb();
    nalgebra::center(&aabb.min, &aabb.max)
}

fn finish(moments: &Moments, mass: Mass, method: MassMethod) -> Result<MassProperties, MeshError> {
    let &Moments { reference, volume: signed, first, second } = moments;
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
