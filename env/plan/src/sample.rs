//! Surface points spread by area.

use graspbox_mesh::TriMesh;
use nalgebra::Point3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// `count` points spread evenly over the area of `mesh`: one in each of `count` equal strips of area, at a random place in it.
pub(crate) fn sample_surface(mesh: &TriMesh, count: usize, seed: u64) -> Vec<Point3<f64>> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let step = mesh.area() / count as f64;
    let mut points = Vec::with_capacity(count);
    let mut face = 0;
    let mut passed = mesh.face_area_vector(0).norm();
    for i in 0..count {
        let target = (i as f64 + rng.random::<f64>()) * step;
        while passed < target && face + 1 < mesh.faces().len() {
            face += 1;
            passed += mesh.face_area_vector(face).norm();
        }
        let [a, b, c] = mesh.triangle(face);
        let (r, s) = (rng.random::<f64>().sqrt(), rng.random::<f64>());
        points.push(a + (b - a) * (r * (1.0 - s)) + (c - a) * (r * s));
    }
    points
}
