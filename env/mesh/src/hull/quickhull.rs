//! Quickhull in f64 on joggled points.
//!
//! Every point is moved by its own small fixed amount, so that no four lie in one plane to rounding and every decision is clear
//! (Barber, Dobkin, Huhdanpaa, "The quickhull algorithm for convex hulls", 1996; Qhull's option QJ). The joggle is far below f32
//! rounding; the hull names points by index, so the caller gets them unjoggled.

use nalgebra::{Point3, Vector3};

/// Joggle as a share of the size: 0.1 um on a hand-sized object, and 10^10 times f64 rounding. Tried in turn.
const JOGGLES: [f64; 4] = [1e-6, 3e-6, 1e-5, 1e-4];
/// Points nearer than this share of the size count as one: planes through them would be rounding.
const SAME: f64 = 1e-5;

/// No point.
const NONE: u32 = u32::MAX;

struct Face {
    corners: [u32; 3],
    /// Across the edges from corner 0 to 1, 1 to 2, 2 to 0.
    neighbors: [usize; 3],
    normal: Vector3<f64>,
    offset: f64,
    /// The first of the points above this face, and the farthest of them; [`NONE`] without one.
    outside: u32,
    apex: u32,
    dead: bool,
}

/// Faces of the hull of `points`, counter-clockwise from outside, as indices into `points`. `None` when they are flat.
pub(super) fn quickhull(points: &[Point3<f64>]) -> Option<Vec<[u32; 3]>> {
    let first = *points.first()?;
    let (min, max) = points.iter().fold((first, first), |(a, b), p| (a.inf(p), b.sup(p)));
    let size = (max - min).amax();
    let distinct = distinct(points, &first, SAME * size);
    let mut faces = JOGGLES.iter().find_map(|share| {
        let place = |&i: &u32| (points[i as usize] - first) + joggle(u64::from(i)) * (share * size);
        let joggled: Vec<Vector3<f64>> = distinct.iter().map(place).collect();
        Builder::new(&joggled, 4.0 * share * size)?.finish()
    })?;
    faces.iter_mut().flatten().for_each(|v| *v = distinct[*v as usize]);
    Some(faces)
}

/// The first point of each cube of side `same`, ascending.
///
/// The size is at most 10^5 cubes, so that a place fits into 3 times 21 bits. It has its own table, because hulls of some dozen points are
/// made by the ten thousand.
fn distinct(points: &[Point3<f64>], origin: &Point3<f64>, same: f64) -> Vec<u32> {
    /// No cube: the upper bit is never set.
    const EMPTY: u64 = u64::MAX;
    let key = |p: &Point3<f64>| {
        let place = |k: usize| {
            let u = (p[k] - origin[k]) / same;
            ((u + 0.5_f64.copysign(u)) as i64 + (1 << 20)) as u64 & 0x1F_FFFF
        };
        place(0) << 42 | place(1) << 21 | place(2)
    };
    let bits = (2 * points.len()).next_power_of_two().trailing_zeros().max(3);
    let mut table = vec![EMPTY; 1 << bits];
    let mut first = |p: &Point3<f64>| {
        let key = key(p);
        let mut at = (key.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> (64 - bits)) as usize;
        while table[at] != key {
            if table[at] == EMPTY {
                table[at] = key;
                return true;
            }
            at = (at + 1) & (table.len() - 1);
        }
        false
    };
    points.iter().zip(0..).filter(|(p, _)| first(p)).map(|(_, i)| i).collect()
}

/// A vector in [-1, 1] per axis that depends only on the number.
fn joggle(i: u64) -> Vector3<f64> {
    let mut state = i << 8;
    let mut next = || {
        // SplitMix64: Steele, Lea, Flood, "Fast splittable pseudorandom number generators", 2014.
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    Vector3::new(next(), next(), next())
}

struct Builder<'a> {
    points: &'a [Vector3<f64>],
    faces: Vec<Face>,
    /// For each point above a face, the next one above it.
    next: Vec<u32>,
    /// For each point, the new face whose horizon edge begins or ends there: of the newest apex, if it is not older than its first face.
    spokes: Vec<[usize; 2]>,
    /// Reused buffer.
    scratch: Scratch,
}

/// Temporary buffers of [`Builder::add`].
#[derive(Default)]
struct Scratch {
    /// Faces that the new point sees.
    visible: Vec<usize>,
    /// Edges between those and the others: from, to, and the other face.
    horizon: Vec<(u32, u32, usize)>,
    /// Points above the removed faces.
    orphans: Vec<u32>,
    /// Of each new face, the height of its apex.
    highest: Vec<f64>,
}

