//! Voxels whose centre lies inside: grid lines through the centres, and the faces that they cross.
//!
//! A face is cut along each row of lines by two of its edges. Where an edge cuts a row is computed from its two vertices alone, in
//! the order of their indices, so the faces on both sides of an edge agree to the last bit and every line leaves a closed mesh as
//! often as it enters it: there are no stripes, whatever lies on an edge or a vertex.

use super::grid::{filled, out_of_memory};
use super::options::FillRule;
use crate::error::MeshError;

/// How far centres are moved, in voxels: modelled objects have faces, edges and diagonals right through them. Above rounding
/// (2e-13 in a grid of 1024), and different along the axes so that diagonals are left too.
const TIE: [f64; 3] = [1.0e-9, 1.3e-9, 1.7e-9];
/// Rays of six that must find a voxel inside: more than half.
const MAJORITY: u8 = 4;

/// A face crosses a line between the centres `along - 1` and `along`.
struct Crossing {
    along: u16,
    line: u16,
    turn: i8,
}

/// Which of n x n x n voxels have their centres inside, and how that was decided; `corners` in voxels from the least corner.
///
/// # Errors
/// [`MeshError::OutOfMemory`].
pub fn fill(corners: &[[f64; 3]], faces: &[[u32; 3]], n: usize) -> Result<(Vec<bool>, FillRule), MeshError> {
    let corners: Vec<[f64; 3]> = corners.iter().map(|p| [0, 1, 2].map(|k| p[k] - TIE[k])).collect();
    let rule = rule(faces, corners.len());
    let mut set = filled(n * n * n, false)?;
    match rule {
        FillRule::Winding => scan(&corners, faces, n, 0, |at, turns, _| set[at] = turns != 0)?,
        FillRule::Parity => scan(&corners, faces, n, 0, |at, turns, _| set[at] = turns % 2 != 0)?,
        FillRule::Vote => {
            let mut votes = filled(set.len(), 0_u8)?;
            for axis in 0..3 {
                scan(&corners, faces, n, axis, |at, turns, back| {
                    votes[at] += u8::from(turns != 0) + u8::from(back != 0);
                })?;
            }
            set.iter_mut().zip(&votes).for_each(|(s, &v)| *s = v >= MAJORITY);
        }
    }
    Ok((set, rule))
}

/// What the edges allow: each is kept at the lower of its vertices, and the faces must run along it equally often both ways.
fn rule(faces: &[[u32; 3]], vertices: usize) -> FillRule {
    let edges = || {
        let all = faces.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]);
        all.filter(|(a, b)| a != b)
    };
    let mut ends = vec![0_usize; vertices + 1];
    edges().for_each(|(a, b)| ends[a.min(b) as usize] += 1);
    let mut sum = 0;
    for end in &mut ends {
        sum += std::mem::replace(end, sum);
    }
    // Each number is the start of a vertex' edges now, and will be their end.
    let mut kept = vec![(0_u32, 0_i32); sum];
    for (a, b) in edges() {
        let end = &mut ends[a.min(b) as usize];
        kept[*end] = (a.max(b), if a < b { 1 } else { -1 });
        *end += 1;
    }
    let (mut rule, mut start) = (FillRule::Winding, 0);
    for &end in &ends {
        let here = &mut kept[start..end];
        here.sort_unstable();
        for edge in here.chunk_by(|a, b| a.0 == b.0) {
            if edge.len() % 2 != 0 {
                return FillRule::Vote;
            }
            if edge.iter().map(|(_, way)| way).sum::<i32>() != 0 {
                rule = FillRule::Parity;
            }
        }
        start = end;
    }
    rule
}

/// The first voxel whose centre lies beyond `x`; n if there is none.
fn first(x: f64, n: usize) -> usize {
    let above = x - 0.5;
    if above < 0.0 { 0 } else { (above.min(n as f64) as usize + 1).min(n) }
}

