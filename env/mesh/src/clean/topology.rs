//! Edges, components and the watertight test.

use crate::fast_hash::{FastMap, map_for};
use crate::trimesh::TriMesh;

/// Why a mesh is not watertight or not manifold; the first offender in the order of the faces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Defect {
    /// A face names a vertex twice.
    #[error("face {face} has two equal corners")]
    DegenerateFace { face: usize },
    /// An edge has only one face: a hole.
    #[error("the edge of vertices {from} and {to} has one face only: the mesh has a hole there")]
    OpenEdge {
        /// First vertex.
        from: u32,
        /// Second vertex.
        to: u32,
    },
    /// Two neighbours disagree about which side is outside, or more than two faces meet.
    #[error("{count} faces run along the edge from vertex {from} to vertex {to} in the same direction")]
    RepeatedEdge {
        /// Where the edge begins.
        from: u32,
        /// Where it ends.
        to: u32,
        /// Number of faces along the edge.
        count: u32,
    },
    /// The faces at a vertex form several fans: two surfaces touch in a point.
    #[error("the faces at vertex {vertex} form more than one fan")]
    PinchedVertex { vertex: u32 },
}

fn directed_edges(faces: &[[u32; 3]]) -> impl Iterator<Item = (u32, u32)> {
    faces.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
}

fn edge_counts(faces: &[[u32; 3]]) -> FastMap<(u32, u32), u32> {
    let mut counts = map_for(faces.len() * 3);
    for edge in directed_edges(faces) {
        *counts.entry(edge).or_insert(0) += 1;
    }
    counts
}

/// Every edge has exactly two faces, and they run along it in opposite directions.
///
/// # Errors
/// The first [`Defect`], in the order of the faces.
pub fn check_watertight(mesh: &TriMesh) -> Result<(), Defect> {
    let faces = mesh.faces();
    if let Some(face) = faces.iter().position(|&[a, b, c]| a == b || b == c || c == a) {
        return Err(Defect::DegenerateFace { face });
    }
    let counts = edge_counts(faces);
    for (from, to) in directed_edges(faces) {
        let count = counts[&(from, to)];
        if count > 1 {
            return Err(Defect::RepeatedEdge { from, to, count });
        }
        if !counts.contains_key(&(to, from)) {
            return Err(Defect::OpenEdge { from, to });
        }
    }
    Ok(())
}

/// Watertight, and the faces at each vertex form one fan.
///
/// # Errors
/// The first [`Defect`].
pub fn check_manifold(mesh: &TriMesh) -> Result<(), Defect> {
    check_watertight(mesh)?;
    check_fans(mesh)
}

/// Of a watertight mesh: the faces at each vertex form one fan.
///
/// # Errors
/// [`Defect::PinchedVertex`] for the first that does not.
pub(super) fn check_fans(mesh: &TriMesh) -> Result<(), Defect> {
    let faces = mesh.faces();
    // On a watertight mesh every face corner has one successor around its vertex, so a fan is a cycle.
    let next: FastMap<(u32, u32), u32> =
        faces.iter().flat_map(|&[a, b, c]| [((a, b), c), ((b, c), a), ((c, a), b)]).collect();
    let mut valence = vec![0_u32; mesh.vertices().len()];
    faces.iter().flatten().for_each(|&v| valence[v as usize] += 1);
    let mut seen = vec![false; mesh.vertices().len()];
    for (from, to) in directed_edges(faces) {
        if std::mem::replace(&mut seen[from as usize], true) {
            continue;
        }
        let (mut around, mut steps) = (to, 0);
        loop {
            around = next[&(from, around)];
            steps += 1;
            if around == to || steps > valence[from as usize] {
                break;
            }
        }
        if steps != valence[from as usize] {
            return Err(Defect::PinchedVertex { vertex: from });
        }
    }
    Ok(())
}

/// The surface has no boundary: along every edge as many faces run one way as the other. Weaker than [`check_watertight`]
/// (touching solids pass), and exactly the condition of volume integrals.
pub fn is_closed(mesh: &TriMesh) -> bool {
    let counts = edge_counts(mesh.faces());
    directed_edges(mesh.faces()).all(|(a, b)| counts.get(&(b, a)) == counts.get(&(a, b)))
}

/// Labels faces by component (faces are connected when they share a vertex); labels count from 0 in the order of the faces.
pub fn components(faces: &[[u32; 3]]) -> (Vec<usize>, usize) {
    let count = faces.iter().flatten().max().map_or(0, |&v| v as usize + 1);
    let mut parent: Vec<u32> = (0..count as u32).collect();
    for &[a, b, c] in faces {
        let root = find(&mut parent, a);
        for v in [b, c] {
            let other = find(&mut parent, v);
            parent[other as usize] = root;
        }
    }
    let mut label_of = vec![usize::MAX; count];
    let mut next = 0;
    let labels = faces
        .iter()
        .map(|f| {
            let root = find(&mut parent, f[0]) as usize;
            if label_of[root] == usize::MAX {
                label_of[root] = next;
                next += 1;
            }
            label_of[root]
        })
        .collect();
    (labels, next)
}

/// Root of `v`, halving the path on the way.
fn find(parent: &mut [u32], mut v: u32) -> u32 {
    while parent[v as usize] != v {
        parent[v as usize] = parent[parent[v as usize] as usize];
        v = parent[v as usize];
    }
    v
}
