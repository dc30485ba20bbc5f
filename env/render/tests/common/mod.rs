//! Ray casting against every triangle, and random scenes for it.
#![allow(dead_code, missing_docs)]

use graspbox_mesh::TriMesh;
use graspbox_render::{Camera, Instance, Intrinsics, Model, Pattern, ViewPlan, shapes};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

pub struct Dice(ChaCha8Rng);

impl Dice {
    pub fn new(seed: u64) -> Self {
        Self(ChaCha8Rng::seed_from_u64(seed))
    }
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.0.next_u64() >> 11) as f64 * (-53f64).exp2()
    }
    pub fn below(&mut self, count: usize) -> usize {
        (self.range(0.0, 1.0) * count as f64) as usize
    }
    pub fn vector(&mut self, reach: f64) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.range(-reach, reach))
    }
    pub fn pose(&mut self, reach: f64) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_scaled_axis(self.vector(3.0));
        Isometry3::from_parts(Translation3::from(self.vector(reach)), turn)
    }
}

/// A grid over the half of the sphere above the table, at `distance` metres.
pub fn dome(distance: f64) -> ViewPlan {
    let cap = std::f64::consts::FRAC_PI_2;
    ViewPlan { pattern: Pattern::Grid, axis: Vector3::z(), cap, distance: [distance; 2], shift: 0.0, up: Vector3::z() }
}

/// A solid, or an open heap of triangles.
pub fn random_mesh(dice: &mut Dice) -> TriMesh {
    let size = dice.range(0.02, 0.3);
    match dice.below(5) {
        0 => shapes::cuboid(Vector3::new(size, size * 0.7, size * dice.range(0.1, 1.0)), 0.0).unwrap(),
        1 => shapes::cuboid(Vector3::repeat(size), 0.3 * size).unwrap(),
        2 => shapes::cylinder(size, dice.range(0.01, 0.4), 5 + dice.below(20)).unwrap(),
        3 => shapes::sphere(size, 4 + dice.below(14)).unwrap(),
        _ => {
            let count = 1 + dice.below(12);
            let vertices = (0..3 * count).map(|_| Point3::from(dice.vector(1.5 * size))).collect();
            let faces = (0..count as u32).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
            TriMesh::new(vertices, faces).unwrap()
        }
    }
}

pub fn table() -> TriMesh {
    shapes::cuboid(Vector3::new(0.6, 0.6, 0.02), 0.0).unwrap()
}

pub fn instance(model: &Model, world_from_model: Isometry3<f64>, label: u8) -> Instance<'_> {
    Instance { model, world_from_model, color: [0.8, 0.5, 0.3], label, casts_shadow: true }
}

/// A camera anywhere in the scene, also inside objects.
pub fn random_camera(dice: &mut Dice, largest: usize) -> Camera {
    let (width, height) = (1 + dice.below(largest) as u32, 1 + dice.below(largest) as u32);
    let intrinsics = Intrinsics {
        width,
        height,
        fx: f64::from(width) * dice.range(0.3, 2.0),
        fy: f64::from(height) * dice.range(0.3, 2.0),
        cx: f64::from(width) * dice.range(0.2, 0.8),
        cy: f64::from(height) * dice.range(0.2, 0.8),
    };
    let reach = dice.range(0.05, 1.0);
    let (eye, target) = (Point3::from(dice.vector(reach)), Point3::from(dice.vector(0.2)));
    let camera = Camera::look_at(intrinsics, eye, target, dice.vector(1.0)).unwrap();
    let near = dice.range(0.001, 0.1);
    camera.with_range(near, near + dice.range(0.2, 3.0)).unwrap()
}

/// A mesh seen by a camera: its triangles in the camera's frame, and its label.
pub struct Seen {
    pub triangles: Vec<[Point3<f64>; 3]>,
    pub label: u8,
}

pub fn seen(mesh: &TriMesh, world_from_model: &Isometry3<f64>, camera: &Camera, label: u8) -> Seen {
    let moved = mesh.transformed(&camera.camera_from_object(world_from_model));
    let triangles = (0..moved.faces().len()).map(|f| moved.triangle(f)).collect();
    Seen { triangles, label }
}

/// Least depth in the camera's range along the ray through (`u`, `v`), and its label: Moeller and Trumbore's test on every triangle.
pub fn cast(scene: &[Seen], camera: &Camera, u: f64, v: f64) -> (f64, u8) {
    let ray = camera.intrinsics().unproject(u, v, 1.0).coords;
    let (mut depth, mut label) = (f64::INFINITY, 0);
    for part in scene {
        for [a, b, c] in &part.triangles {
            let (ab, ac) = (b - a, c - a);
            let across = ray.cross(&ac);
            let det = ab.dot(&across);
            if det == 0.0 {
                continue;
            }
            let from_a = -a.coords;
            let s = from_a.dot(&across) / det;
            let up = from_a.cross(&ab);
            let t = ray.dot(&up) / det;
            let z = ac.dot(&up) / det;
            let inside = s >= 0.0 && t >= 0.0 && s + t <= 1.0;
            if inside && z >= camera.near() && z <= camera.far() && z < depth {
                (depth, label) = (z, part.label);
            }
        }
    }
    if depth.is_finite() { (depth, label) } else { (0.0, 0) }
}
