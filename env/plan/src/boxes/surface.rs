//! A piece of surface that is cut by planes. Triangles are clipped, so no part of the surface is lost between two boxes.

use graspbox_mesh::TriMesh;
use nalgebra::Point3;

/// A set of triangles with shared vertices; every vertex is used.
#[derive(Clone, Debug, Default)]
pub(crate) struct Surface {
    pub vertices: Vec<Point3<f64>>,
    triangles: Vec<[u32; 3]>,
}

const UNSET: u32 = u32::MAX;

impl Surface {
    /// The whole surface of `mesh`, without unused vertices.
    pub fn of(mesh: &TriMesh) -> Self {
        let mut kept = vec![UNSET; mesh.vertices().len()];
        let mut surface = Self::default();
        for &face in mesh.faces() {
            surface.keep(face, mesh.vertices(), &mut kept);
        }
        surface
    }

    /// Cuts by a plane; `side` returns the signed distance of a point. Returns the part with negative distances, then the rest; points on the
    /// plane belong to both.
    pub fn cut(&self, side: impl Fn(&Point3<f64>) -> f64) -> [Self; 2] {
        let distances: Vec<f64> = self.vertices.iter().map(side).collect();
        let mut halves = [Self::default(), Self::default()];
        let mut kept = [vec![UNSET; distances.len()], vec![UNSET; distances.len()]];
        for &face in &self.triangles {
            let d = face.map(|v| distances[v as usize]);
            if d.iter().all(|&x| x <= 0.0) {
                halves[0].keep(face, &self.vertices, &mut kept[0]);
            } else if d.iter().all(|&x| x >= 0.0) {
                halves[1].keep(face, &self.vertices, &mut kept[1]);
            } else {
                for (half, sign) in halves.iter_mut().zip([-1.0, 1.0]) {
                    half.keep_clipped(face.map(|v| self.vertices[v as usize]), d.map(|x| x * sign));
                }
            }
        }
        halves
    }

    fn keep(&mut self, face: [u32; 3], vertices: &[Point3<f64>], kept: &mut [u32]) {
        let triangle = face.map(|v| {
            let slot = &mut kept[v as usize];
            if *slot == UNSET {
                *slot = self.vertices.len() as u32;
                self.vertices.push(vertices[v as usize]);
            }
            *slot
        });
        self.triangles.push(triangle);
    }

    /// Adds the part of a triangle with nonnegative distances: three or four corners.
    fn keep_clipped(&mut self, corners: [Point3<f64>; 3], distances: [f64; 3]) {
        let first = self.vertices.len() as u32;
        for i in 0..3 {
            let j = (i + 1) % 3;
            let (a, b) = (distances[i], distances[j]);
            if a >= 0.0 {
                self.vertices.push(corners[i]);
            }
            if (a < 0.0 && b > 0.0) || (a > 0.0 && b < 0.0) {
                self.vertices.push(corners[i] + (corners[j] - corners[i]) * (a / (a - b)));
            }
        }
        let end = self.vertices.len() as u32;
        self.triangles.extend((first + 2..end).map(|last| [first, last - 1, last]));
    }
}
