//! Household objects made from a seed: closed surfaces of real size and mass, with the convex parts they are made of.
//!
//! | module | what it does |
//! |---|---|
//! | `family` | the families, their names, and the sizes and masses that they promise |
//! | `sample` | seeded sampling, one stream per family and seed |
//! | `surface` | closed quad surfaces from rings |
//! | `lathe` | surfaces of revolution; convex parts of solids and walls |
//! | `implicit`, `nets` | composite solids as signed distances; their manifold surface |
//! | `cloud` | few points whose hull stays close to a convex shape |
//! | `draft` | what a family returns, and how it is laid on the table |
//! | `packages`, `prisms`, `brackets`, `rounds`, `vessels`, `handled`, `food`, `cutlery`, `tools`, `kettle` | the families themselves |
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

mod brackets;
mod cloud;
mod cutlery;
mod draft;
mod family;
mod food;
mod handled;
mod implicit;
mod kettle;
mod lathe;
mod nets;
mod packages;
mod prisms;
mod rounds;
mod sample;
mod surface;
#[cfg(test)]
mod tests;
mod tools;
mod vessels;

pub use family::{Family, FamilyFacts, UnknownFamily};

use graspbox_mesh::{MeshError, TriMesh};
use nalgebra::Point3;

/// One object of a family.
#[derive(Clone, Debug)]
pub struct ProceduralObject {
    /// `family-seed`, the seed with six digits or more: `mug-000042`.
    pub name: String,
    /// The family it belongs to.
    pub family: Family,
    /// The seed that makes it.
    pub seed: u64,
    /// Its closed surface, outward, in the object frame.
    pub mesh: TriMesh,
    /// Kilograms.
    pub mass: f64,
    /// Convex parts as clouds of at most 64 points in the object frame, within 1.5 mm of the surface; `None` where the
    /// caller has to decompose the mesh.
    pub parts: Option<Vec<Vec<Point3<f64>>>>,
}

/// Makes object `seed` of `family`: the same bits for the same arguments.
///
/// # Errors
/// [`MeshError::NoManifoldSurface`], or those of [`TriMesh::new`]; each would be a defect of the family.
pub fn generate(family: Family, seed: u64) -> Result<ProceduralObject, MeshError> {
    let mut sampler = sample::Sampler::new(family as u64, seed);
    let mut made = match family {
        Family::Box => packages::grocery_box(&mut sampler),
        Family::WoodBlock => packages::wood_block(&mut sampler),
        Family::Can => packages::can(&mut sampler),
        Family::Bottle => packages::bottle(&mut sampler),
        Family::Ball => rounds::ball(&mut sampler)?,
        Family::Cup => vessels::cup(&mut sampler),
        Family::Bowl => vessels::bowl(&mut sampler),
        Family::Plate => vessels::plate(&mut sampler),
        Family::WineGlass => vessels::wine_glass(&mut sampler),
        Family::Mug => handled::mug(&mut sampler),
        Family::Fruit => food::fruit(&mut sampler)?,
        Family::Banana => food::banana(&mut sampler)?,
        Family::Hammer => tools::hammer(&mut sampler)?,
        Family::Screwdriver => tools::screwdriver(&mut sampler)?,
        Family::Scissors => cutlery::scissors(&mut sampler)?,
        Family::Fork => cutlery::fork(&mut sampler)?,
        Family::Spoon => cutlery::spoon(&mut sampler)?,
        Family::Clamp => tools::clamp(&mut sampler)?,
        Family::Chain => tools::chain(&mut sampler)?,
        Family::Ring => tools::ring(&mut sampler)?,
        Family::Kettle => kettle::kettle(&mut sampler)?,
        Family::Superquadric => rounds::superquadric(&mut sampler)?,
        Family::Prism => prisms::prism(&mut sampler),
        Family::Bracket => brackets::bracket(&mut sampler)?,
        Family::Carton => prisms::carton(&mut sampler),
    };
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
