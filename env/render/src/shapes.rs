//! Meshes of simple solids, closed and outward, centred on the origin; metres.

use crate::error::RenderError;
use graspbox_mesh::{TriMesh, in_range};
use nalgebra::{Point3, Vector3};
use std::f64::consts::{PI, TAU};
use std::ops::RangeInclusive;

/// Range of the lengths of a shape, metres.
const LENGTHS: RangeInclusive<f64> = 1e-6..=1e4;

/// A box of these half extents with edges bevelled by `bevel` metres (0 for sharp edges; at most half of the least half extent).
///
/// # Errors
/// [`RenderError::OutOfRange`].
pub fn cuboid(half_extents: Vector3<f64>, bevel: f64) -> Result<TriMesh, RenderError> {
    for half in &half_extents {
        in_range("half_extents", *half, LENGTHS, "m")?;
    }
    in_range("bevel", bevel, 0.0..=half_extents.min() * 0.5, "m")?;
    let sign = |corner: usize, axis: usize| if corner >> axis & 1 == 0 { -1.0 } else { 1.0 };
    if bevel == 0.0 {
        let corner = |c| Point3::from(Vector3::from_fn(|axis, _| sign(c, axis) * half_extents[axis]));
        let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
        return Ok(TriMesh::new((0..8).map(corner).collect(), sides.into_iter().flat_map(fan).collect())?);
    }
    // Vertex 3 c + a: the copy of corner c that lies on the side across axis a.
    let place = |i: usize| {
        let inset = |axis| {
            if axis == i % 3 { half_extents[axis] } else { half_extents[axis] - bevel }
        };
        Point3::from(Vector3::from_fn(|axis, _| sign(i / 3, axis) * inset(axis)))
    };
    let mut faces = Vec::new();
    for a in 0..3 {
        let (b, c) = ((a + 1) % 3, (a + 2) % 3);
        for side in [0, 1] {
            let at = |u: usize, v: usize| (side << a | u << b | v << c) as u32 * 3;
            let (face, to) = (a as u32, b as u32);
            // The side across axis a, then the two strips between it and the sides across b.
            let quad = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)].map(|v| v + face);
            faces.extend(turned(fan(quad), side == 0));
            for u in [0, 1] {
                let strip = [at(u, 0) + face, at(u, 0) + to, at(u, 1) + to, at(u, 1) + face];
                faces.extend(turned(fan(strip), side != u));
            }
        }
    }
    for corner in 0..8_u32 {
        let tip = [[corner * 3, corner * 3 + 1, corner * 3 + 2]; 1];
        faces.extend(turned(tip, corner.count_ones() % 2 == 0));
    }
    Ok(TriMesh::new((0..24).map(place).collect(), faces)?)
}

/// A cylinder about z with `columns` (3 to 1024) sides.
///
/// # Errors
/// [`RenderError::OutOfRange`].
pub fn cylinder(radius: f64, half_length: f64, columns: usize) -> Result<TriMesh, RenderError> {
    in_range("half_length", half_length, LENGTHS, "m")?;
    revolve(&[(radius, -half_length), (radius, half_length)], half_length, radius, columns)
}

/// A ball with `columns` (3 to 1024) meridians and half as many rows; its vertices lie on the sphere.
///
/// # Errors
/// [`RenderError::OutOfRange`].
pub fn sphere(radius: f64, columns: usize) -> Result<TriMesh, RenderError> {
    let rows = (columns / 2).max(2);
    let ring = |i: usize| {
        let (sin, cos) = (PI * i as f64 / rows as f64).sin_cos();
        (radius * sin, -radius * cos)
    };
    let profile: Vec<_> = (1..rows).map(ring).collect();
    revolve(&profile, radius, radius, columns)
}

/// Rings of (radius, z) from below, closed by a vertex at -`pole` and one at +`pole`.
fn revolve(profile: &[(f64, f64)], pole: f64, radius: f64, columns: usize) -> Result<TriMesh, RenderError> {
    in_range("radius", radius, LENGTHS, "m")?;
    in_range("columns", columns as f64, 3.0..=1024.0, "")?;
    let mut vertices = vec![Point3::new(0.0, 0.0, -pole), Point3::new(0.0, 0.0, pole)];
    for (r, z) in profile {
        vertices.extend((0..columns).map(|j| {
            let (sin, cos) = (TAU * j as f64 / columns as f64).sin_cos();
            Point3::new(r * cos, r * sin, *z)
        }));
    }
    let at = |ring: usize, j: usize| (2 + ring * columns + j % columns) as u32;
    let mut faces = Vec::new();
    for j in 0..columns {
        faces.push([0, at(0, j + 1), at(0, j)]);
        for ring in 1..profile.len() {
            faces.extend(fan([at(ring - 1, j), at(ring - 1, j + 1), at(ring, j + 1), at(ring, j)]));
        }
        faces.push([1, at(profile.len() - 1, j), at(profile.len() - 1, j + 1)]);
    }
    Ok(TriMesh::new(vertices, faces)?)
}

fn fan([a, b, c, d]: [u32; 4]) -> [[u32; 3]; 2] {
    [[a, b, c], [a, c, d]]
}

fn turned<const N: usize>(faces: [[u32; 3]; N], turn: bool) -> [[u32; 3]; N] {
    faces.map(|[a, b, c]| if turn { [a, c, b] } else { [a, b, c] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use graspbox_mesh::check_manifold;

    #[test]
    fn solids_are_closed_and_of_the_right_volume() {
        let half = Vector3::new(0.1, 0.2, 0.3);
        let r: f64 = 0.05;
        // A bevel removes b^2/2 along every edge; at each corner b^3/3 of that is counted twice.
        let bevelled = 8.0 * half.product() - 0.5 * 1e-4 * 8.0 * (half.sum() - 0.03) - 8.0 * (1e-6 - 1e-6 / 6.0);
        let solids = [
            (cuboid(half, 0.0).unwrap(), 8.0 * half.product(), 1e-12),
            (cuboid(half, 0.01).unwrap(), bevelled, 1e-6),
            (cylinder(r, 0.2, 256).unwrap(), PI * r * r * 0.4, 1e-3),
            (sphere(r, 256).unwrap(), 4.0 / 3.0 * PI * r.powi(3), 1e-3),
        ];
        for (mesh, volume, relative) in solids {
            check_manifold(&mesh).unwrap();
            assert!((mesh.signed_volume() / volume - 1.0).abs() < relative, "{} {volume}", mesh.signed_volume());
        }
        assert!(cuboid(half, 0.06).is_err() && sphere(-1.0, 8).is_err() && cylinder(0.1, 0.1, 2).is_err());
    }
}
