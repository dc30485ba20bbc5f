//! The lines of a grid through the centres of its voxels, and the faces that they cross.
//!
//! A face is cut along each row of lines by two of its edges. Where an edge cuts a row is computed only from its two vertices, in
//! the order of their indices, so the faces on both sides of an edge agree to the last bit and every line leaves a closed mesh as
//! often as it enters it: lines through edges or vertices leave no stripes.

use super::grid::out_of_memory;
use crate::error::MeshError;

/// How far centres are moved, in voxels: modelled objects have faces, edges and diagonals right through them. Above rounding
/// (2e-13 in a grid of 1024), and different along the axes so that diagonals are left too.
const TIE: [f64; 3] = [1.0e-9, 1.3e-9, 1.7e-9];

/// A face crosses a line.
pub(crate) struct Crossing<A> {
    /// Position along the line.
    pub along: A,
    /// Which line of its row.
    pub line: u16,
    /// By how much the winding number changes there.
    pub turn: i8,
}

/// The corners, moved off the lines by a billionth of a voxel.
pub(crate) fn off_lines(corners: &[[f64; 3]]) -> Vec<[f64; 3]> {
    corners.iter().map(|p| [0, 1, 2].map(|k| p[k] - TIE[k])).collect()
}

/// The crossings of lines along `axis`, by row of lines; the lines of `n` rows run through (j + 0.5, i + 0.5), in voxels.
///
/// * `corners`: in voxels, as [`off_lines`] returns them.
/// * `place`: the data kept of a place along a line.
///
/// # Errors
/// [`MeshError::OutOfMemory`]: large faces, each across the whole grid, have n * n crossings each.
pub(crate) fn crossings<A>(
    corners: &[[f64; 3]],
    faces: &[[u32; 3]],
    n: usize,
    axis: usize,
    place: impl Fn(f64) -> A,
) -> Result<Vec<Vec<Crossing<A>>>, MeshError> {
    let row = (axis + 1) % 3;
    // A vertex is below the rows from this one on.
    let below: Vec<u16> = corners.iter().map(|p| first(p[row], n) as u16).collect();
    let mut rows: Vec<Vec<Crossing<A>>> = (0..n).map(|_| Vec::new()).collect();
    for face in faces {
        let [a, b, c] = face.map(|v| below[v as usize]);
        let hit = usize::from(a.min(b).min(c))..usize::from(a.max(b).max(c));
        for (j, crossings) in hit.clone().zip(&mut rows[hit]) {
            if let Some((up, down)) = cuts(corners, &below, face, j, axis) {
                cross(&up, &down, n, &place, crossings)?;
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
fn cross<A>(
    up: &Cut,
    down: &Cut,
    n: usize,
    place: impl Fn(f64) -> A,
    crossings: &mut Vec<Crossing<A>>,
) -> Result<(), MeshError> {
    let ends = (first(up.across, n), first(down.across, n));
    let turn = if ends.0 < ends.1 { 1 } else { -1 };
    let lines = ends.0.min(ends.1)..ends.0.max(ends.1);
    let count = crossings.len() + lines.len();
    crossings.try_reserve(lines.len()).map_err(|_| out_of_memory::<Crossing<A>>(count))?;
    for line in lines {
        let share = ((line as f64 + 0.5 - up.across) / (down.across - up.across)).clamp(0.0, 1.0);
        let along = place(up.along + share * (down.along - up.along));
        crossings.push(Crossing { along, line: line as u16, turn });
    }
    Ok(())
}

/// The first voxel whose centre lies beyond `x`; n if there is none.
pub(super) fn first(x: f64, n: usize) -> usize {
    let above = x - 0.5;
    if above < 0.0 { 0 } else { (above.min(n as f64) as usize + 1).min(n) }
}