impl<'a> Builder<'a> {
    /// Begins with a tetrahedron of extreme points; `None` when it is thinner than `least` metres.
    fn new(points: &'a [Vector3<f64>], least: f64) -> Option<Self> {
        let farthest = |score: &dyn Fn(&Vector3<f64>) -> f64| {
            let (best, value) = points
                .iter()
                .map(score)
                .enumerate()
                .fold((0, f64::NEG_INFINITY), |best, (i, s)| if s > best.1 { (i, s) } else { best });
            (value > least).then_some(best)
        };
        let a = farthest(&|p| p.x + 1e9 * least)?;
        let b = farthest(&|p| (p - points[a]).norm())?;
        let along = (points[b] - points[a]).normalize();
        let c = farthest(&|p| (p - points[a]).cross(&along).norm())?;
        let normal = (points[b] - points[a]).cross(&(points[c] - points[a])).normalize();
        let d = farthest(&|p| (p - points[a]).dot(&normal).abs())?;
        let [a, b, c, d] = [a, b, c, d].map(|i| i as u32);
        // Seen from outside a, b, c must turn counter-clockwise: d lies below.
        let (b, c) = if (points[d as usize] - points[a as usize]).dot(&normal) > 0.0 { (c, b) } else { (b, c) };
        let mut builder = Self {
            points,
            faces: Vec::with_capacity(8 * points.len().min(64)),
            next: vec![NONE; points.len()],
            spokes: vec![[0; 2]; points.len()],
            scratch: Scratch::default(),
        };
        for (corners, neighbors) in
            [([a, b, c], [1, 2, 3]), ([b, a, d], [0, 3, 2]), ([c, b, d], [0, 1, 3]), ([a, c, d], [0, 2, 1])]
        {
            builder.push(corners, neighbors);
        }
        let all: Vec<u32> = (0..points.len() as u32).filter(|i| ![a, b, c, d].contains(i)).collect();
        builder.distribute(&all, 0);
        Some(builder)
    }

    fn push(&mut self, corners: [u32; 3], neighbors: [usize; 3]) {
        let [a, b, c] = corners.map(|v| self.points[v as usize]);
        let normal = (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default();
        let offset = normal.dot(&a);
        self.faces.push(Face { corners, neighbors, normal, offset, outside: NONE, apex: NONE, dead: false });
    }

    fn above(&self, face: usize, point: u32) -> f64 {
        self.faces[face].normal.dot(&self.points[point as usize]) - self.faces[face].offset
    }

    /// Assigns each point to the first of the faces from `from` on that it lies above; points inside are dropped.
    fn distribute(&mut self, points: &[u32], from: usize) {
        let mut highest = std::mem::take(&mut self.scratch.highest);
        highest.clear();
        highest.resize(self.faces.len() - from, 0.0);
        for &p in points {
            for face in from..self.faces.len() {
                let above = self.above(face, p);
                if above <= 0.0 {
                    continue;
                }
                let at = &mut self.faces[face];
                self.next[p as usize] = std::mem::replace(&mut at.outside, p);
                if above > highest[face - from] {
                    highest[face - from] = above;
                    at.apex = p;
                }
                break;
            }
        }
        self.scratch.highest = highest;
    }

    /// Adds the farthest point of each face until none is outside. `None` if rounding has torn the horizon.
    fn finish(mut self) -> Option<Vec<[u32; 3]>> {
        let mut at = 0;
        while at < self.faces.len() {
            let Face { dead, apex, .. } = self.faces[at];
            if !dead && apex != NONE {
                self.add(at, apex)?;
            }
            at += 1;
        }
        Some(self.faces.iter().filter(|f| !f.dead).map(|f| f.corners).collect())
    }

    fn add(&mut self, start: usize, apex: u32) -> Option<()> {
        let mut scratch = std::mem::take(&mut self.scratch);
        self.look(start, apex, &mut scratch);
        let base = self.faces.len();
        self.close(apex, &scratch.horizon)?;
        scratch.orphans.clear();
        for face in &scratch.visible {
            let mut p = self.faces[*face].outside;
            while p != NONE {
                if p != apex {
                    scratch.orphans.push(p);
                }
                p = self.next[p as usize];
            }
        }
        let orphans = std::mem::take(&mut scratch.orphans);
        self.scratch = scratch;
        self.distribute(&orphans, base);
        self.scratch.orphans = orphans;
        Some(())
    }

    /// Finds the faces that the apex sees, which are removed, and the horizon around them.
    fn look(&mut self, start: usize, apex: u32, Scratch { visible, horizon, .. }: &mut Scratch) {
        visible.clear();
        horizon.clear();
        visible.push(start);
        self.faces[start].dead = true;
        let mut next = 0;
        while let Some(&face) = visible.get(next) {
            next += 1;
            for side in 0..3 {
                let other = self.faces[face].neighbors[side];
                if self.faces[other].dead {
                    continue;
                }
                if self.above(other, apex) > 0.0 {
                    self.faces[other].dead = true;
                    visible.push(other);
                } else {
                    let corners = self.faces[face].corners;
                    horizon.push((corners[side], corners[(side + 1) % 3], other));
                }
            }
        }
        // A face may have become visible after its neighbour was put on the horizon.
        horizon.retain(|h| !self.faces[h.2].dead);
    }

    /// Puts a face on every edge of the horizon. `None` if rounding has torn it.
    fn close(&mut self, apex: u32, horizon: &[(u32, u32, usize)]) -> Option<()> {
        let base = self.faces.len();
        // Older entries are below `base`, which is at least 4.
        for (&(from, to, _), face) in horizon.iter().zip(base..) {
            for (point, side) in [(from, 0), (to, 1)] {
                let spoke = &mut self.spokes[point as usize][side];
                if *spoke >= base {
                    return None;
                }
                *spoke = face;
            }
        }
        for (i, &(from, to, other)) in horizon.iter().enumerate() {
            let (next, last) = (self.spokes[to as usize][0], self.spokes[from as usize][1]);
            if next < base || last < base {
                return None;
            }
            let neighbors = [other, next, last];
            self.push([from, to, apex], neighbors);
            let corners = self.faces[other].corners;
            let side = (0..3).find(|&s| corners[s] == to && corners[(s + 1) % 3] == from)?;
            self.faces[other].neighbors[side] = base + i;
        }
        Some(())
    }
}
