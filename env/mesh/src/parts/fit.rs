//! How well hulls fit the mesh.

use super::cell::Hull;
use crate::distance_grid::DistanceGrid;
use crate::hull::planes;
use crate::sample::sample_surface;
use crate::trimesh::TriMesh;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// Samples on the mesh by which underfill is measured.
const SURFACE_SAMPLES: usize = 4000;
/// Samples on a hull for a coarse and for a fine measurement.
const COARSE_SAMPLES: usize = 64;
/// See [`COARSE_SAMPLES`].
const FINE_SAMPLES: usize = 320;
/// A hull that stands out by this many times the allowed error at the coarse measurement is not measured again.
const HOPELESS: f64 = 3.0;
/// Share of a hull's surface that may stand out farther: a groove or a rim does not cost a part.
const SPARED: f64 = 0.02;

/// Measures hulls against one mesh.
pub(super) struct Fit<'a> {
    grid: DistanceGrid<'a>,
    center: Vector3<f64>,
    /// Distance between samples on a hull, metres.
    spacing: f64,
    max_error: f64,
}

/// Distances in metres.
pub(super) struct Errors {
    pub greatest: f64,
    pub mean: f64,
}

impl<'a> Fit<'a> {
    /// * `center`: the hulls' origin in the mesh's frame.
    pub fn new(mesh: &'a TriMesh, center: Vector3<f64>, max_error: f64, max_nodes: usize) -> Self {
        let grid = DistanceGrid::new(mesh, 0.25 * max_error, max_nodes);
        let spacing = (2.0 * grid.step()).max(max_error);
        Self { grid, center, spacing, max_error }
    }

    pub fn grid(&self) -> &DistanceGrid<'a> {
        &self.grid
    }

    /// Half the thickness given to a flat piece, metres: a tenth of the allowed error.
    pub fn sliver(&self) -> f64 {
        0.1 * self.max_error
    }

    /// Grid step, metres.
    pub fn step(&self) -> f64 {
        self.grid.step()
    }

    /// How far the hull stands out of the mesh, metres, by samples spread evenly over it: the distance that all but
    /// [`SPARED`] of its surface keeps.
    pub fn error(&self, hull: &Hull) -> f64 {
        let mut distances = self.distances(hull, COARSE_SAMPLES);
        let coarse = quantile(&mut distances);
        if coarse > HOPELESS * self.max_error {
            return coarse;
        }
        quantile(&mut self.distances(hull, FINE_SAMPLES))
    }

    /// Distances of `count` points outside the mesh, uniform by area, the same for the same hull.
    fn distances(&self, hull: &Hull, count: usize) -> Vec<f64> {
        let corners = |f: &[u32; 3]| f.map(|v| hull.points[v as usize] + self.center);
        let area = |[a, b, c]: [Point3<f64>; 3]| (b - a).cross(&(c - a)).norm();
        let total: f64 = hull.faces.iter().map(|f| area(corners(f))).sum();
        let stretch = total / count as f64;
        let (mut along, mut next, mut k) = (0.0, 0.5 * stretch, 0_u32);
        let mut distances = Vec::with_capacity(count);
        for face in &hull.faces {
            let [a, b, c] = corners(face);
            along += area([a, b, c]);
            while next < along && distances.len() < count {
                let [u, v] = plastic(k);
                distances.push(self.grid.outside(&(a + (b - a) * u + (c - a) * v)));
                next += stretch;
                k += 1;
            }
        }
        distances
    }

    /// How far the parts stand out of the mesh: greatest distance, and mean over their surface.
    pub fn overfill(&self, parts: &[TriMesh]) -> Errors {
        let measured = |part: &TriMesh| {
            let mut samples = Vec::new();
            for face in 0..part.faces().len() {
                each_sample(part.triangle(face), self.spacing, &mut |p, weight| {
                    samples.push((self.grid.outside(p), weight));
                });
            }
            samples
        };
        // Added up one by one, in the order of the parts: the sum does not depend on the number of threads.
        let measured: Vec<Vec<(f64, f64)>> = parts.par_iter().map(measured).collect();
        let (mut greatest, mut sum, mut area) = (0.0_f64, 0.0, 0.0);
        for (d, weight) in measured.into_iter().flatten() {
            greatest = greatest.max(d);
            sum += d * weight;
            area += weight;
        }
        Errors { greatest, mean: if area > 0.0 { sum / area } else { 0.0 } }
    }

    /// How far the mesh stands out of the parts: greatest and mean over samples of its surface.
    pub fn underfill(mesh: &TriMesh, parts: &[TriMesh]) -> Errors {
        let planes: Vec<Vec<(Vector3<f64>, f64)>> = parts.iter().map(planes).collect();
        let samples = sample_surface(mesh, SURFACE_SAMPLES, 0);
        let (mut greatest, mut sum) = (0.0_f64, 0.0);
        for s in &samples {
            // Highest plane of a part: its distance near a face, a little less beyond an edge.
            let above = |part: &Vec<(Vector3<f64>, f64)>| {
                part.iter().map(|(n, d)| n.dot(&s.point.coords) - d).fold(f64::NEG_INFINITY, f64::max)
            };
            let d = planes.iter().map(above).fold(f64::INFINITY, f64::min).max(0.0);
            greatest = greatest.max(d);
            sum += d;
        }
        Errors { greatest, mean: sum / samples.len().max(1) as f64 }
    }
}

/// Calls `visit` with points of a triangle no more than about `spacing` apart, and the area that each stands for.
fn each_sample([a, b, c]: [Point3<f64>; 3], spacing: f64, visit: &mut impl FnMut(&Point3<f64>, f64)) {
    let longest = (b - a).norm().max((c - b).norm()).max((a - c).norm());
    let n = (longest / spacing).ceil().clamp(1.0, 64.0) as u32;
    let (u, v) = ((b - a) / f64::from(n), (c - a) / f64::from(n));
    let weight = u.cross(&v).norm() * 0.5;
    for i in 0..n {
        for j in 0..n - i {
            let corner = a + u * f64::from(i) + v * f64::from(j);
            visit(&(corner + (u + v) / 3.0), weight);
            if i + j + 1 < n {
                visit(&(corner + (u + v) * (2.0 / 3.0)), weight);
            }
        }
    }
}

fn quantile(distances: &mut [f64]) -> f64 {
    let last = distances.len().saturating_sub(1);
    let place = (last as f64 * (1.0 - SPARED)).floor() as usize;
    if place < distances.len() { *distances.select_nth_unstable_by(place, f64::total_cmp).1 } else { 0.0 }
}

/// Barycentric coordinates of an evenly spread sequence: the R2 sequence (of the plastic number), folded onto the triangle.
fn plastic(k: u32) -> [f64; 2] {
    let u = (f64::from(k) * 0.754_877_666_246_692_8 + 0.5).fract();
    let v = (f64::from(k) * 0.569_840_290_998_053_3 + 0.5).fract();
    if u + v > 1.0 { [1.0 - u, 1.0 - v] } else { [u, v] }
}
