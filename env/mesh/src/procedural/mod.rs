//! Household objects made from a seed: closed surfaces of real size and mass, with the convex parts they are made of.
//!
//! | module | what it does |
//! |---|---|
//! | `family` | the families, their names, and the sizes and masses that they promise |
//! | `draw` | seeded draws, one stream per family and seed |
//! | `surface` | closed quad surfaces from rings |
//! | `lathe` | surfaces of revolution; convex parts of solids and walls |
//! | `field`, `nets` | composite solids as signed distances; their manifold surface |
//! | `cloud` | few points whose hull stays close to a convex shape |
//! | `draft` | what a family hands back, and how it is laid on the table |
//! | `packages`, `rounds`, `vessels`, `handled`, `food`, `cutlery`, `tools`, `kettle` | the families themselves |
//!
//! Object frame: z up in the natural resting pose, lowest vertex at z = 0, bounds centred in x and y; metres.

mod cloud;
mod cutlery;
mod draft;
mod draw;
mod family;
mod field;
mod food;
mod handled;
mod kettle;
mod lathe;
mod nets;
mod packages;
mod rounds;
mod surface;
#[cfg(test)]
mod tests;
mod tools;
mod vessels;

pub use family::{Family, FamilyFacts, UnknownFamily};

use crate::{MeshError, TriMesh};
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
    let mut draw = draw::Draw::new(family as u64, seed);
    let mut made = match family {
        Family::Box => packages::grocery_box(&mut draw),
        Family::WoodBlock => packages::wood_block(&mut draw),
        Family::Can => packages::can(&mut draw),
        Family::Bottle => packages::bottle(&mut draw),
        Family::Ball => rounds::ball(&mut draw)?,
        Family::Cup => vessels::cup(&mut draw),
        Family::Bowl => vessels::bowl(&mut draw),
        Family::Plate => vessels::plate(&mut draw),
        Family::WineGlass => vessels::wine_glass(&mut draw),
        Family::Mug => handled::mug(&mut draw),
        Family::Fruit => food::fruit(&mut draw)?,
        Family::Banana => food::banana(&mut draw)?,
        Family::Hammer => tools::hammer(&mut draw)?,
        Family::Screwdriver => tools::screwdriver(&mut draw)?,
        Family::Scissors => cutlery::scissors(&mut draw)?,
        Family::Fork => cutlery::fork(&mut draw)?,
        Family::Spoon => cutlery::spoon(&mut draw)?,
        Family::Clamp => tools::clamp(&mut draw)?,
        Family::Chain => tools::chain(&mut draw)?,
        Family::Ring => tools::ring(&mut draw)?,
        Family::Kettle => kettle::kettle(&mut draw)?,
        Family::Superquadric => rounds::superquadric(&mut draw)?,
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
