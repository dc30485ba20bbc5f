//! Distance from any point to a mesh, with sign, on a grid.
//!
//! Every node stores its closest face (rasterized near the surface, passed on from node to node elsewhere) and whether it lies
//! inside. Inside is a vote of three scan directions over signed crossings, so a mesh with a few holes or overlapping shells
//! still has an inside. A query near the surface measures the faces stored at its cell's corners; so walls thinner than the
//! grid keep their place.
//!
//! Own code: the sign of `parry3d`'s point queries needs a closed, oriented mesh.

mod lines;
mod scan;

use crate::trimesh::TriMesh;
use lines::Lines;
use nalgebra::{Point3, Vector3};
use scan::NodeColumns;

/// Nodes around the bounds, so that points just outside are on the grid.
const PAD: usize = 3;
/// Most nodes along one side.
const MAX_SIDE: f64 = 256.0;

/// A signed distance function of a mesh, sampled on a grid: negative inside.
pub struct DistanceGrid<'a> {
    mesh: &'a TriMesh,
    origin: Point3<f64>,
    step: f64,
    size: [usize; 3],
    nodes: Vec<Node>,
    faces: Vec<Face>,
    inside: Vec<bool>,
}

/// Data of a node: one read of memory; a query needs eight.
#[derive(Clone, Copy)]
struct Node {
    /// Distance of the closest face, negative inside, metres.
    signed: f32,
    face: u32,
}

/// A face, with everything that a query needs of it in one place.
struct Face {
    corners: [Point3<f64>; 3],
    /// Outward unit normal; 0 without area.
    normal: Vector3<f64>,
}

impl<'a> DistanceGrid<'a> {
    /// Samples `mesh` on a grid as fine as about `max_nodes` nodes allow, but no finer than `min_step` metres.
    pub fn new(mesh: &'a TriMesh, min_step: f64, max_nodes: usize) -> Self {
        let aabb = mesh.aabb();
        let sides = aabb.max - aabb.min;
        let longest = sides.amax();
        // A thin object still has a padding of PAD nodes.
        let volume: f64 = sides.iter().map(|s| s.max(longest / 32.0)).product();
        let step = (volume / max_nodes as f64).cbrt().max(longest / MAX_SIDE).max(min_step);
        let size = [0, 1, 2].map(|k| (sides[k] / step).ceil() as usize + 1 + 2 * PAD);
        let origin = aabb.min - Vector3::repeat(PAD as f64 * step);
        let nodes = size.iter().product();
        let face = |face| Face {
            corners: mesh.triangle(face),
            normal: mesh.face_area_vector(face).try_normalize(0.0).unwrap_or_default(),
        };
        let mut grid = Self {
            mesh,
            origin,
            step,
            size,
            nodes: Vec::new(),
            inside: Vec::new(),
            faces: (0..mesh.faces().len()).map(face).collect(),
        };
        let places = [0, 1, 2].map(|k| (0..size[k]).map(|i| (origin[k] + i as f64 * step) as f32).collect());
        let (inside, known) = rayon::join(
            || Lines { mesh, origin, step, size }.vote(),
            || {
                let mut known = NodeColumns::new(nodes);
                grid.rasterize(&mut known);
                // Nodes next to a face are exact already.
                known.scan(&places, (step * step) as f32);
                known
            },
        );
        grid.nodes = grid.measure(&known, &inside);
        grid.inside = inside;
        grid
    }

    /// Distance between two nodes, metres.
    pub fn step(&self) -> f64 {
        self.step
    }

    /// The nodes inside the mesh, every `stride`-th along each axis.
    pub fn inside_nodes(&self, stride: usize) -> Vec<Point3<f64>> {
        let mut nodes = Vec::new();
        for z in (PAD..self.size[2]).step_by(stride) {
            for y in (PAD..self.size[1]).step_by(stride) {
                for x in (PAD..self.size[0]).step_by(stride) {
                    if self.inside[self.index([x, y, z])] {
                        nodes.push(self.node([x, y, z]));
                    }
                }
            }
        }
        nodes
    }

