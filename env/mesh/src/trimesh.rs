//! The triangle mesh that every other crate takes.

use crate::error::MeshError;
use nalgebra::{Isometry3, Point3, Vector3};
use std::sync::Arc;

/// Farthest coordinate from the origin, metres: no graspable object is a kilometre away; millimetre files read as metres are.
const MAX_COORDINATE: f64 = 1e3;
/// Least longest side, metres: below a micrometre nothing can be grasped and f32 collision queries break down.
const MIN_EXTENT: f64 = 1e-6;

/// An indexed triangle mesh in metres, in the frame of its file.
///
/// Always valid: coordinates are finite and every index exists. It need not be closed, connected or oriented. Copies share their arrays.
#[derive(Clone, Debug, PartialEq)]
pub struct TriMesh {
    vertices: Arc<[Point3<f64>]>,
    faces: Arc<[[u32; 3]]>,
}

/// An axis-aligned box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Aabb {
    /// Least corner, metres.
    pub min: Point3<f64>,
    /// Greatest corner, metres.
    pub max: Point3<f64>,
}

impl Aabb {
    /// The bounds of points; empty, with its least corner beyond its greatest, where there are none.
    pub(crate) fn of<'a>(points: impl IntoIterator<Item = &'a Point3<f64>>) -> Self {
        let empty = Self { min: Point3::from([f64::INFINITY; 3]), max: Point3::from([f64::NEG_INFINITY; 3]) };
        points.into_iter().fold(empty, |all, p| Self { min: all.min.inf(p), max: all.max.sup(p) })
    }

    /// Whether they share a point.
    pub(crate) fn touches(&self, other: &Self) -> bool {
        (0..3).all(|k| self.min[k] <= other.max[k] && other.min[k] <= self.max[k])
    }

    /// Whether `other` lies within, and touches no side.
    pub(crate) fn surrounds(&self, other: &Self) -> bool {
        (0..3).all(|k| self.min[k] < other.min[k] && other.max[k] < self.max[k])
    }

    /// The bounds with `margin` metres more on every side.
    pub(crate) fn grown(&self, margin: f64) -> Self {
        let margin = Vector3::repeat(margin);
        Self { min: self.min - margin, max: self.max + margin }
    }
}

impl TriMesh {
    /// Takes vertices (metres) and counter-clockwise faces.
    ///
    /// # Errors
    /// [`MeshError::Empty`], [`MeshError::NotFinite`] or [`MeshError::BadIndex`], naming the first offender.
    pub fn new(vertices: Vec<Point3<f64>>, faces: Vec<[u32; 3]>) -> Result<Self, MeshError> {
        if faces.is_empty() {
            return Err(MeshError::Empty);
        }
        if let Some(vertex) = vertices.iter().position(|p| !p.coords.iter().all(|x| x.is_finite())) {
            return Err(MeshError::NotFinite { vertex });
        }
        let count = vertices.len();
        for (face, f) in faces.iter().enumerate() {
            if let Some(&vertex) = f.iter().find(|&&v| v as usize >= count) {
                return Err(MeshError::BadIndex { face, vertex, count });
            }
        }
        Ok(Self { vertices: vertices.into(), faces: faces.into() })
    }

    /// Whether the coordinates can be metres of a graspable object.
    ///
    /// # Errors
    /// [`MeshError::TooFar`] for a coordinate beyond a kilometre, [`MeshError::TooSmall`] for a longest side below a micrometre.
    pub fn check_extent(&self) -> Result<(), MeshError> {
        let aabb = self.aabb();
        let value = aabb.min.coords.amax().max(aabb.max.coords.amax());
        // An overflow to infinity by scaling is caught too.
        if value.is_nan() || value > MAX_COORDINATE {
            return Err(MeshError::TooFar { value, limit: MAX_COORDINATE });
        }
        let extent = self.extent();
        if extent < MIN_EXTENT {
            return Err(MeshError::TooSmall { extent, limit: MIN_EXTENT });
        }
        Ok(())
    }

    /// Vertices, metres.
    pub fn vertices(&self) -> &[Point3<f64>] {
        &self.vertices
    }

    /// Faces as vertex indices, counter-clockwise seen from outside.
    pub fn faces(&self) -> &[[u32; 3]] {
        &self.faces
    }

    /// The three corners of face `face`.
    pub fn triangle(&self, face: usize) -> [Point3<f64>; 3] {
        self.faces[face].map(|v| self.vertices[v as usize])
    }

    /// Axis-aligned bounds of all vertices.
    pub fn aabb(&self) -> Aabb {
        Aabb::of(self.vertices.iter())
    }

    /// Surface area, m2.
    pub fn area(&self) -> f64 {
        (0..self.faces.len()).map(|f| self.face_area_vector(f).norm()).sum()
    }

    /// Half the cross product of two edges of face `face`: its normal times its area.
    pub fn face_area_vector(&self, face: usize) -> Vector3<f64> {
        let [a, b, c] = self.triangle(face);
        (b - a).cross(&(c - a)) * 0.5
    }

    /// The mesh moved by `parent_from_mesh`.
    pub fn transformed(&self, parent_from_mesh: &Isometry3<f64>) -> Self {
        let vertices = self.vertices.iter().map(|p| parent_from_mesh * p).collect();
        Self { vertices, faces: Arc::clone(&self.faces) }
    }

    /// The mesh with every coordinate times `scale`.
    pub fn scaled(&self, scale: f64) -> Self {
        let vertices = self.vertices.iter().map(|p| p * scale).collect();
        Self { vertices, faces: Arc::clone(&self.faces) }
    }

    /// Longest side of the bounds, metres.
    pub fn extent(&self) -> f64 {
        let aabb = self.aabb();
        (aabb.max - aabb.min).amax()
    }

    /// Volume by signed tetrahedra, m3: positive for a closed mesh with outward faces; without meaning for an open one.
    pub fn signed_volume(&self) -> f64 {
        let aabb = self.aabb();
        let reference = nalgebra::center(&aabb.min, &aabb.max);
        let tetrahedron = |f: usize| {
            let [a, b, c] = self.triangle(f).map(|p| p - reference);
            a.dot(&b.cross(&c)) / 6.0
        };
        (0..self.faces.len()).map(tetrahedron).sum()
    }

    /// BLAKE3 of vertices (bits) and faces, in their order: equal for equal meshes on every machine.
    pub fn content_hash(&self) -> [u8; 32] {
        let mut hasher = blake3::Hasher::new();
        hasher.update(&(self.vertices.len() as u64).to_le_bytes());
        let mut block = Vec::with_capacity(24 * 1024);
        for chunk in self.vertices.chunks(1024) {
            block.clear();
            block.extend(chunk.iter().flat_map(|p| p.coords.iter().flat_map(|x| x.to_bits().to_le_bytes())));
            hasher.update(&block);
        }
        for chunk in self.faces.chunks(2048) {
            block.clear();
            block.extend(chunk.iter().flatten().flat_map(|v| v.to_le_bytes()));
            hasher.update(&block);
        }
        *hasher.finalize().as_bytes()
    }
}
