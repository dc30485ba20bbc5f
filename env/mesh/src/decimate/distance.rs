//! Distance between two surfaces.

use crate::error::MeshError;
use crate::sample::sample_surface;
use crate::trimesh::TriMesh;
use nalgebra::Vector3;
use parry3d::math::Vector;
use parry3d::query::PointQuery;
use serde::{Deserialize, Serialize};

/// Two-sided distance between surfaces, metres.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Hausdorff {
    /// Farthest that a sample of either surface lies from the other one.
    pub max: f64,
    /// Mean distance of all samples.
    pub mean: f64,
    /// Samples on each surface.
    pub samples: usize,
}

/// A mesh with fewer faces, and how far it is from the one it came from.
#[derive(Clone, Debug, PartialEq)]
pub struct Decimated {
    pub mesh: TriMesh,
    /// Its distance from the original, by 10,000 samples on either surface.
    pub hausdorff: Hausdorff,
}

/// The Hausdorff distance between two surfaces by `samples` points on each, uniform by area (seed 0).
///
/// Being sampled, it is a lower bound; distances are in f32 relative to the centre of `a` (about 1e-7 of its size).
///
/// # Errors
/// [`MeshError::Malformed`] if no search tree can be built.
pub fn hausdorff(a: &TriMesh, b: &TriMesh, samples: usize) -> Result<Hausdorff, MeshError> {
    let center = center(a);
    Ok(Surface::new(a, &center, samples)?.distance(&Surface::new(b, &center, samples)?))
}

/// Where the distances of `mesh` are measured from.
pub(super) fn center(mesh: &TriMesh) -> Vector3<f64> {
    let aabb = mesh.aabb();
    nalgebra::center(&aabb.min, &aabb.max).coords
}

/// A surface made ready to be measured, relative to a centre.
pub(super) struct Surface {
    samples: Vec<Vector>,
    tree: parry3d::shape::TriMesh,
}

impl Surface {
    pub(super) fn new(mesh: &TriMesh, center: &Vector3<f64>, samples: usize) -> Result<Self, MeshError> {
        let points = sample_surface(mesh, samples, 0).into_iter();
        Ok(Self { samples: points.map(|s| to_glam(&(s.point.coords - center))).collect(), tree: tree(mesh, center)? })
    }

    pub(super) fn distance(&self, other: &Self) -> Hausdorff {
        let (mut max, mut sum, mut count) = (0.0_f64, 0.0, 0);
        for (from, to) in [(self, other), (other, self)] {
            for sample in &from.samples {
                let d = f64::from(to.tree.distance_to_local_point(*sample, false).abs());
                max = max.max(d);
                sum += d;
                count += 1;
            }
        }
        Hausdorff {
            max,
            mean: if count > 0 { sum / f64::from(count) } else { 0.0 },
            samples: self.samples.len().max(other.samples.len()),
        }
    }
}

fn tree(mesh: &TriMesh, center: &Vector3<f64>) -> Result<parry3d::shape::TriMesh, MeshError> {
    let vertices = mesh.vertices().iter().map(|p| to_glam(&(p.coords - center))).collect();
    parry3d::shape::TriMesh::new(vertices, mesh.faces().to_vec())
        .map_err(|e| MeshError::Malformed { format: "mesh", detail: e.to_string() })
}

fn to_glam(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x as f32, v.y as f32, v.z as f32)
}