/// Calls `visit` for each voxel with its flat index and how often the surface turns around its centre, seen along `axis` from below
/// and from above.
///
/// # Errors
/// [`MeshError::OutOfMemory`].
fn scan(
    corners: &[[f64; 3]],
    faces: &[[u32; 3]],
    n: usize,
    axis: usize,
    mut visit: impl FnMut(usize, i32, i32),
) -> Result<(), MeshError> {
    let stride = [n * n, n, 1];
    let (row, line) = ((axis + 1) % 3, (axis + 2) % 3);
    let rows = crossings(corners, faces, n, axis)?;
    let mut change = vec![0_i32; (n + 1) * n];
    let mut turns = vec![0_i32; n];
    let mut total = vec![0_i32; n];
    for (j, crossings) in rows.iter().enumerate() {
        change.fill(0);
        turns.fill(0);
        total.fill(0);
        for c in crossings {
            change[usize::from(c.along) * n + usize::from(c.line)] += i32::from(c.turn);
            total[usize::from(c.line)] += i32::from(c.turn);
        }
        for k in 0..n {
            let start = k * stride[axis] + j * stride[row];
            let changes = &change[k * n..(k + 1) * n];
            for i in 0..n {
                turns[i] += changes[i];
                visit(start + i * stride[line], turns[i], turns[i] - total[i]);
            }
        }
    }
    Ok(())
}

/// The crossings of lines along `axis`, by row of lines.
///
/// # Errors
/// [`MeshError::OutOfMemory`]: large faces, each across the whole grid, have n * n crossings each.
fn crossings(corners: &[[f64; 3]], faces: &[[u32; 3]], n: usize, axis: usize) -> Result<Vec<Vec<Crossing>>, MeshError> {
    let row = (axis + 1) % 3;
    // A vertex is below the rows from this one on.
    let below: Vec<u16> = corners.iter().map(|p| first(p[row], n) as u16).collect();
    let mut rows: Vec<Vec<Crossing>> = (0..n).map(|_| Vec::new()).collect();
    for face in faces {
        let [a, b, c] = face.map(|v| below[v as usize]);
        let hit = usize::from(a.min(b).min(c))..usize::from(a.max(b).max(c));
        for (j, crossings) in hit.clone().zip(&mut rows[hit]) {
            if let Some((up, down)) = cuts(corners, &below, face, j, axis) {
                cross(&up, &down, n, crossings)?;
            }
        }
    }
    Ok(rows)
}

/// Where an edge cuts a row of lines.
struct Cut {
    across: f64,
    along: f64,
}

/// Where a face's edge goes up through row `j`, and where one comes down.
fn cuts(corners: &[[f64; 3]], below: &[u16], face: &[u32; 3], j: usize, axis: usize) -> Option<(Cut, Cut)> {
    let (row, line) = ((axis + 1) % 3, (axis + 2) % 3);
    let (mut up, mut down) = (None, None);
    for (from, to) in [(face[0], face[1]), (face[1], face[2]), (face[2], face[0])] {
        let is_below = [from, to].map(|v| usize::from(below[v as usize]) <= j);
        if is_below[0] != is_below[1] {
            let (a, b) = (corners[from.min(to) as usize], corners[from.max(to) as usize]);
            let share = (j as f64 + 0.5 - a[row]) / (b[row] - a[row]);
            *if is_below[0] { &mut up } else { &mut down } = Some(Cut {
                across: a[line] + share * (b[line] - a[line]),
                along: a[axis] + share * (b[axis] - a[axis]),
            });
        }
    }
    up.zip(down)
}

/// Adds the crossings of the lines between two cuts.
fn cross(up: &Cut, down: &Cut, n: usize, crossings: &mut Vec<Crossing>) -> Result<(), MeshError> {
    let ends = (first(up.across, n), first(down.across, n));
    let turn = if ends.0 < ends.1 { 1 } else { -1 };
    let lines = ends.0.min(ends.1)..ends.0.max(ends.1);
    let count = crossings.len() + lines.len();
    crossings.try_reserve(lines.len()).map_err(|_| out_of_memory::<Crossing>(count))?;
    for line in lines {
        let share = ((line as f64 + 0.5 - up.across) / (down.across - up.across)).clamp(0.0, 1.0);
        let along = first(up.along + share * (down.along - up.along), n);
        crossings.push(Crossing { along: along as u16, line: line as u16, turn });
    }
    Ok(())
}