    /// Distance of `p` outside the mesh, metres; 0 inside and on the surface.
    ///
    /// Within about two steps of the surface the error is a small part of a step; farther away up to a step. Points beyond the grid are
    /// measured from its edge.
    pub fn outside(&self, p: &Point3<f64>) -> f64 {
        let mut base = [0; 3];
        let mut fraction = [0.0; 3];
        for k in 0..3 {
            let u = ((p[k] - self.origin[k]) / self.step).clamp(0.0, (self.size[k] - 1) as f64 - 1e-9);
            base[k] = u as usize;
            fraction[k] = u - base[k] as f64;
        }
        let (mut signed, mut faces) = (0.0, [u32::MAX; 8]);
        for (corner, face) in faces.iter_mut().enumerate() {
            let offset = [corner & 1, (corner >> 1) & 1, corner >> 2];
            let weight: f64 = (0..3).map(|k| if offset[k] == 1 { fraction[k] } else { 1.0 - fraction[k] }).product();
            let node = self.nodes[self.index([base[0] + offset[0], base[1] + offset[1], base[2] + offset[2]])];
            signed += weight * f64::from(node.signed);
            *face = node.face;
        }
        if signed < -2.0 * self.step {
            return 0.0;
        }
        if signed > 2.0 * self.step {
            return signed;
        }
        self.near(p, signed, &mut faces)
    }

    /// Distance to the nearest of `faces`; the sign is the grid's beyond half a step and that of the face within.
    fn near(&self, p: &Point3<f64>, signed: f64, faces: &mut [u32; 8]) -> f64 {
        sort(faces);
        let (mut best, mut side, mut last) = (f64::INFINITY, 1.0_f64, u32::MAX);
        for &face in faces.iter() {
            if face == last || face == u32::MAX {
                continue;
            }
            last = face;
            let Face { corners, normal } = &self.faces[face as usize];
            // A face is no nearer than its plane; twice the tolerance below leaves room for rounding.
            if (p - corners[0]).dot(normal).abs() > best + 2e-9 {
                continue;
            }
            let d = p - closest_point(p, corners);
            let s = d.dot(normal);
            let distance = d.norm();
            // At an edge two faces are equally near; the one that faces the point more decides.
            let tie = distance < best + 1e-9 && s.abs() > side.abs();
            if distance < best - 1e-9 || tie {
                (best, side) = (distance.min(best), s);
            }
        }
        let within = if best > 0.5 * self.step { signed < 0.0 } else { side < 0.0 };
        // None of the corners may store the nearest face (next to an edge); the grid's own value is then the smaller one.
        if within { 0.0 } else { best.min(signed.max(0.0)) }
    }

    /// Distances of all nodes: a query reads eight, in no order.
    fn measure(&self, known: &NodeColumns, inside: &[bool]) -> Vec<Node> {
        let distance = |(i, inside): (usize, &bool)| {
            let at = [i % self.size[0], i / self.size[0] % self.size[1], i / (self.size[0] * self.size[1])];
            let distance = known.squared(i, &self.node(at).map(|x| x as f32).into()).sqrt();
            Node { signed: if *inside { -distance } else { distance }, face: known.face[i] }
        };
        inside.iter().enumerate().map(distance).collect()
    }

    fn index(&self, at: [usize; 3]) -> usize {
        (at[2] * self.size[1] + at[1]) * self.size[0] + at[0]
    }

    fn node(&self, at: [usize; 3]) -> Point3<f64> {
        self.origin + Vector3::new(at[0] as f64, at[1] as f64, at[2] as f64) * self.step
    }

    /// Stores each face at the nodes around it. Large faces are cut up, so that only nodes near them are visited.
    fn rasterize(&self, known: &mut NodeColumns) {
        let aabb = self.mesh.aabb();
        let reach = aabb.min.coords.amax().max(aabb.max.coords.amax());
        // Distances are compared in f32: eight times its rounding.
        let slack = 8.0 * f64::from(f32::EPSILON) * reach;
        let mut stack = Vec::new();
        for (face, &Face { corners, normal }) in self.faces.iter().enumerate() {
            let center = Point3::from((corners[0].coords + corners[1].coords + corners[2].coords) / 3.0);
            let radius = corners.iter().map(|p| (p - center).norm()).fold(0.0, f64::max);
            let whole = BoundedFace { face: face as u32, corners, center, radius, normal };
            stack.push(corners);
            while let Some(piece) = stack.pop() {
                let [a, b, c] = piece;
                let edges = [(b - a).norm(), (c - b).norm(), (a - c).norm()];
                let longest = (0..3).max_by(|&i, &j| edges[i].total_cmp(&edges[j])).unwrap_or(0);
                if edges[longest] > 4.0 * self.step {
                    let (i, j, k) = (longest, (longest + 1) % 3, (longest + 2) % 3);
                    let middle = nalgebra::center(&piece[i], &piece[j]);
                    stack.push([piece[i], middle, piece[k]]);
                    stack.push([middle, piece[j], piece[k]]);
                } else {
                    self.bound_nodes(known, &whole, &piece, slack);
                }
            }
        }
    }

