//! Snapshots of a world in motion: the restored world continues with the same bits.

use crate::SimError;
use crate::identity::Identity;
use crate::world::{State, Template, World};
use graspbox_mesh::checksum;

/// First bytes of every snapshot; the number changes with the layout (identity and state by postcard, then the engine's bytes).
const MAGIC: &[u8; 8] = b"gbworld8";

impl World {
    /// The complete state as bytes, for [`Template::restore`] of an equal template.
    ///
    /// # Errors
    /// [`SimError::BadSnapshot`] if the engine's state cannot be written.
    pub fn snapshot(&self) -> Result<Vec<u8>, SimError> {
        let mut body = postcard::to_allocvec(&(self.identity(), self.state()))
            .map_err(|_| SimError::BadSnapshot { why: "the world's state could not be written".into() })?;
        body.extend(self.engine().save()?);
        Ok(checksum::seal(MAGIC, &body))
    }
}

impl Template {
    /// The world that [`World::snapshot`] saved; it continues with the bits of the original.
    ///
    /// # Errors
    /// [`SimError::BadSnapshot`] for damaged bytes, and for those of another version, hand, object or setting.
    pub fn restore(&self, bytes: &[u8]) -> Result<World, SimError> {
        let bad = |why: &str| SimError::BadSnapshot { why: why.into() };
        let body = checksum::open(MAGIC, bytes).map_err(|error| bad(&error.to_string()))?;
        let ((identity, state), engine): ((Identity, State), &[u8]) =
            postcard::take_from_bytes(body).map_err(|_| bad("its content cannot be read"))?;
        self.resume(&identity, state, engine)
    }
}
