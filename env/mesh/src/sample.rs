//! Surface samples, uniform by area, and evenly spread directions.

use crate::trimesh::TriMesh;
use nalgebra::{Point3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A point on the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceSample {
    /// Position in the mesh's frame, metres.
    pub point: Point3<f64>,
    /// Unit normal of its face (outward when the mesh is oriented).
    pub normal: Vector3<f64>,
    pub face: u32,
}

/// `count` points, uniform by area and stratified: the surface is laid out along a line by cumulative area, and each of
/// `count` equal stretches gets one point.
///
/// Same mesh, count and seed: same samples. Degenerate faces get none; a mesh without any area has no samples.
pub fn sample_surface(mesh: &TriMesh, count: usize, seed: u64) -> Vec<SurfaceSample> {
    let mut total = 0.0;
    let cumulative: Vec<f64> = (0..mesh.faces().len())
        .map(|f| {
            total += mesh.face_area_vector(f).norm();
            total
        })
        .collect();
    if total == 0.0 {
        return Vec::new();
    }
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let stretch = total / count as f64;
    let mut face = 0;
    let mut samples = Vec::with_capacity(count);
    for i in 0..count {
        let along = (i as f64 + rng.random::<f64>()) * stretch;
        while face + 1 < cumulative.len() && cumulative[face] <= along {
            face += 1;
        }
        // Rounding may carry `along` past the last face with an area.
        let chosen = last_with_area(&cumulative, face);
        samples.push(sample_face(mesh, chosen, rng.random(), rng.random()));
    }
    samples
}

fn last_with_area(cumulative: &[f64], mut face: usize) -> usize {
    while face > 0 && cumulative[face] <= cumulative[face - 1] {
        face -= 1;
    }
    face
}

/// The point of face `face` that `(u, v)` in [0, 1) names; uniform when they are.
fn sample_face(mesh: &TriMesh, face: usize, u: f64, v: f64) -> SurfaceSample {
    let [a, b, c] = mesh.triangle(face);
    // Fold the parallelogram onto the triangle.
    let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
    SurfaceSample {
        point: a + (b - a) * u + (c - a) * v,
        normal: mesh.face_area_vector(face).normalize(),
        face: face as u32,
    }
}

/// The golden angle, pi (3 - sqrt(5)), radians: multiples of it spread evenly over the circle.
pub const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// `count` unit vectors, evenly spread: the Fibonacci sphere, from +z to -z.
pub fn fibonacci_sphere(count: usize) -> Vec<Vector3<f64>> {
    fibonacci_zone(count, [1.0, -1.0]).collect()
}

/// `count` unit vectors, evenly spread over a zone of the sphere: the Fibonacci lattice.
///
/// * `first`, `last`: z of the zone's borders, in [-1, 1]; the vectors go from the first to the last.
pub fn fibonacci_zone(count: usize, [first, last]: [f64; 2]) -> impl Iterator<Item = Vector3<f64>> {
    (0..count).map(move |i| {
        let z = first + (last - first) * ((i as f64 + 0.5) / count as f64);
        let (s, c) = (GOLDEN_ANGLE * i as f64).sin_cos();
        let r = (1.0 - z * z).sqrt();
        Vector3::new(r * c, r * s, z)
    })
}