    /// * `slack`: greatest error of a distance in f32, metres.
    fn bound_nodes(&self, known: &mut NodeColumns, whole: &BoundedFace, [a, b, c]: &[Point3<f64>; 3], slack: f64) {
        let (least, greatest) = (a.inf(b).inf(c), a.sup(b).sup(c));
        let low = [0, 1, 2].map(|k| (((least[k] - self.origin[k]) / self.step) - 1.0).floor().max(0.0) as usize);
        let high = [0, 1, 2]
            .map(|k| ((((greatest[k] - self.origin[k]) / self.step) + 1.0).ceil() as usize).min(self.size[k] - 1));
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                let row = self.index([0, y, z]);
                for x in low[0]..=high[0] {
                    let (i, at) = (row + x, self.node([x, y, z]));
                    let node = at.map(|x| x as f32);
                    let squared = known.squared(i, &node.into());
                    // Most nodes store a face that is nearer than this one can be. (k + s)^2 <= k^2 (1 + e) + s^2 (1 + 1 / e), e = 1e-4.
                    if whole.least_squared(&at) > f64::from(squared) * 1.0001 + slack * slack * 10_001.0 {
                        continue;
                    }
                    let closest = closest_point(&at, &whole.corners).map(|x| x as f32);
                    if (node - closest).norm_squared() < squared {
                        known.set(i, whole.face, closest.into());
                    }
                }
            }
        }
    }
}

/// A face, and a lower bound of its distance.
struct BoundedFace {
    face: u32,
    corners: [Point3<f64>; 3],
    /// Of a ball around it.
    center: Point3<f64>,
    radius: f64,
    /// Unit normal; 0 without area.
    normal: Vector3<f64>,
}

impl BoundedFace {
    /// The square of a distance that `p` keeps from the face at least: from the disk that the ball cuts from the plane.
    fn least_squared(&self, p: &Point3<f64>) -> f64 {
        let d = p - self.center;
        let height = d.dot(&self.normal);
        let beside = ((d.norm_squared() - height * height).max(0.0).sqrt() - self.radius).max(0.0);
        height * height + beside * beside
    }
}

/// Sorts eight numbers by 19 exchanges without branches (Batcher's odd-even merge sort).
fn sort(x: &mut [u32; 8]) {
    const EXCHANGES: [[usize; 2]; 19] = [
        [0, 1],
        [2, 3],
        [4, 5],
        [6, 7],
        [0, 2],
        [1, 3],
        [4, 6],
        [5, 7],
        [1, 2],
        [5, 6],
        [0, 4],
        [1, 5],
        [2, 6],
        [3, 7],
        [2, 4],
        [3, 5],
        [1, 2],
        [3, 4],
        [5, 6],
    ];
    for [i, j] in EXCHANGES {
        (x[i], x[j]) = (x[i].min(x[j]), x[i].max(x[j]));
    }
}

/// Closest point of a triangle: Ericson, "Real-Time Collision Detection", 2005, section 5.1.5.
fn closest_point(p: &Point3<f64>, [a, b, c]: &[Point3<f64>; 3]) -> Point3<f64> {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return *a;
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return *b;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 && d1 != d3 {
        return a + ab * (d1 / (d1 - d3));
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return *c;
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 && d2 != d6 {
        return a + ac * (d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 && (d4 - d3) + (d5 - d6) > 0.0 {
        return b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    let sum = va + vb + vc;
    if sum == 0.0 {
        // A sliver without area; its corners are closer than rounding to everything between them.
        return *a;
    }
    a + ab * (vb / sum) + ac * (vc / sum)
}
