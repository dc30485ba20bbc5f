//! A cell: the piece of the solid on one side of every cut so far, as the points that can lie on its hull.
//!
//! Its hull is that of the clipped surface and of inner points: where two cuts cross inside the solid, no surface marks the
//! corner, and grid nodes inside the solid take its place.

use crate::fast_hash::FastMap;
use crate::hull::hull_indexed;
use nalgebra::{Point3, Vector3};

/// Points of all cells: mesh vertices, points where edges were cut, inner nodes.
pub(super) type Pool = Vec<Point3<f64>>;

/// A plane: the points with `normal . x = offset`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plane {
    pub normal: Vector3<f64>,
    pub offset: f64,
}

/// A convex hull, relative to the centre of the mesh.
#[derive(Clone)]
pub(super) struct Hull {
    pub points: Vec<Point3<f64>>,
    pub faces: Vec<[u32; 3]>,
    pub volume: f64,
}

/// A piece of the solid.
#[derive(Clone, Default)]
pub(super) struct Cell {
    /// Clipped faces, as pool indices.
    pub faces: Vec<[u32; 3]>,
    /// Every point of the cell once: corners of its faces, and inner nodes.
    pub points: Vec<u32>,
}

impl Cell {
    /// Cuts in two: the part on the positive side of the plane, and that on the negative one.
    pub fn cut(&self, pool: &mut Pool, plane: &Plane) -> [Cell; 2] {
        let height = |p: &Point3<f64>| plane.normal.dot(&p.coords) - plane.offset;
        let mut halves = [Cell::default(), Cell::default()];
        let mut on_edge = FastMap::default();
        for face in &self.faces {
            let heights = face.map(|v| height(&pool[v as usize]));
            if heights.iter().all(|h| *h >= 0.0) {
                halves[0].faces.push(*face);
            } else if heights.iter().all(|h| *h <= 0.0) {
                halves[1].faces.push(*face);
            } else {
                clip(pool, &mut on_edge, face, &heights, &mut halves);
            }
        }
        for &v in &self.points {
            let h = height(&pool[v as usize]);
            if h >= 0.0 {
                halves[0].points.push(v);
            }
            if h <= 0.0 {
                halves[1].points.push(v);
            }
        }
        for half in &mut halves {
            half.points.extend(half.faces.iter().flatten());
            half.points.sort_unstable();
            half.points.dedup();
        }
        halves
    }
}

/// Splits one face that the plane crosses; cut points of shared edges are made once.
fn clip(
    pool: &mut Pool,
    on_edge: &mut FastMap<(u32, u32), u32>,
    face: &[u32; 3],
    heights: &[f64; 3],
    halves: &mut [Cell; 2],
) {
    let mut polygons: [Vec<u32>; 2] = [Vec::with_capacity(4), Vec::with_capacity(4)];
    for i in 0..3 {
        let j = (i + 1) % 3;
        let (a, b, ha, hb) = (face[i], face[j], heights[i], heights[j]);
        if ha >= 0.0 {
            polygons[0].push(a);
        }
        if ha <= 0.0 {
            polygons[1].push(a);
        }
        if ha * hb < 0.0 {
            // From the lower index to the higher, so that both neighbours get the same bits.
            let (u, v, hu, hv) = if a < b { (a, b, ha, hb) } else { (b, a, hb, ha) };
            let cut = *on_edge.entry((u, v)).or_insert_with(|| {
                let (p, q) = (pool[u as usize], pool[v as usize]);
                pool.push(p + (q - p) * (hu / (hu - hv)));
                pool.len() as u32 - 1
            });
            polygons[0].push(cut);
            polygons[1].push(cut);
        }
    }
    for (half, polygon) in halves.iter_mut().zip(&polygons) {
        for w in polygon.get(1..).unwrap_or_default().windows(2) {
            half.faces.push([polygon[0], w[0], w[1]]);
        }
    }
}

/// Every point and its six neighbours `by` metres along the axes: flat points then have a hull.
pub(super) fn thicken(points: &[Point3<f64>], by: f64) -> Vec<Point3<f64>> {
    let sides = [Vector3::x(), Vector3::y(), Vector3::z()];
    points.iter().flat_map(|p| sides.iter().flat_map(move |s| [p + s * by, p - s * by])).collect()
}

/// The hull of `points`; `None` when they are flat.
pub(super) fn hull_of(points: &[Point3<f64>]) -> Option<Hull> {
    let (points, faces) = hull_indexed(points)?;
    let volume = volume(&points, &faces);
    let (min, max) = points.iter().fold((points[0], points[0]), |(a, b), p| (a.inf(p), b.sup(p)));
    let size = (max - min).amax();
    // Flatter than this the f32 of the physics engine cannot distinguish inside from outside.
    (volume > 1e-6 * size.powi(3)).then_some(Hull { points, faces, volume })
}

fn volume(points: &[Point3<f64>], faces: &[[u32; 3]]) -> f64 {
    let Some(&reference) = points.first() else { return 0.0 };
    faces
        .iter()
        .map(|f| {
            let [a, b, c] = f.map(|v| points[v as usize] - reference);
            a.dot(&b.cross(&c)) / 6.0
        })
        .sum()
}
