//! The identity of a template: a hash of everything that it is built from.

use crate::SimError;
use crate::engine::WorldSpec;
use crate::object::Geometry;
use graspbox_mesh::TriMesh;

/// Identifies the hand, objects, walls and settings of a template, and so the snapshots that it can restore.
pub(crate) type Identity = [u8; 32];

/// Hash of everything that a template is built from. A snapshot can be restored if the identities are equal.
pub(crate) fn identity(WorldSpec { hand, objects, walls, config }: WorldSpec) -> Result<Identity, SimError> {
    let mut hasher = blake3::Hasher::new();
    for object in objects {
        let bytes = postcard::to_allocvec(&(object.mass(), object.center_of_mass(), object.inertia(), config))
            .map_err(|_| SimError::BadSnapshot { why: "the physics settings could not be written".into() })?;
        hasher.update(&bytes);
        match object.geometry() {
            Geometry::Parts(parts) => parts.iter().for_each(|part| hash_mesh(&mut hasher, part)),
            primitive => {
                hasher.update(format!("{primitive:?}").as_bytes());
            }
        }
    }
    // The debug format writes every number exactly.
    hasher.update(format!("{walls:?}{}", hand.content()).as_bytes());
    Ok(*hasher.finalize().as_bytes())
}

/// Hashes counts as well as numbers, so parts that are divided differently differ.
fn hash_mesh(hasher: &mut blake3::Hasher, mesh: &TriMesh) {
    for count in [mesh.vertices().len(), mesh.faces().len()] {
        hasher.update(&(count as u64).to_le_bytes());
    }
    for x in mesh.vertices().iter().flat_map(|point| point.iter()) {
        hasher.update(&x.to_le_bytes());
    }
    for index in mesh.faces().iter().flatten() {
        hasher.update(&index.to_le_bytes());
    }
}
