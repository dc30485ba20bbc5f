//! Times the collision filter, pose by pose on one thread, and writes its results, to compare two builds.
//!
//! `cargo run --release -p graspbox-plan --example bench_collision -- ANSWERS.txt [MESH ...]`: one procedural object of each family, and
//! the mesh files. Poses are at random points of the surface, from 1 cm inside to 6 cm outside, roughly along the normal.

use graspbox_hand::Hand;
use graspbox_mesh::{
    CleanOptions, LoadOptions, PartsParams, TriMesh, clean, convex_hull, convex_parts, default_pose, load,
    sample_surface,
};
use graspbox_objects::{Family, generate};
use graspbox_plan::{CollisionScene, Feasibility, Obstacle, OpenHand};
use nalgebra::{Isometry3, Rotation3, Translation3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::error::Error;
use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

/// Poses of each object.
const POSES: usize = 400;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let answers = arguments.next().ok_or("name the file for the answers")?;
    let mut text = String::new();
    let (mut seconds, mut count) = (0.0, 0);
    let mut add = |name: &str, mesh: &TriMesh, parts: &[TriMesh]| -> Result<(), Box<dyn Error>> {
        let (time, found) = check(mesh, parts)?;
        for (index, feasibility) in found.iter().enumerate() {
            writeln!(text, "{name} {index} {feasibility:?}")?;
        }
        println!("{name}: {:.1} us per pose", 1e6 * time / found.len() as f64);
        seconds += time;
        count += found.len();
        Ok(())
    };
    for family in Family::ALL {
        let object = generate(family, 3)?;
        let parts = match &object.parts {
            Some(parts) => parts.iter().map(|points| convex_hull(points)).collect::<Result<Vec<_>, _>>()?,
            None => convex_parts(&object.mesh, &PartsParams::default(), None)?.parts,
        };
        add(&object.name, &object.mesh, &parts)?;
    }
    let cache = std::env::var_os("GRASPBOX_CACHE");
    for file in arguments {
        let (mesh, _) = clean(&load(Path::new(&file), &LoadOptions::default())?, &CleanOptions::default())?;
        let parts = convex_parts(&mesh, &PartsParams::default(), cache.as_deref().map(Path::new))?.parts;
        add(&file, &mesh, &parts)?;
    }
    println!("all: {count} poses, {:.1} us per pose", 1e6 * seconds / count as f64);
    std::fs::write(answers, text)?;
    Ok(())
}

/// The least of three timings of all poses, seconds, and the results.
fn check(mesh: &TriMesh, parts: &[TriMesh]) -> Result<(f64, Vec<Feasibility>), Box<dyn Error>> {
    let scene = CollisionScene::new(Arc::new(Obstacle::new(mesh, parts)?), &default_pose(mesh));
    let hand = Hand::reflex()?;
    let hands = [0.0, 0.8, 1.5].map(|preshape| OpenHand::new(hand, preshape, 0.001, 0.1));
    let hands: Vec<OpenHand> = hands.into_iter().collect::<Result<_, _>>()?;
    let poses = poses(mesh);
    let mut least = f64::INFINITY;
    let mut found = Vec::new();
    for _ in 0..3 {
        let clock = Instant::now();
        found = poses.iter().enumerate().map(|(i, pose)| scene.check(&hands[i % hands.len()], pose)).collect();
        least = least.min(clock.elapsed().as_secs_f64());
    }
    Ok((least, found))
}

fn poses(mesh: &TriMesh) -> Vec<Isometry3<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let mut within = |low: f64, high: f64| low + (high - low) * rng.random::<f64>();
    let place = |sample: &graspbox_mesh::SurfaceSample| {
        let lean = Vector3::new(within(-0.3, 0.3), within(-0.3, 0.3), within(-0.3, 0.3));
        let into = Rotation3::new(lean) * -sample.normal;
        let faces = UnitQuaternion::rotation_between(&Vector3::z(), &into)
            .unwrap_or_else(|| UnitQuaternion::new(Vector3::x() * 3.1));
        let roll = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), within(-3.1, 3.1));
        Isometry3::from_parts(Translation3::from(sample.point.coords - into * within(-0.01, 0.06)), faces * roll)
    };
    sample_surface(mesh, POSES, 0).iter().map(place).collect()
}
