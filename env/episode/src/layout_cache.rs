//! Arrangements on disk: the pose of every object, bit by bit.
//!
//! The key is everything on which an arrangement depends: the bodies (collision geometry, mass, surface), the hand, the physics, layout, number
//! of objects, spread, seed, and the code of the simulation (`build.rs`).

use crate::layout::{Draw, Layout};
use crate::{Arrangement, Body};
use graspbox_mesh::cache::{Entry, Kind};
use graspbox_sim::{Template, Wall};
use nalgebra::Isometry3;
use std::path::Path;

/// Folder of the entries within the cache folder: it has its own bound, since one seed more is one entry more.
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
pub(crate) fn entry(cache: &Path, layout: &Layout, template: &Template, bodies: &[&Body], draw: &Draw) -> Entry {
    let mut input = template.identity().to_vec();
    // The debug format writes every number exactly.
    input.extend(format!("{} {layout:?} {draw:?}", env!("GRASPBOX_SIMULATION")).bytes());
    bodies.iter().for_each(|body| input.extend(body.mesh().content_hash()));
    Entry::new(&cache.join(FOLDER), &KIND, &input)
}

/// The arrangement of an entry with `walls`, if it is one of `count` bodies.
pub(crate) fn read(entry: &Entry, count: usize, walls: Vec<Wall>) -> Option<Arrangement> {
    let (objects, world_from_objects) = entry.read(|body| {
        let found: (Vec<usize>, Vec<Isometry3<f64>>) = postcard::from_bytes(body).ok()?;
        let (objects, poses) = &found;
        let ascending = objects.windows(2).all(|pair| pair[0] < pair[1]);
        (ascending && objects.last().is_none_or(|last| *last < count) && objects.len() == poses.len()).then_some(found)
    })?;
    Some(Arrangement { objects, world_from_objects, walls })
}

/// Keeps an arrangement; a failure is a warning.
pub(crate) fn write(entry: &Entry, found: &Arrangement) {
    if let Ok(body) = postcard::to_allocvec(&(&found.objects, &found.world_from_objects)) {
        entry.write(&body);
    }
}
