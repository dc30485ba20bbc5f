//! Cut, merge, and give every part few corners.

use super::cell::{Cell, Pool, thicken};
use super::cut::cut_down;
use super::fit::Fit;
use super::merge::merge;
use super::params::PartsParams;
use super::reduce::reduce;
use crate::error::MeshError;
use crate::fast_hash::FastMap;
use crate::hull::convex_hull;
use crate::trimesh::TriMesh;
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// Pieces made before merging, for each part allowed at the end.
const PIECES_PER_PART: usize = 3;
/// Edges longer than this share of the object are halved, so that cuts are judged by more than the ends of a long face.
const LONGEST_EDGE: f64 = 1.0 / 16.0;
/// Nodes of the grid for each inner node wanted: 6000 by default, enough for every corner where cuts cross.
const NODES_PER_INNER: usize = 100;

/// The parts of `mesh`, in its frame; `fit` must be that of the mesh, its origin at `center`.
pub(super) fn decompose(
    mesh: &TriMesh,
    center: Vector3<f64>,
    fit: &Fit,
    params: &PartsParams,
) -> Result<Vec<TriMesh>, MeshError> {
    convex_hull(mesh.vertices())?;
    let (mut pool, faces) = refine(mesh, center, LONGEST_EDGE * mesh.extent());
    pool.extend(inner_nodes(fit, params.max_nodes / NODES_PER_INNER).iter().map(|p| p - center));
    let whole = Cell { faces, points: (0..pool.len() as u32).collect() };
    let most = params.max_parts.saturating_mul(PIECES_PER_PART);
    let pieces = cut_down(whole, &mut pool, fit, params.max_error, most);
    let pieces = merge(pieces, fit, params.max_error, params.max_parts);
    let parts: Result<Vec<TriMesh>, MeshError> = pieces
        .par_iter()
        .map(|piece| {
            let points: Vec<_> = piece.cell.points.iter().map(|&v| pool[v as usize] + center).collect();
            let hull = convex_hull(&points).or_else(|_| convex_hull(&thicken(&points, fit.sliver())))?;
            Ok(reduce(&hull, params.max_points))
        })
        .collect();
    parts
}

fn inner_nodes(fit: &Fit, wanted: usize) -> Vec<Point3<f64>> {
    let all = fit.grid().inside_nodes(1).len();
    let stride = (all as f64 / wanted as f64).cbrt().ceil().max(1.0) as usize;
    fit.grid().inside_nodes(stride)
}

/// Vertices relative to `center`, and faces whose edges are at most `longest` metres.
///
/// Neighbours may be halved differently; for hulls the T-junctions do not matter.
fn refine(mesh: &TriMesh, center: Vector3<f64>, longest: f64) -> (Pool, Vec<[u32; 3]>) {
    let mut pool: Pool = mesh.vertices().iter().map(|p| p - center).collect();
    let mut stack: Vec<[u32; 3]> = mesh.faces().to_vec();
    let mut faces = Vec::with_capacity(stack.len());
    let mut middles: FastMap<(u32, u32), u32> = FastMap::default();
    while let Some(face) = stack.pop() {
        let [a, b, c] = face.map(|v| pool[v as usize]);
        let edges = [(b - a).norm(), (c - b).norm(), (a - c).norm()];
        let worst = (0..3).max_by(|&i, &j| edges[i].total_cmp(&edges[j])).unwrap_or(0);
        if edges[worst] <= longest {
            faces.push(face);
            continue;
        }
        let (i, j, k) = (face[worst], face[(worst + 1) % 3], face[(worst + 2) % 3]);
        // The neighbour across the edge gets the same point.
        let middle = *middles.entry((i.min(j), i.max(j))).or_insert_with(|| {
            pool.push(nalgebra::center(&pool[i as usize], &pool[j as usize]));
            pool.len() as u32 - 1
        });
        stack.extend([[i, middle, k], [middle, j, k]]);
    }
    (pool, faces)
}
