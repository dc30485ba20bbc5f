//! Snapshot and restore of a world in mid-motion: the same bits go on from both.

use crate::SimError;
use crate::identity::Identity;
use crate::world::{State, Template, World};
use graspbox_mesh::checksum;
use rapier3d::prelude::PhysicsWorld;
use serde::{Deserialize, Serialize};

/// Leads every snapshot; the number changes with the layout.
const MAGIC: &[u8; 8] = b"gbworld3";

#[derive(Serialize)]
struct Saved<'a> {
    identity: &'a Identity,
    physics: &'a PhysicsWorld,
    state: &'a State,
}

#[derive(Deserialize)]
struct Loaded {
    identity: Identity,
    physics: PhysicsWorld,
    state: State,
}

impl World {
    /// The whole state as bytes, to be given to [`Template::restore`] of an equal template.
    ///
    /// # Errors
    /// [`SimError::BadSnapshot`] if the engine's state cannot be written.
    pub fn snapshot(&self) -> Result<Vec<u8>, SimError> {
        let saved = Saved { identity: self.identity(), physics: self.physics(), state: self.state() };
        let body = postcard::to_allocvec(&saved)
            .map_err(|_| SimError::BadSnapshot { why: "the engine's state could not be written".into() })?;
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
        let Loaded { identity, physics, state } =
            postcard::from_bytes(body).map_err(|_| bad("its content cannot be read"))?;
        self.resume(&identity, physics, state)
            .ok_or_else(|| bad("it was taken with another hand, object or physics setting"))
    }
}
