//! Snapshot and restore of a world in mid-motion: the same bits go on from both.

use crate::SimError;
use crate::identity::Identity;
use crate::world::{State, Template, World};
use graspbox_mesh::checksum;

/// Leads every snapshot; the number changes with the layout: identity and state by postcard, then the engine's bytes.
const MAGIC: &[u8; 8] = b"gbworld5";

impl World {
    /// The whole state as bytes, to be given to [`Template::restore`] of an equal template.
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
    /// The world that [`World::snapshot`] saved; it goes on bit for bit as the original does.
    ///
    /// # Errors
    /// [`SimError::BadSnapshot`] for bytes of another version, or damaged ones, or ones of another hand, object or setting.
    pub fn restore(&self, bytes: &[u8]) -> Result<World, SimError> {
        let bad = |why: &str| SimError::BadSnapshot { why: why.into() };
        let body = checksum::open(MAGIC, bytes).map_err(|error| bad(&error.to_string()))?;
        let ((identity, state), engine): ((Identity, State), &[u8]) =
            postcard::take_from_bytes(body).map_err(|_| bad("its content cannot be read"))?;
        self.resume(&identity, state, engine)
    }
}
