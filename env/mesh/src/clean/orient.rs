//! Orientation: neighbours agree, components face outward, cavities inward.

use super::topology::components;
use crate::fast_hash::{FastMap, map_for};
use nalgebra::{Point3, Vector3};
use std::collections::VecDeque;

/// Most ray-triangle tests spent on telling cavities from solids; dust of many thousand components is taken as solid.
const MAX_RAY_TESTS: usize = 100_000_000;

/// Turns faces over in place; returns how many were turned.
///
/// Neighbours are faces that share an edge with exactly two faces. Each set of neighbours is then turned as a whole so that its
/// signed volume is positive, or negative when it lies inside an odd number of other components (a cavity).
pub(super) fn orient(vertices: &[Point3<f64>], faces: &mut [[u32; 3]]) -> usize {
    let before = faces.to_vec();
    let patches = agree(faces);
    let (labels, count) = components(faces);
    let nested = count > 1 && patches.len().saturating_mul(faces.len()) <= MAX_RAY_TESTS;
    for patch in &patches {
        let signed = signed_volume(vertices, faces, patch);
        let inside_out = signed < 0.0;
        let cavity = nested && depth(vertices, faces, &labels, patch) % 2 == 1;
        if inside_out != cavity {
            patch.iter().for_each(|&f| faces[f].swap(1, 2));
        }
    }
    before.iter().zip(faces.iter()).filter(|(a, b)| a != b).count()
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

fn signed_volume(vertices: &[Point3<f64>], faces: &[[u32; 3]], patch: &[usize]) -> f64 {
    let center = patch.iter().flat_map(|&f| faces[f]).map(|v| vertices[v as usize].coords).sum::<Vector3<f64>>()
        / (3 * patch.len()) as f64;
    patch
        .iter()
        .map(|&f| {
            let [a, b, c] = faces[f].map(|v| vertices[v as usize].coords - center);
            a.dot(&b.cross(&c))
        })
        .sum()
}

/// How many other components surround the first corner of `patch`: crossings of a ray, by parity per component.
fn depth(vertices: &[Point3<f64>], faces: &[[u32; 3]], labels: &[usize], patch: &[usize]) -> usize {
    let own = labels[patch[0]];
    let origin = vertices[faces[patch[0]][0] as usize];
    // A direction without symmetry, so that the ray meets no edge of a modelled object.
    let direction = Vector3::new(0.576_813_21, 0.413_557_93, 0.704_453_17);
    let mut crossings = vec![0_usize; labels.iter().max().map_or(0, |m| m + 1)];
    for (face, &label) in faces.iter().zip(labels) {
        if label != own && ray_hits(&origin, &direction, face.map(|v| vertices[v as usize])) {
            crossings[label] += 1;
        }
    }
    crossings.iter().filter(|c| *c % 2 == 1).count()
}

/// Möller and Trumbore, "Fast, minimum storage ray-triangle intersection", 1997.
fn ray_hits(origin: &Point3<f64>, direction: &Vector3<f64>, [a, b, c]: [Point3<f64>; 3]) -> bool {
    let (e1, e2) = (b - a, c - a);
    let p = direction.cross(&e2);
    let det = e1.dot(&p);
    if det == 0.0 {
        return false;
    }
    let s = origin - a;
    let u = s.dot(&p) / det;
    let q = s.cross(&e1);
    let v = direction.dot(&q) / det;
    u >= 0.0 && v >= 0.0 && u + v <= 1.0 && e2.dot(&q) / det > 0.0
}
