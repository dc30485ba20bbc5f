//! Arrangements on disk: the pose of every object, bit by bit.
//!
//! The key is everything on which an arrangement depends: the bodies (collision geometry, mass, surface), the hand, the physics, layout, number
//! of objects, spread, seed, and the code of the simulation (`build.rs`).

use crate::{BUILD, Body};
use graspbox_mesh::cache::{Entry, Kind};
use graspbox_sim::Template;
use nalgebra::Isometry3;
use std::path::Path;

/// Folder of the entries within the cache folder: it has its own bound, since each seed adds an entry.
const FOLDER: &str = "scenes";
/// About 300 bytes for 5 objects, so that 10 000 of such entries are kept.
static KIND: Kind = Kind {
    what: "poses of objects at rest",
    suffix: "scene",
    magic: b"gbscene1",
    max_bytes: 64 << 10,
    most_in_all: 4 << 20,
};

/// The entry of an arrangement.
///
/// * `template`: of all bodies, without walls.
/// * `settings`: every bit of layout and draw as text.
pub(crate) fn entry(cache: &Path, template: &Template, bodies: &[&Body], settings: &str) -> Entry {
    let mut input = template.identity().to_vec();
    input.extend(format!("{BUILD} {settings}").bytes());
    bodies.iter().for_each(|body| input.extend(body.mesh().content_hash()));
    Entry::new(&cache.join(FOLDER), &KIND, &input)
}

/// Indices of the objects that stayed, ascending, and their poses in the world, if the entry is one of `count` bodies.
pub(crate) fn read(entry: &Entry, count: usize) -> Option<(Vec<usize>, Vec<Isometry3<f64>>)> {
    entry.read(|body| {
        let found: (Vec<usize>, Vec<Isometry3<f64>>) = postcard::from_bytes(body).ok()?;
        let (objects, poses) = &found;
        let ascending = objects.windows(2).all(|pair| pair[0] < pair[1]);
        (ascending && objects.last().is_none_or(|last| *last < count) && objects.len() == poses.len()).then_some(found)
    })
}

/// Keeps an arrangement; a failure is a warning.
pub(crate) fn write(entry: &Entry, objects: &[usize], world_from_objects: &[Isometry3<f64>]) {
    if let Ok(body) = postcard::to_allocvec(&(objects, world_from_objects)) {
        entry.write(&body);
    }
}
