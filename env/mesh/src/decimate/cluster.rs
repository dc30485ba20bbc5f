//! Fewer faces in linear time: vertices of a cell become one.
//!
//! Faster than [`crate::decimate`](fn@crate::decimate) by far, but the result need be neither closed nor manifold: a first step for meshes
//! of which most faces are too small to matter.
//!
//! Rossignac, Borrel, "Multi-resolution 3D approximations for rendering complex scenes", 1993.

use crate::clean::compact;
use crate::fast_hash::{FastMap, FastSet};
use crate::trimesh::TriMesh;
use nalgebra::{Point3, Vector3};
use std::borrow::Cow;

/// Cells along the longest side at first: 0.4 mm for an object of 20 cm.
const FINEST: f64 = 512.0;
/// The cells grow by this factor until few enough faces are left.
const COARSER: f64 = 1.25;

/// At most `most` faces: the mesh as it is, or one whose vertices were merged in cubic cells, each of which keeps the mean of its vertices.
/// No point moves by more than the diagonal of a cell.
pub(crate) fn at_most(mesh: &TriMesh, most: usize) -> Cow<'_, TriMesh> {
    let mut cell = mesh.extent() / FINEST;
    let mut found = Cow::Borrowed(mesh);
    while found.faces().len() > most.max(4) {
        match cluster(mesh, cell) {
            Some(coarse) => found = Cow::Owned(coarse),
            // Too coarse for any face: the last mesh is used.
            None => break,
        }
        cell *= COARSER;
    }
    found
}

/// `None` if no face is left.
fn cluster(mesh: &TriMesh, cell: f64) -> Option<TriMesh> {
    let origin = mesh.aabb().min;
    let mut numbers: FastMap<[i32; 3], u32> = FastMap::default();
    let (mut sums, mut counts): (Vec<Vector3<f64>>, Vec<f64>) = (Vec::new(), Vec::new());
    let number = |p: &Point3<f64>| {
        let place = [0, 1, 2].map(|k| ((p[k] - origin[k]) / cell) as i32);
        let number = *numbers.entry(place).or_insert(sums.len() as u32);
        if number as usize == sums.len() {
            sums.push(Vector3::zeros());
            counts.push(0.0);
        }
        sums[number as usize] += p - origin;
        counts[number as usize] += 1.0;
        number
    };
    let merged: Vec<u32> = mesh.vertices().iter().map(number).collect();
    let mut seen = FastSet::default();
    let faces: Vec<[u32; 3]> = mesh
        .faces()
        .iter()
        .map(|face| face.map(|v| merged[v as usize]))
        .filter(|[a, b, c]| a != b && b != c && c != a)
        .filter(|&[a, b, c]| {
            // The same corners in the same sense, from the least: sheets that fall together the other way round stay both.
            seen.insert(if a < b && a < c {
                [a, b, c]
            } else if b < c {
                [b, c, a]
            } else {
                [c, a, b]
            })
        })
        .collect();
    let points: Vec<Point3<f64>> = sums.iter().zip(&counts).map(|(sum, count)| origin + sum / *count).collect();
    compact(&points, faces).ok()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    /// A wavy closed surface of 2 n^2 faces, 10 cm.
    fn torus(n: u32) -> TriMesh {
        let angle = |i: u32| f64::from(i) / f64::from(n) * std::f64::consts::TAU;
        let point = |i: u32, k: u32| {
            let ((su, cu), (sv, cv)) = (angle(i).sin_cos(), angle(k).sin_cos());
            let ring = 0.035 + 0.015 * cv;
            Point3::new(ring * cu, ring * su, 0.015 * sv)
        };
        let vertices = (0..n).flat_map(|i| (0..n).map(move |k| point(i, k))).collect();
        let at = |i: u32, k: u32| (i % n) * n + k % n;
        let quad = |i: u32, k: u32| {
            let [a, b, c, d] = [at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)];
            [[a, b, c], [a, c, d]]
        };
        TriMesh::new(vertices, (0..n).flat_map(|i| (0..n).flat_map(move |k| quad(i, k))).collect()).unwrap()
    }

    #[test]
    fn few_faces_stay_and_many_become_few() {
        let mesh = torus(300);
        assert!(matches!(at_most(&mesh, 180_000), Cow::Borrowed(_)));
        let small = at_most(&mesh, 20_000);
        assert!((2_000..=20_000).contains(&small.faces().len()), "{}", small.faces().len());
        assert!((small.signed_volume() / mesh.signed_volume() - 1.0).abs() < 0.02);
        let distance = crate::hausdorff(&mesh, &small, 2000).unwrap();
        assert!(distance.max < 2e-3, "{distance:?}");
    }
}
