//! Tries crude top grasps on every mesh of a folder: the quick look behind trial rates.
#![allow(clippy::unwrap_used)]
use graspbox_episode::{Body, ObjectSpec, Progress, Scene, TrialConfig, run_trials};
use graspbox_hand::{GraspPose, Hand};
use graspbox_sim::PhysicsConfig;
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use std::collections::BTreeMap;
use std::f64::consts::PI;
use std::sync::Arc;

fn main() {
    let folder = std::env::args().nth(1).unwrap();
    let only = std::env::args().nth(2);
    let env = |k: &str, d: f64| std::env::var(k).map_or(d, |v| v.parse().unwrap());
    let physics = PhysicsConfig {
        dt: env("DT", 0.002),
        solver_iterations: env("ITERS", 4.0) as usize,
        ..PhysicsConfig::default()
    };
    let hand = Arc::new(Hand::reflex().unwrap().clone());
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|f| f.unwrap().path()).collect();
    files.sort();
    let mut labels = String::new();
    let mut total = (0, 0, 0.0, 0);
    for file in files {
        let name = file.file_stem().unwrap().to_string_lossy().to_string();
        if only.as_ref().is_some_and(|o| !o.split(',').any(|o| name.contains(o))) {
            continue;
        }
        let mesh = graspbox_mesh::load(&file, &graspbox_mesh::io::LoadOptions::default()).unwrap();
        let cache = std::path::Path::new("/tmp/gbcache");
        let spec = ObjectSpec {
            name: name.clone(),
            mesh,
            mass: Some(0.3),
            parts: None,
        };
        let body = Body::prepare(&spec, Some(cache)).unwrap();
        let scene = Arc::new(Scene::new(&body, hand.clone(), physics, None).unwrap());
        let top = body.mesh().transformed(scene.world_from_object()).aabb().max.z;
        let c = scene.world_from_object() * body.mass_properties().center_of_mass;
        let poses: Vec<_> = (0..16)
            .map(|i| {
                let down = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), (i % 8) as f64 * PI / 8.0)
                    * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
                let hand = Isometry3::from_parts(Translation3::new(c.x, c.y, (top + 0.005).max(0.095)), down);
                let preshape = if i < 8 { 0.0 } else { 0.6 };
                GraspPose {
                    object_from_hand: scene.world_from_object().inverse() * hand,
                    preshape,
                }
            })
            .collect();
        let clock = std::time::Instant::now();
        let out = run_trials(&scene, &poses, TrialConfig::default(), &Progress::default()).unwrap();
        let wall = clock.elapsed().as_secs_f64();
        labels.extend(out.iter().map(|o| if o.success { '1' } else { '0' }));
        let ok = out.iter().filter(|o| o.success).count();
        let steps: f64 = out.iter().map(|o| o.time / physics.dt).sum();
        let mut why: BTreeMap<String, usize> = BTreeMap::new();
        for o in out.iter().filter(|o| !o.success) {
            *why.entry(format!("{:?}", o.failure)).or_default() += 1;
        }
        total = (
            total.0 + ok,
            total.1 + out.len(),
            total.2 + wall,
            total.3 + usize::from(ok > 0),
        );
        println!(
            "{name:32} {ok}/16 {:.1} trials/s {:.0} steps/s {why:?}",
            16.0 / wall,
            steps / wall
        );
    }
    println!(
        "{}/{} objects {} {:.1} trials/s",
        total.0,
        total.1,
        total.3,
        total.1 as f64 / total.2
    );
}
