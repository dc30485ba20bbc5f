//! Snapshot and restore of a world in mid-motion: the same bits go on from both.

use crate::SimError;
use crate::identity::Identity;
use crate::world::{State, Template, World};
use rapier3d::prelude::PhysicsWorld;
use serde::{Deserialize, Serialize};

/// Leads every snapshot; the number changes with the layout.
const MAGIC: &[u8; 8] = b"gbworld3";
/// Length of the checksum that follows.
const CHECKSUM: usize = 32;

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
            .map_err(|_| SimError::BadSnapshot { why: "the engine's state could not be written" })?;
        let mut bytes = MAGIC.to_vec();
        bytes.extend_from_slice(blake3::hash(&body).as_bytes());
        bytes.extend_from_slice(&body);
        Ok(bytes)
    }
}

impl Template {
    /// The world that [`World::snapshot`] saved; it goes on bit for bit as the original does.
    ///
    /// # Errors
    /// [`SimError::BadSnapshot`] for bytes of another version, or damaged ones, or ones of another hand, object or setting.
    pub fn restore(&self, bytes: &[u8]) -> Result<World, SimError> {
        let bad = |why| SimError::BadSnapshot { why };
        let rest = bytes.strip_prefix(MAGIC).ok_or_else(|| bad("it is not a snapshot of this version"))?;
        let (sum, body) = rest.split_at_checked(CHECKSUM).ok_or_else(|| bad("it is too short"))?;
        if blake3::hash(body).as_bytes() != sum {
            return Err(bad("its checksum does not match; it was cut off or changed"));
        }
        let Loaded { identity, physics, state } =
            postcard::from_bytes(body).map_err(|_| bad("its content cannot be read"))?;
        self.resume(&identity, physics, state)
            .ok_or_else(|| bad("it was taken with another hand, object or physics setting"))
    }
}
