//! Shapes and random motions shared by the tests.
#![allow(dead_code)]

use graspbox_mesh::TriMesh;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3, Vector4};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

pub fn rng(seed: u64) -> ChaCha8Rng {
    ChaCha8Rng::seed_from_u64(seed)
}

pub fn uniform(rng: &mut ChaCha8Rng) -> f64 {
    2.0 * rng.random::<f64>() - 1.0
}

pub fn random_rotation(rng: &mut ChaCha8Rng) -> UnitQuaternion<f64> {
    loop {
        let q = Vector4::from_fn(|_, _| uniform(rng));
        if q.norm() > 0.1 && q.norm() < 1.0 {
            return UnitQuaternion::from_quaternion(nalgebra::Quaternion::from(q));
        }
    }
}

pub fn random_motion(rng: &mut ChaCha8Rng) -> Isometry3<f64> {
    let rotation = random_rotation(rng);
    let shift = Vector3::from_fn(|_, _| uniform(rng));
    Isometry3::from_parts(Translation3::from(shift), rotation)
}

pub fn cloud(count: usize, size: Vector3<f64>, seed: u64) -> Vec<Point3<f64>> {
    let mut rng = rng(seed);
    (0..count).map(|_| Point3::from(Vector3::from_fn(|i, _| size[i] * uniform(&mut rng)))).collect()
}

/// Several cuboids (centre, half extents) as one mesh.
pub fn cuboids(parts: &[([f64; 3], [f64; 3])]) -> TriMesh {
    let mut vertices = Vec::new();
    let mut faces = Vec::new();
    for (center, half) in parts {
        let base = vertices.len() as u32;
        for i in 0..8 {
            let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
            vertices.push(Point3::from(Vector3::from_fn(|k, _| center[k] + sign(k) * half[k])));
        }
        let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        faces.extend(quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).map(|f| f.map(|v| v + base)));
    }
    TriMesh::new(vertices, faces).unwrap()
}

/// A hammer along x: a handle and a transverse head of different sizes, without symmetry.
pub fn hammer() -> TriMesh {
    cuboids(&[([0.0, 0.0, 0.015], [0.12, 0.012, 0.009]), ([0.135, 0.012, 0.018], [0.015, 0.06, 0.018])])
}

/// A surface of revolution about z from a profile of (radius, height), closed at both ends.
pub fn lathe(profile: &[(f64, f64)], columns: u32) -> TriMesh {
    let mut vertices = vec![Point3::new(0.0, 0.0, profile[0].1)];
    for &(radius, height) in profile {
        for j in 0..columns {
            let (s, c) = (std::f64::consts::TAU * f64::from(j) / f64::from(columns)).sin_cos();
            vertices.push(Point3::new(radius * c, radius * s, height));
        }
    }
    vertices.push(Point3::new(0.0, 0.0, profile[profile.len() - 1].1));
    let top = vertices.len() as u32 - 1;
    let at = |ring: u32, j: u32| 1 + ring * columns + j % columns;
    let mut faces = Vec::new();
    for j in 0..columns {
        faces.push([0, at(0, j + 1), at(0, j)]);
        faces.push([top, at(profile.len() as u32 - 1, j), at(profile.len() as u32 - 1, j + 1)]);
        for ring in 0..profile.len() as u32 - 1 {
            faces.push([at(ring, j), at(ring, j + 1), at(ring + 1, j)]);
            faces.push([at(ring, j + 1), at(ring + 1, j + 1), at(ring + 1, j)]);
        }
    }
    TriMesh::new(vertices, faces).unwrap()
}

/// Random points on the faces of a mesh, by area.
pub fn surface_points(mesh: &TriMesh, count: usize, seed: u64) -> Vec<Point3<f64>> {
    let mut rng = rng(seed);
    let areas: Vec<f64> = (0..mesh.faces().len()).map(|f| mesh.face_area_vector(f).norm()).collect();
    let total: f64 = areas.iter().sum();
    (0..count)
        .map(|_| {
            let mut left = rng.random::<f64>() * total;
            let mut face = 0;
            while face + 1 < areas.len() && left > areas[face] {
                left -= areas[face];
                face += 1;
            }
            let [a, b, c] = mesh.triangle(face);
            let (mut u, mut v) = (rng.random::<f64>(), rng.random::<f64>());
            if u + v > 1.0 {
                (u, v) = (1.0 - u, 1.0 - v);
            }
            a + (b - a) * u + (c - a) * v
        })
        .collect()
}
