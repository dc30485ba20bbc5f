//! Closed shapes with known properties.
#![allow(dead_code, clippy::unwrap_used)]

use graspbox_mesh::TriMesh;
use nalgebra::{Point3, Vector3};
use std::f64::consts::{PI, TAU};

/// A box around the origin.
pub fn cuboid(size: Vector3<f64>) -> TriMesh {
    let corner = |i: u32| {
        let side = |bit: u32| f64::from((i >> bit) & 1) - 0.5;
        Point3::from(Vector3::new(side(0), side(1), side(2)).component_mul(&size))
    };
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let faces = quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    TriMesh::new((0..8).map(corner).collect(), faces).unwrap()
}

/// A ball around the origin: `n` meridians, `n / 2` parallels.
pub fn sphere(radius: f64, n: u32) -> TriMesh {
    let rings = n / 2;
    let mut vertices = vec![Point3::new(0.0, 0.0, -radius)];
    for i in 1..rings {
        let (s, c) = (PI * f64::from(i) / f64::from(rings)).sin_cos();
        vertices.extend((0..n).map(|j| {
            let (y, x) = (TAU * f64::from(j) / f64::from(n)).sin_cos();
            Point3::new(x * s, y * s, -c) * radius
        }));
    }
    vertices.push(Point3::new(0.0, 0.0, radius));
    let at = |i: u32, j: u32| 1 + (i - 1) * n + j % n;
    let top = vertices.len() as u32 - 1;
    let mut faces = Vec::new();
    for j in 0..n {
        faces.push([0, at(1, j + 1), at(1, j)]);
        faces.push([top, at(rings - 1, j), at(rings - 1, j + 1)]);
        for i in 1..rings - 1 {
            faces.push([at(i, j), at(i, j + 1), at(i + 1, j + 1)]);
            faces.push([at(i, j), at(i + 1, j + 1), at(i + 1, j)]);
        }
    }
    TriMesh::new(vertices, faces).unwrap()
}

/// A ring around z; `big` is the radius of its centre line, `small` that of its tube.
pub fn torus(big: f64, small: f64, n: u32) -> TriMesh {
    let mut vertices = Vec::new();
    for i in 0..n {
        let (s, c) = (TAU * f64::from(i) / f64::from(n)).sin_cos();
        vertices.extend((0..n).map(|j| {
            let (z, r) = (TAU * f64::from(j) / f64::from(n)).sin_cos();
            Point3::new(c * (big + small * r), s * (big + small * r), small * z)
        }));
    }
    tube(vertices, n)
}

/// A cup open at the top: outer radius, height, wall (and bottom) thickness.
pub fn cup(radius: f64, height: f64, wall: f64, n: u32) -> TriMesh {
    let profile = [(radius, 0.0), (radius, height), (radius - wall, height), (radius - wall, wall)];
    let mut vertices: Vec<_> = (0..n)
        .flat_map(|i| {
            let (s, c) = (TAU * f64::from(i) / f64::from(n)).sin_cos();
            profile.map(|(r, z)| Point3::new(r * c, r * s, z))
        })
        .collect();
    let (bottom, inside) = (vertices.len() as u32, vertices.len() as u32 + 1);
    vertices.extend([Point3::origin(), Point3::new(0.0, 0.0, wall)]);
    let mut faces = Vec::new();
    for i in 0..n {
        let (a, b) = (4 * i, 4 * ((i + 1) % n));
        faces.push([bottom, b, a]);
        faces.push([inside, a + 3, b + 3]);
        for k in 0..3 {
            faces.push([a + k, b + k, b + k + 1]);
            faces.push([a + k, b + k + 1, a + k + 1]);
        }
    }
    TriMesh::new(vertices, faces).unwrap()
}

fn tube(vertices: Vec<Point3<f64>>, n: u32) -> TriMesh {
    let at = |i: u32, j: u32| (i % n) * n + j % n;
    let faces = (0..n * n)
        .map(|k| (k / n, k % n))
        .flat_map(|(i, j)| [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]])
        .collect();
    TriMesh::new(vertices, faces).unwrap()
}

/// A GLB of a JSON chunk and a binary one.
pub fn glb(json: &str, bytes: &[u8]) -> Vec<u8> {
    let padded = |chunk: &[u8], fill: u8| {
        let mut chunk = chunk.to_vec();
        chunk.resize(chunk.len().next_multiple_of(4), fill);
        chunk
    };
    let chunks = [(padded(json.as_bytes(), b' '), b"JSON"), (padded(bytes, 0), b"BIN\0")];
    let length: usize = 12 + chunks.iter().map(|(chunk, _)| 8 + chunk.len()).sum::<usize>();
    let mut file = [b"glTF".as_slice(), &2_u32.to_le_bytes(), &(length as u32).to_le_bytes()].concat();
    for (chunk, kind) in chunks {
        file.extend([(chunk.len() as u32).to_le_bytes().as_slice(), kind, &chunk].concat());
    }
    file
}
