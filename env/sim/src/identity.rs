//! What a template is built from, as one hash: worlds of equal templates may be exchanged.

use crate::SimError;
use crate::config::PhysicsConfig;
use crate::object::ObjectModel;
use graspbox_hand::Hand;

/// Names what a snapshot can be restored into: a hand, an object, settings.
pub(crate) type Identity = [u8; 32];

/// Hash of everything that a template is built from: worlds of equal templates may be exchanged, others may not.
pub(crate) fn identity(hand: &Hand, object: &ObjectModel, config: &PhysicsConfig) -> Result<Identity, SimError> {
    let mass = &object.mass_properties;
    let bytes = postcard::to_allocvec(&(&object.shape, mass, config))
        .map_err(|_| SimError::BadSnapshot { why: "the object's shape could not be written".into() })?;
    let mut hasher = blake3::Hasher::new();
    hasher.update(&bytes);
    // Every number of the hand, written so that it can be told from any other.
    hasher.update(format!("{hand:?}").as_bytes());
    Ok(*hasher.finalize().as_bytes())
}
