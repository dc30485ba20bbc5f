//! Voxels whose centre lies inside: grid lines through the centres, and the faces that they cross.

use super::grid::filled;
use super::lines::{crossings, first, off_lines};
use super::options::FillRule;
use crate::error::MeshError;

/// Rays of six that must find a voxel inside: more than half.
const MAJORITY: u8 = 4;

/// Which of n x n x n voxels have their centres inside, and how that was decided; `corners` in voxels from the least corner.
///
/// # Errors
/// [`MeshError::OutOfMemory`].
pub fn fill(corners: &[[f64; 3]], faces: &[[u32; 3]], n: usize) -> Result<(Vec<bool>, FillRule), MeshError> {
    let corners = off_lines(corners);
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

/// The rule that the edges allow: each is kept at the lower of its vertices, and the faces must run along it equally often both ways.
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
    let rows = crossings(corners, faces, n, axis, |along| first(along, n) as u16)?;
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
