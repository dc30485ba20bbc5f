//! Procedural objects at rest, with the planner's poses for them.

use graspbox_episode::{Body, ObjectSpec, Scene};
use graspbox_hand::GraspPose;
use graspbox_mesh::convex_hull;
use graspbox_objects::{Family, generate};
use graspbox_plan::PlanParams;
use graspbox_sim::PhysicsConfig;
use nalgebra::{Point3, Vector3};
use std::path::Path;
use std::sync::Arc;

/// Object `seed` of `family`, ready to be simulated.
pub fn procedural(family: Family, seed: u64) -> Body {
    let object = generate(family, seed).unwrap();
    let spec = ObjectSpec { name: object.name, mesh: object.mesh, mass: Some(object.mass), parts: object.parts };
    Body::prepare(&spec, None).unwrap()
}

/// The convex hull of `points` as an object of `mass` kilograms.
pub fn hull(name: &str, points: &[Point3<f64>], mass: f64) -> Body {
    let mesh = convex_hull(points).unwrap();
    Body::prepare(&ObjectSpec { name: name.into(), mesh, mass: Some(mass), parts: None }, None).unwrap()
}

/// A cuboid about the origin of `mass` kilograms; `half`: half its sides, metres.
pub fn cuboid(name: &str, half: [f64; 3], mass: f64) -> Body {
    let sign = |i: usize, axis: usize| if i >> axis & 1 == 1 { 1.0 } else { -1.0 };
    let corner = |i| Point3::from(Vector3::from_fn(|axis, _| sign(i, axis) * half[axis]));
    hull(name, &(0..8).map(corner).collect::<Vec<_>>(), mass)
}

/// A mesh file as an object of `mass` kilograms; its convex parts are kept in `cache`.
pub fn from_file(file: &Path, mass: f64, cache: &Path) -> Body {
    let mesh = graspbox_mesh::load(file, &graspbox_mesh::LoadOptions::default()).unwrap();
    let name = file.file_stem().unwrap().to_string_lossy().into_owned();
    let spec = ObjectSpec { name, mesh, mass: Some(mass), parts: None };
    Body::prepare(&spec, Some(cache)).unwrap()
}

/// `body` at rest on the table under `physics`.
pub fn scene(body: &Body, physics: PhysicsConfig) -> Arc<Scene> {
    let hand = Arc::new(crate::bench::reflex());
    Arc::new(Scene::new(body, hand, physics, None).unwrap())
}

/// The first `count` feasible poses of the planner for `body` as it lies in `scene`, in its ranking order.
pub fn planned(body: &Body, scene: &Scene, count: usize, seed: u64) -> Vec<GraspPose> {
    let plan = scene.plan(body, &PlanParams { seed, ..PlanParams::default() }).unwrap();
    plan.ranked().iter().take(count).map(|c| c.grasp).collect()
}
