//! Orientation: neighbours agree, solids face outward, cavities inward.

use super::intersect::triangles_meet;
use super::topology::components;
use crate::fast_hash::{FastMap, map_for};
use crate::mass::face_tree::{FaceTree, Triangle};
use crate::trimesh::Aabb;
use nalgebra::{Point3, Vector3};
use std::collections::VecDeque;

/// Most pairs of a set of neighbours and a component whose bounds are compared; dust of many thousand components is taken as solid.
const MAX_PAIRS: usize = 100_000_000;
/// Least winding number of a component around its inside: one with small holes surrounds it still, an open bowl does not.
const SURROUNDED: f64 = 0.9;
/// Surfaces nearer than this share of the mesh's longest side touch each other: ten times the rounding of f32.
const TOUCHING: f64 = 1e-6;

/// Share of its area times its size below which the signed volume of a set of neighbours is rounding of f32: it is a plane.
const PLANE: f64 = 1e-6;

/// Flips faces in place; returns their number.
///
/// Neighbours are faces that share an edge with exactly two faces. Each set of neighbours is then turned as a whole so that its
/// signed volume is positive, or negative when it is a cavity: when an odd number of other components surround it. A component surrounds
/// those wholly inside it; one that touches its surface, or reaches through it, is a solid that overlaps it. A plane set, such as the
/// face that two touching solids share, has no volume; it stays as most of its area was.
pub(super) fn orient(vertices: &[Point3<f64>], faces: &mut [[u32; 3]]) -> usize {
    let before = faces.to_vec();
    let patches = agree(faces);
    for patch in &patches {
        if is_turned(vertices, faces, &before, patch) {
            patch.iter().for_each(|&f| faces[f].swap(1, 2));
        }
    }
    for patch in cavities(vertices, faces, &patches) {
        patches[patch].iter().for_each(|&f| faces[f].swap(1, 2));
    }
    before.iter().zip(faces.iter()).filter(|(a, b)| a != b).count()
}

/// The sets of neighbours that an odd number of other components surround; every set faces outward.
fn cavities(vertices: &[Point3<f64>], faces: &[[u32; 3]], patches: &[Vec<usize>]) -> Vec<usize> {
    let (labels, count) = components(faces);
    if count < 2 || patches.len().saturating_mul(count) > MAX_PAIRS {
        return Vec::new();
    }
    let mut members = vec![Vec::new(); count];
    labels.iter().enumerate().for_each(|(face, &label)| members[label].push(face));
    let corners = |f: usize| faces[f].map(|v| vertices[v as usize]);
    let bounds = |faces: &[usize]| Aabb::of(faces.iter().map(|&f| corners(f)).collect::<Vec<_>>().iter().flatten());
    let components: Vec<Aabb> = members.iter().map(|faces| bounds(faces)).collect();
    let whole = Aabb::of(vertices);
    let tolerance = TOUCHING * (whole.max - whole.min).amax();
    // Most components surround nothing, and need no tree.
    let mut trees: Vec<Option<FaceTree>> = members.iter().map(|_| None).collect();
    let mut surrounded = |patch: &[usize]| {
        let (own, inner) = (labels[patch[0]], bounds(patch));
        let around = |&other: &usize| other != own && components[other].surrounds(&inner);
        let found = (0..count).filter(around).filter(|&other| {
            let tree =
                trees[other].get_or_insert_with(|| FaceTree::new(members[other].iter().map(|&f| corners(f)).collect()));
            let meets = |face: Triangle| {
                tree.any_touching(&Aabb::of(&face).grown(tolerance), |other| triangles_meet(&face, other, tolerance))
            };
            tree.winding(&corners(patch[0])[0]) > SURROUNDED && !patch.iter().any(|&f| meets(corners(f)))
        });
        found.count()
    };
    (0..patches.len()).filter(|&patch| surrounded(&patches[patch]) % 2 == 1).collect()
}

/// Makes neighbours agree; returns the sets of connected neighbours, in the order of their first face.
fn agree(faces: &mut [[u32; 3]]) -> Vec<Vec<usize>> {
    let mut by_edge: FastMap<(u32, u32), Vec<usize>> = map_for(faces.len() * 2);
    for (f, &[a, b, c]) in faces.iter().enumerate() {
        for (u, v) in [(a, b), (b, c), (c, a)] {
            by_edge.entry((u.min(v), u.max(v))).or_default().push(f);
        }
    }
    let mut seen = vec![false; faces.len()];
    let mut patches = Vec::new();
    for start in 0..faces.len() {
        if seen[start] {
            continue;
        }
        seen[start] = true;
        let (mut patch, mut queue) = (Vec::new(), VecDeque::from([start]));
        while let Some(f) = queue.pop_front() {
            patch.push(f);
            let [a, b, c] = faces[f];
            for (u, v) in [(a, b), (b, c), (c, a)] {
                let [g, h] = by_edge[&(u.min(v), u.max(v))][..] else {
                    continue;
                };
                let other = if g == f { h } else { g };
                if std::mem::replace(&mut seen[other], true) {
                    continue;
                }
                let [x, y, z] = faces[other];
                if [(x, y), (y, z), (z, x)].contains(&(u, v)) {
                    faces[other].swap(1, 2);
                }
                queue.push_back(other);
            }
        }
        patches.push(patch);
    }
    patches
}

/// Whether a set of neighbours faces inward; of a plane one, whether most of its area faces the other way than it did `before`.
fn is_turned(vertices: &[Point3<f64>], faces: &[[u32; 3]], before: &[[u32; 3]], patch: &[usize]) -> bool {
    let mean = patch.iter().flat_map(|&f| faces[f]).map(|v| vertices[v as usize].coords).sum::<Vector3<f64>>();
    let center = mean / (3 * patch.len()) as f64;
    let (mut volume, mut area, mut kept, mut size) = (0.0, 0.0, 0.0, 0.0_f64);
    for &f in patch {
        let [a, b, c] = faces[f].map(|v| vertices[v as usize].coords - center);
        volume += a.dot(&b.cross(&c));
        let own = (b - a).cross(&(c - a)).norm();
        area += own;
        kept += if faces[f] == before[f] { own } else { -own };
        size = size.max(a.amax()).max(b.amax()).max(c.amax());
    }
    if volume.abs() <= PLANE * area * size { kept < 0.0 } else { volume < 0.0 }
}
