//! Closed quad surfaces: rings of points joined side by side, patches cut out, tubes sewn into the holes.
//!
//! Every operation keeps the surface closed and oriented: seen against the direction in which rings follow each other, a ring is counter-clockwise,
//! so quads face outward.

use graspbox_mesh::{MeshError, TriMesh};
use nalgebra::{Point3, Vector2, Vector3};

pub(crate) type P3 = Point3<f64>;

/// Polygons with shared vertices; quads are split along their shorter diagonal when it becomes a mesh.
#[derive(Clone, Debug, Default)]
pub(crate) struct Surface {
    pub(crate) vertices: Vec<P3>,
    pub(crate) triangles: Vec<[u32; 3]>,
    pub(crate) quads: Vec<[u32; 4]>,
}

/// Rows `rows.0..rows.1` and columns `columns.0..columns.1` of the quads of a skin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Patch {
    pub(crate) rows: (usize, usize),
    pub(crate) columns: (usize, usize),
}

impl Patch {
    fn holds(&self, row: usize, column: usize, columns: usize) -> bool {
        let (first, width) = (self.columns.0 % columns, self.columns.1 - self.columns.0);
        (self.rows.0..self.rows.1).contains(&row) && (column + columns - first) % columns < width
    }

    /// Corners of the rim as (row, column), counter-clockwise seen from outside.
    fn rim(&self) -> Vec<(usize, usize)> {
        let ((r0, r1), (c0, c1)) = (self.rows, self.columns);
        let mut rim: Vec<(usize, usize)> = (c0..c1).map(|c| (r0, c)).collect();
        rim.extend((r0..r1).map(|r| (r, c1)));
        rim.extend((c0 + 1..=c1).rev().map(|c| (r1, c)));
        rim.extend((r0 + 1..=r1).rev().map(|r| (r, c0)));
        rim
    }

    /// Vertices of the hole's rim for a tube that leaves here.
    pub(crate) fn outward(&self, columns: usize) -> Vec<u32> {
        self.rim().iter().map(|(r, c)| (r * columns + c % columns) as u32).collect()
    }

    /// Vertices of the hole's rim for a tube that enters after a rotation by pi in the plane of axis and rows.
    pub(crate) fn inward(&self, columns: usize) -> Vec<u32> {
        let flip = self.rows.0 + self.rows.1;
        self.rim().iter().map(|(r, c)| ((flip - r) * columns + c % columns) as u32).collect()
    }

    /// Section of the tube: for each rim vertex a point of the circle, x along the columns, y along the rows.
    pub(crate) fn section(&self) -> Vec<Vector2<f64>> {
        let half = |(low, high): (usize, usize), at: usize| 2.0 * (at - low) as f64 / (high - low) as f64 - 1.0;
        let on_circle = |&(r, c): &(usize, usize)| Vector2::new(half(self.columns, c), half(self.rows, r)).normalize();
        self.rim().iter().map(on_circle).collect()
    }
}

impl Surface {
    /// Joins `rings` (all of one length, one after the other) and closes both ends with a pole.
    ///
    /// Vertex `i * n + j` is point `j` of ring `i`; quad `i * n + j` lies between rings `i` and `i + 1`.
    pub(crate) fn skin(rings: &[Vec<P3>], first_pole: P3, last_pole: P3) -> Self {
        let n = rings[0].len();
        let mut vertices: Vec<P3> = rings.iter().flatten().copied().collect();
        let id = |i: usize, j: usize| (i * n + j % n) as u32;
        let mut quads = Vec::with_capacity(rings.len() * n);
        for i in 0..rings.len() - 1 {
            for j in 0..n {
                quads.push([id(i, j), id(i, j + 1), id(i + 1, j + 1), id(i + 1, j)]);
            }
        }
        let (south, north, last) = (vertices.len() as u32, vertices.len() as u32 + 1, rings.len() - 1);
        vertices.extend([first_pole, last_pole]);
        let mut triangles: Vec<[u32; 3]> = (0..n).map(|j| [south, id(0, j + 1), id(0, j)]).collect();
        triangles.extend((0..n).map(|j| [north, id(last, j), id(last, j + 1)]));
        Self { vertices, triangles, quads }
    }

    /// Removes the quads of `patches` from a skin with `columns` points per ring.
    pub(crate) fn cut(&mut self, columns: usize, patches: &[Patch]) {
        let mut index = 0;
        self.quads.retain(|_| {
            let (row, column) = (index / columns, index % columns);
            index += 1;
            !patches.iter().any(|p| p.holds(row, column, columns))
        });
    }

