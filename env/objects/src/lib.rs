//! Household objects made from a seed: closed surfaces of real size and mass, with their convex parts.
//!
//! | module | purpose |
//! |---|---|
//! | `family` | the families, their names, and their ranges of size and mass |
//! | `sample` | seeded sampling, one stream per family and seed |
//! | `surface` | closed quad surfaces from rings |
//! | `lathe` | surfaces of revolution; convex parts of solids and walls |
//! | `implicit`, `nets` | composite solids as signed distances; their manifold surface |
//! | `cloud` | few points whose hull stays close to a convex shape |
//! | `draft` | an object in its construction frame, and its resting pose |
//! | `families` | the shapes of the families: packages, prisms, brackets, balls, vessels, food, cutlery, tools, kettles |
//!
//! ```
//! use graspbox_objects::{Family, generate};
//!
//! let mug = generate(Family::Mug, 7)?;
//! assert_eq!(mug.name, "mug-000007");
//! assert_eq!(generate(Family::Mug, 7)?.mesh, mug.mesh);
//! assert!(mug.mesh.aabb().min.z.abs() < 1e-12);
//! # Ok::<(), graspbox_mesh::MeshError>(())
//! ```
//!
//! Object frame: z up in the natural resting pose, lowest vertex at z = 0, bounds centred in x and y; metres.

mod cloud;
mod draft;
mod families;
mod family;
mod implicit;
mod lathe;
mod nets;
mod sample;
mod surface;
#[cfg(test)]
mod tests;

pub use family::{Family, FamilyFacts, UnknownFamily};

use graspbox_mesh::{MeshError, TriMesh};
use nalgebra::Point3;

/// One object of a family.
#[derive(Clone, Debug)]
pub struct ProceduralObject {
    /// `family-seed`, with at least six digits of the seed: `mug-000042`.
    pub name: String,
    pub family: Family,
    pub seed: u64,
    /// Its closed surface with outward faces, object frame, metres.
    pub mesh: TriMesh,
    /// Mass, kilograms.
    pub mass: f64,
    /// Convex parts as clouds of at most 64 points in the object frame, within 1.5 mm of the surface; `None` if the caller must decompose the
    /// mesh.
    pub parts: Option<Vec<Vec<Point3<f64>>>>,
}

/// Makes object `seed` of `family`: the same bits for the same arguments.
///
/// # Errors
/// [`MeshError::NoManifoldSurface`], or those of [`TriMesh::new`]; both would be defects of the family.
pub fn generate(family: Family, seed: u64) -> Result<ProceduralObject, MeshError> {
    let mut sampler = sample::Sampler::new(family as u64, seed);
    let mut made = families::draft(family, &mut sampler)?;
    made.settle();
    let name = format!("{family}-{seed:06}");
    Ok(ProceduralObject {
        name,
        family,
        seed,
        mesh: made.surface.into_mesh()?,
        mass: made.mass,
        parts: Some(made.parts),
    })
}
