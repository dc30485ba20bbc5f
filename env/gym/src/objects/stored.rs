//! Prepared objects on disk: what an object's source says, as the key, and everything that was computed of it.
//!
//! The key of a mesh file is its bytes, so that a file which was prepared once is hashed, not parsed. The key of another object, or of a glTF
//! file, is its geometry. Both hold the mass, and the name of the build.

use super::prepared::Rest;
use crate::EnvError;
use crate::source::Source;
use graspbox_episode::{BUILD, Body, DEFAULT_DENSITY, ObjectSpec};
use graspbox_mesh::cache::bytes::{Reader, put_mesh, put_u32};
use graspbox_mesh::cache::{Entry, Kind, MOST_OF_MESHES, digest};
use graspbox_mesh::{LoadOptions, MassProperties, MeshFormat, TriMesh, read_bounded};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// The largest mesh that is read has 300 MB.
static KIND: Kind = Kind {
    what: "prepared objects",
    suffix: "object",
    magic: b"gbobjct1",
    max_bytes: 512 << 20,
    most_in_all: MOST_OF_MESHES,
};

/// The code that chooses resting poses and writes entries: [`BUILD`] knows that of other crates.
const CODE: &str = concat!(include_str!("prepared.rs"), include_str!("stored.rs"));

/// The source of an object, with the key of what is kept of it.
pub(super) struct Identified<'a> {
    source: &'a Source,
    /// What was read for the key.
    spec: OnceLock<ObjectSpec>,
    /// Cache folder and key; `None` without a cache.
    kept: Option<(PathBuf, Vec<u8>)>,
}

impl<'a> Identified<'a> {
    /// Reads what identifies an object.
    ///
    /// # Errors
    /// As [`Source::read`].
    pub fn of(source: &'a Source, cache: Option<&Path>) -> Result<Self, EnvError> {
        let spec = OnceLock::new();
        let Some(folder) = cache else { return Ok(Self { source, spec, kept: None }) };
        let mut key = format!("{BUILD} {DEFAULT_DENSITY} ").into_bytes();
        key.extend(digest(CODE.as_bytes()));
        match source {
            // A glTF file may name others, which hold its numbers.
            Source::File { path, scale, mass, .. } if MeshFormat::from_path(path) != Some(MeshFormat::Gltf) => {
                let options = LoadOptions { scale: *scale, ..LoadOptions::default() };
                let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
                key.extend(format!("{ending:?} {options:?} {mass:?} ").bytes());
                match read_bounded(path, options.max_bytes) {
                    Ok(bytes) => key.extend(digest(&bytes)),
                    // The same error, with its sentence; without one, what was read has no key.
                    Err(_) => {
                        drop(spec.set(source.read()?));
                        return Ok(Self { source, spec, kept: None });
                    }
                }
            }
            Source::File { .. } | Source::Given(_) | Source::Procedural { .. } => {
                let read = source.read()?;
                key.extend(read.mesh.content_hash());
                key.extend(digest(format!("{:?} {:?}", read.mass, read.parts).as_bytes()));
                drop(spec.set(read));
            }
        }
        Ok(Self { source, spec, kept: Some((folder.to_path_buf(), key)) })
    }

    /// Cache folder.
    pub fn cache(&self) -> Option<&Path> {
        self.kept.as_ref().map(|(folder, _)| folder.as_path())
    }

    /// Reads or generates the object.
    ///
    /// # Errors
    /// As [`Source::read`].
    pub fn read(&self) -> Result<ObjectSpec, EnvError> {
        self.spec.get().cloned().map_or_else(|| self.source.read(), Ok)
    }

    /// What is kept of the object.
    pub fn stored(&self) -> Option<(Body, Vec<Rest>)> {
        let (mesh, parts, mass, rests) = self.entry("")?.read(decode)?;
        let body = Body::assemble(self.source.name().to_owned(), mesh, parts.into(), mass).ok()?;
        Some((body, rests))
    }

    /// Keeps a prepared object; a failure is a warning.
    pub fn store(&self, body: &Body, rests: &[Rest]) {
        let Some(entry) = self.entry("") else { return };
        let mut bytes = Vec::new();
        put_mesh(&mut bytes, body.mesh());
        put_u32(&mut bytes, body.parts().len());
        body.parts().iter().for_each(|part| put_mesh(&mut bytes, part));
        if let Ok(numbers) = postcard::to_allocvec(&(body.mass_properties(), rests)) {
            bytes.extend(numbers);
            entry.write(&bytes);
        }
    }

    /// Whether everything was prepared, for these `users`: hand, physics and renderer.
    pub fn is_ready(&self, users: &str) -> bool {
        // Old entries are removed, each by itself.
        self.entry("").is_some_and(|entry| entry.exists())
            && self.entry(users).is_some_and(|entry| entry.read(|body| body.is_empty().then_some(())).is_some())
    }

    /// Notes that everything was prepared.
    pub fn set_ready(&self, users: &str) {
        if let Some(entry) = self.entry(users) {
            entry.write(&[]);
        }
    }

    fn entry(&self, users: &str) -> Option<Entry> {
        let (folder, key) = self.kept.as_ref()?;
        Some(Entry::new(folder, &KIND, &[users.as_bytes(), key].concat()))
    }
}

/// Mesh, convex parts, mass properties and resting poses of an entry.
fn decode(body: &[u8]) -> Option<(TriMesh, Vec<TriMesh>, MassProperties, Vec<Rest>)> {
    let mut reader = Reader(body);
    let mesh = reader.mesh()?;
    let parts = (0..reader.u32()?).map(|_| reader.mesh()).collect::<Option<_>>()?;
    let (mass, rests): (MassProperties, Vec<Rest>) = postcard::from_bytes(reader.0).ok()?;
    (!rests.is_empty()).then_some((mesh, parts, mass, rests))
}
