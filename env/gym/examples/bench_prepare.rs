//! Prints how long each phase of an object's preparation takes, on one thread, without any cache.
//!
//! ```text
//! cargo run --release --workspace --example bench_prepare -- FOLDER_OF_MESH_FILES [PART_OF_A_NAME]
//! ```
//!
//! Times are those of one thread, milliseconds; the last column names the bits of the convex parts, so that two versions can be compared.
#![allow(clippy::print_stdout)]

use graspbox_episode::{Body, ObjectSpec, Scene};
use graspbox_hand::Hand;
use graspbox_mesh::{
    CleanOptions, LoadOptions, PartsParams, RestingOptions, clean, convex_hull, convex_parts, load, measure_parts,
    resting_poses,
};
use graspbox_render::Model;
use graspbox_sim::PhysicsConfig;
use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Phases in their order.
const PHASES: [&str; 7] = ["read", "clean", "parts", "rest of body", "resting poses", "settle one", "levels"];

fn main() -> Result<(), Box<dyn Error>> {
    let folder = std::env::args_os().nth(1).ok_or("name a folder of mesh files")?;
    let part = std::env::args().nth(2).unwrap_or_default();
    let mut files: Vec<_> = std::fs::read_dir(&folder)?.map(|f| f.map(|f| f.path())).collect::<Result<_, _>>()?;
    files.retain(|f| f.is_file() && f.to_string_lossy().contains(&part));
    files.sort();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).stack_size(8 << 20).build()?;
    print!("{:28}", "ms");
    PHASES.iter().for_each(|name| print!("{name:>15}"));
    println!("{:>8}{:>12}{:>12}", "parts", "overfill/mm", "bits");
    let (mut sums, mut count) = ([0.0; PHASES.len()], 0.0);
    for file in &files {
        let times = pool.install(|| prepare(file).map_err(|error| error.to_string()))?;
        sums.iter_mut().zip(times).for_each(|(sum, time)| *sum += time);
        count += 1.0;
    }
    print!("{:28}", "mean");
    sums.iter().for_each(|sum| print!("{:15.1}", sum / count));
    println!();
    Ok(())
}

fn prepare(file: &Path) -> Result<[f64; PHASES.len()], Box<dyn Error>> {
    let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut clock = Clock(Instant::now());
    let raw = load(file, &LoadOptions::default())?;
    let read = clock.lap();
    let (mesh, _) = clean(&raw, &CleanOptions::default())?;
    let cleaned = clock.lap();
    let parts = convex_parts(&mesh, &PartsParams::default(), None)?;
    let cut = clock.lap();
    let points = parts.parts.iter().map(|part| part.vertices().to_vec()).collect();
    let spec = ObjectSpec { name: name.clone(), mesh: raw, mass: None, parts: Some(points) };
    clock.lap();
    let body = Body::prepare(&spec, None)?;
    let body_time = clock.lap() - cleaned;
    let hull = convex_hull(body.mesh().vertices())?;
    let poses = resting_poses(&hull, &body.mass_properties().center_of_mass, &RestingOptions::default())?;
    let resting = clock.lap();
    let hand = Arc::new(Hand::reflex()?.clone());
    clock.lap();
    let first = poses.first().map(|pose| pose.world_from_object);
    // An object that is too large for the hand is no error here.
    drop(Scene::new(&body, hand, PhysicsConfig::default(), first.as_ref()));
    let settle = clock.lap();
    Model::new(&mesh)?;
    let levels = clock.lap();
    let times = [read, cleaned, cut, body_time, resting, settle, levels];
    let bits = parts.parts.iter().fold(0_u64, |all, part| {
        let hash = part.content_hash();
        all.rotate_left(7) ^ hash.iter().fold(0_u64, |h, b| h.rotate_left(8) ^ u64::from(*b))
    });
    print!("{name:28}");
    times.iter().for_each(|time| print!("{time:15.1}"));
    let report = measure_parts(&mesh, &parts.parts, PartsParams::default().max_error);
    println!("{:8}{:12.3}{:>12}", report.parts, 1e3 * report.overfill_mean, format!("{:08x}", bits as u32));
    Ok(times)
}

struct Clock(Instant);

impl Clock {
    /// Milliseconds since the last lap.
    fn lap(&mut self) -> f64 {
        let time = self.0.elapsed().as_secs_f64() * 1e3;
        self.0 = Instant::now();
        time
    }
}
