//! Which nodes of a grid lie inside a mesh: a vote of scan lines.

use crate::trimesh::TriMesh;
use nalgebra::Point3;

/// The lines of a grid through a mesh.
pub(super) struct Lines<'a> {
    pub mesh: &'a TriMesh,
    pub origin: Point3<f64>,
    pub step: f64,
    /// Nodes along each axis.
    pub size: [usize; 3],
}

impl Lines<'_> {
    /// A node is inside if it is inside along at least two of three scan directions.
    pub fn vote(&self) -> Vec<bool> {
        let mut votes = vec![0_u8; self.size.iter().product()];
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let lines = self.crossings(axis);
            for (line, mut hits) in lines.into_iter().enumerate() {
                hits.sort_by(|a, b| a.0.total_cmp(&b.0));
                let mut at = [0; 3];
                (at[u], at[v]) = (line % self.size[u], line / self.size[u]);
                let (mut winding, mut next) = (0, 0);
                for along in 0..self.size[axis] {
                    let height = self.origin[axis] + along as f64 * self.step;
                    while hits.get(next).is_some_and(|h| h.0 < height) {
                        winding += i32::from(hits[next].1);
                        next += 1;
                    }
                    at[axis] = along;
                    votes[(at[2] * self.size[1] + at[1]) * self.size[0] + at[0]] += u8::from(winding != 0);
                }
            }
        }
        votes.iter().map(|votes| *votes >= 2).collect()
    }

    /// Where each grid line along `axis` crosses the mesh, and which way.
    fn crossings(&self, axis: usize) -> Vec<Vec<(f64, i8)>> {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let mut lines = vec![Vec::new(); self.size[u] * self.size[v]];
        // The lines pass slightly off the nodes: modelled objects have edges in grid planes.
        let (du, dv) = (self.step * 1.234_567e-4, self.step * 2.345_678e-4);
        for face in 0..self.mesh.faces().len() {
            let [a, b, c] = self.mesh.triangle(face);
            let twice_area = (b[u] - a[u]) * (c[v] - a[v]) - (b[v] - a[v]) * (c[u] - a[u]);
            if twice_area == 0.0 {
                continue;
            }
            let range = |k: usize, d: f64| {
                let least = (a[k].min(b[k]).min(c[k]) - d - self.origin[k]) / self.step;
                let greatest = (a[k].max(b[k]).max(c[k]) - d - self.origin[k]) / self.step;
                least.ceil() as usize..=(greatest.floor() as usize).min(self.size[k] - 1)
            };
            for j in range(v, dv) {
                for i in range(u, du) {
                    let (x, y) =
                        (self.origin[u] + i as f64 * self.step + du, self.origin[v] + j as f64 * self.step + dv);
                    let weight = |p: &Point3<f64>, q: &Point3<f64>| {
                        ((q[u] - p[u]) * (y - p[v]) - (q[v] - p[v]) * (x - p[u])) / twice_area
                    };
                    let (wa, wb, wc) = (weight(&b, &c), weight(&c, &a), weight(&a, &b));
                    if wa >= 0.0 && wb >= 0.0 && wc >= 0.0 {
                        let height = wa * a[axis] + wb * b[axis] + wc * c[axis];
                        lines[j * self.size[u] + i].push((height, if twice_area > 0.0 { 1 } else { -1 }));
                    }
                }
            }
        }
        lines
    }
}