    /// Sews a tube onto the hole `from` (a loop of [`Patch::outward`]): `rings` of its length, then the hole `to`
    /// (a loop of [`Patch::inward`]), or a cap if there is none.
    pub(crate) fn sew(&mut self, from: &[u32], rings: &[Vec<P3>], to: Option<&[u32]>) {
        let n = from.len();
        let mut last = from.to_vec();
        for ring in rings {
            let base = self.vertices.len() as u32;
            self.vertices.extend(ring);
            let next: Vec<u32> = (base..base + n as u32).collect();
            self.quads.extend((0..n).map(|j| [last[j], last[(j + 1) % n], next[(j + 1) % n], next[j]]));
            last = next;
        }
        match to {
            Some(hole) => {
                self.quads.extend((0..n).map(|j| [last[j], last[(j + 1) % n], hole[(j + 1) % n], hole[j]]));
            }
            None => {
                let sum: Vector3<f64> = last.iter().map(|&v| self.vertices[v as usize].coords).sum();
                let pole = self.vertices.len() as u32;
                self.vertices.push(P3::from(sum / n as f64));
                self.triangles.extend((0..n).map(|j| [pole, last[j], last[(j + 1) % n]]));
            }
        }
    }

    /// Signed volume, m3: positive if the faces point outward.
    pub(crate) fn volume(&self) -> f64 {
        self.split().iter().map(|f| self.signed_tetrahedron(f)).sum()
    }

    /// Centre of the enclosed volume.
    pub(crate) fn centroid(&self) -> P3 {
        let (mut volume, mut moment) = (0.0, Vector3::zeros());
        for f in self.split() {
            let v = self.signed_tetrahedron(&f);
            volume += v;
            moment += f.iter().map(|&i| self.vertices[i as usize].coords).sum::<Vector3<f64>>() * (v / 4.0);
        }
        P3::from(moment / volume)
    }

    fn signed_tetrahedron(&self, face: &[u32; 3]) -> f64 {
        let [a, b, c] = face.map(|v| self.vertices[v as usize].coords);
        a.dot(&b.cross(&c)) / 6.0
    }

    /// All faces as triangles.
    fn split(&self) -> Vec<[u32; 3]> {
        let mut faces = self.triangles.clone();
        for &[a, b, c, d] in &self.quads {
            let length = |p: u32, q: u32| (self.vertices[p as usize] - self.vertices[q as usize]).norm_squared();
            if length(a, c) <= length(b, d) {
                faces.extend([[a, b, c], [a, c, d]]);
            } else {
                faces.extend([[a, b, d], [b, c, d]]);
            }
        }
        faces
    }

    /// The triangle mesh, without vertices that no face uses.
    pub(crate) fn into_mesh(self) -> Result<TriMesh, MeshError> {
        let faces = self.split();
        let mut new_id = vec![u32::MAX; self.vertices.len()];
        let mut vertices = Vec::with_capacity(self.vertices.len());
        let mut renumbered = Vec::with_capacity(faces.len());
        for face in faces {
            renumbered.push(face.map(|v| {
                let slot = &mut new_id[v as usize];
                if *slot == u32::MAX {
                    *slot = vertices.len() as u32;
                    vertices.push(self.vertices[v as usize]);
                }
                *slot
            }));
        }
        TriMesh::new(vertices, renumbered)
    }
}

/// A closed surface with the topology of a box: `cells` quads along each axis, corners at `place(q)` for grid points
/// `q` on the surface of [-1, 1]^3.
pub(crate) fn cube_grid(cells: [usize; 3], place: impl Fn(Vector3<f64>) -> P3) -> Surface {
    let [nx, ny, nz] = cells;
    let key = |i: usize, j: usize, k: usize| (i * (ny + 1) + j) * (nz + 1) + k;
    let mut ids = vec![u32::MAX; (nx + 1) * (ny + 1) * (nz + 1)];
    let mut surface = Surface::default();
    let mut corner = |surface: &mut Surface, at: [usize; 3]| {
        let slot = &mut ids[key(at[0], at[1], at[2])];
        if *slot == u32::MAX {
            *slot = surface.vertices.len() as u32;
            let q = Vector3::from_fn(|axis, _| 2.0 * at[axis] as f64 / cells[axis] as f64 - 1.0);
            surface.vertices.push(place(q));
        }
        *slot
    };
    for axis in 0..3 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        for (side, top) in [(0, false), (cells[axis], true)] {
            for i in 0..cells[u] {
                for j in 0..cells[v] {
                    let mut at = |du: usize, dv: usize| {
                        let mut c = [0; 3];
                        (c[axis], c[u], c[v]) = (side, i + du, j + dv);
                        corner(&mut surface, c)
                    };
                    let [a, b, c, d] = [at(0, 0), at(1, 0), at(1, 1), at(0, 1)];
                    surface.quads.push(if top { [a, b, c, d] } else { [a, d, c, b] });
                }
            }
        }
    }
    surface
}
