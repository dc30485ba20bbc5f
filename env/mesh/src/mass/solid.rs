//! Integrals over the volume that a surface encloses, where signed tetrahedra do not give them: shells that overlap, and
//! surfaces with holes.

use super::moments::Moments;
use crate::mass::face_tree::{FaceTree, Triangle};
use crate::trimesh::{Aabb, TriMesh};
use crate::voxel::lines::{crossings, off_lines};
use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

/// Lines along each side of the bounds that an overlap is measured by.
const LINES: usize = 128;
/// Most surfaces that a line meets on average: each takes 16 bytes per line. The overlap of more tangled meshes is not measured.
const MOST_LAYERS: f64 = 1000.0;
/// Cells along each side of the bounds that an open surface's solid is measured by.
const CELLS: usize = 64;
/// Cells along each side of a block, which is measured as a whole where no face is near.
const BLOCK: usize = 4;
/// Distance from [`INSIDE`] that the winding number of such a block's middle has.
const CLEAR: f64 = 0.2;
/// Share of the mesh's longest side above which a triangle is long. The tree has to visit long ones for most points.
const LONG: f64 = 1.0 / 16.0;
/// Fewest long triangles that are worth cutting, and most pieces per triangle that they may leave.
const MANY_LONG: usize = 1000;
const MOST_PIECES: usize = 16;
/// Winding number of a point that is taken as inside: that of a plane sheet on itself.
const INSIDE: f64 = 0.5;
/// Least mean winding number of the inside: a box without a lid has 0.8, the hollows of a wavy sheet hardly more than [`INSIDE`].
const ENCLOSED: f64 = 0.7;

/// Integrals along the lines of a grid: over the space that a closed mesh winds around, as often as it does, and once.
pub(super) struct Lines {
    /// Counted with the winding number: [`Moments::of`] gives these exactly.
    pub signed: Moments,
    /// Once: where shells overlap, their union.
    pub union: Moments,
}

impl Lines {
    /// Measures a closed mesh about the centre of its bounds; `None` for a flat or tangled one.
    ///
    /// The grid has as many lines along a short side as along a long one. A line's length inside is exact, which leaves a thin wall its
    /// thickness. Inside is where the winding number has the sign of the whole.
    pub fn measure(mesh: &TriMesh) -> Option<Self> {
        let frame = Frame::new(mesh, LINES)?;
        let layers: f64 = (0..mesh.faces().len()).map(|f| mesh.face_area_vector(f).x.abs()).sum();
        if layers > MOST_LAYERS * frame.cell.y * frame.cell.z * frame.cells.powi(2) {
            return None;
        }
        let corners: Vec<[f64; 3]> = mesh.vertices().iter().map(|p| frame.to_cells(p)).collect();
        let rows = crossings(&off_lines(&corners), mesh.faces(), LINES, 0, |along| along).ok()?;
        let mut spans = Vec::new();
        for (row, mut crossings) in rows.into_iter().enumerate() {
            crossings.sort_by(|a, b| a.line.cmp(&b.line).then(a.along.total_cmp(&b.along)));
            for line in crossings.chunk_by(|a, b| a.line == b.line) {
                let mut winding = 0;
                for (here, next) in line.iter().zip(&line[1..]) {
                    winding += i32::from(here.turn);
                    let center = [(here.along + next.along) / 2.0, row as f64 + 0.5, f64::from(here.line) + 0.5];
                    spans.push((center, next.along - here.along, winding));
                }
            }
        }
        let total: f64 = spans.iter().map(|(_, length, winding)| length * f64::from(*winding)).sum();
        let mut lines = Self { signed: Moments::zero(frame.center), union: Moments::zero(frame.center) };
        for (center, length, winding) in spans {
            let (center, sides) =
                (frame.offset_from_center(center), Vector3::new(length * frame.cell.x, frame.cell.y, frame.cell.z));
            lines.signed.add_box(&center, &sides, f64::from(winding) * total.signum());
            if f64::from(winding) * total > 0.0 {
                lines.union.add_box(&center, &sides, 1.0);
            }
        }
        Some(lines)
    }
}

/// Integrals over the cells of a grid that an oriented surface with holes winds around; `None` for a sheet, which encloses nothing.
pub(super) fn enclosed(mesh: &TriMesh) -> Option<Moments> {
    let frame = Frame::new(mesh, CELLS)?;
    let tree = FaceTree::new(short_triangles(mesh));
    let blocks = CELLS / BLOCK;
    let inside: Vec<(Vector3<f64>, f64)> = (0..blocks.pow(3))
        .into_par_iter()
        .flat_map_iter(|block| {
            inside_block(&frame, &tree, [block / (blocks * blocks), block / blocks % blocks, block % blocks])
        })
        .collect();
    let mut all = Moments::zero(frame.center);
    inside.iter().for_each(|(center, _)| all.add_box(center, &frame.cell, 1.0));
    let sum: f64 = inside.iter().map(|(_, winding)| winding).sum();
    (sum > ENCLOSED * inside.len() as f64).then_some(all)
}

/// The triangles of a mesh; if many of them are long, these are cut in pieces, which wind around a point as the whole does.
fn short_triangles(mesh: &TriMesh) -> Vec<Triangle> {
    let longest = |[a, b, c]: &Triangle| [(b - a).norm(), (c - b).norm(), (a - c).norm()];
    let limit = LONG * mesh.extent();
    let is_long = |triangle: &Triangle| longest(triangle).into_iter().any(|edge| edge > limit);
    let whole: Vec<Triangle> = (0..mesh.faces().len()).map(|face| mesh.triangle(face)).collect();
    if whole.iter().filter(|triangle| is_long(triangle)).count() < MANY_LONG {
        return whole;
    }
    let (mut short, mut left) = (Vec::with_capacity(whole.len()), whole.clone());
    while let Some(triangle) = left.pop() {
        if !is_long(&triangle) {
            short.push(triangle);
        } else if short.len() + left.len() > MOST_PIECES * whole.len() {
            return whole;
        } else {
            // In the middle of its longest edge.
            let longest = Vector3::from(longest(&triangle)).imax();
            let [a, b, c] = [0, 1, 2].map(|k| triangle[(longest + k) % 3]);
            let middle = nalgebra::center(&a, &b);
            left.extend([[a, middle, c], [middle, b, c]]);
        }
    }
    short
}

/// The cells of a block that lie inside: their centres from the frame's, and their winding numbers.
fn inside_block(frame: &Frame, tree: &FaceTree, block: [usize; 3]) -> Vec<(Vector3<f64>, f64)> {
    let winding = |center: &Vector3<f64>| tree.winding(&(frame.center + center));
    let middle = frame.offset_from_center(block.map(|i| (i * BLOCK) as f64 + BLOCK as f64 / 2.0));
    let half = frame.cell * (BLOCK as f64);
    let around = Aabb { min: frame.center + middle - half, max: frame.center + middle + half };
    // Away from the surface the winding number changes slowly.
    let whole = Some(winding(&middle)).filter(|w| (w - INSIDE).abs() > CLEAR && !tree.any_touching(&around, |_| true));
    let cells = (0..BLOCK.pow(3)).map(|i| [i / (BLOCK * BLOCK), i / BLOCK % BLOCK, i % BLOCK]);
    let centers =
        cells.map(|cell| frame.offset_from_center([0, 1, 2].map(|k| (block[k] * BLOCK + cell[k]) as f64 + 0.5)));
    let measured = centers.map(|center| (center, whole.unwrap_or_else(|| winding(&center))));
    measured.filter(|(_, winding)| *winding > INSIDE).collect()
}

/// The bounds of a mesh, cut into cells: as many along each side.
struct Frame {
    center: Point3<f64>,
    /// Sides of a cell, metres.
    cell: Vector3<f64>,
    cells: f64,
}

impl Frame {
    fn new(mesh: &TriMesh, cells: usize) -> Option<Self> {
        let bounds = mesh.aabb();
        let (sides, cells) = (bounds.max - bounds.min, cells as f64);
        (sides.min() > 0.0).then(|| Self {
            center: nalgebra::center(&bounds.min, &bounds.max),
            cell: sides / cells,
            cells,
        })
    }

    /// In cells from the least corner.
    fn to_cells(&self, p: &Point3<f64>) -> [f64; 3] {
        ((p - self.center).component_div(&self.cell).add_scalar(self.cells / 2.0)).into()
    }

    /// From cells to metres from the centre.
    fn offset_from_center(&self, cells: [f64; 3]) -> Vector3<f64> {
        Vector3::from(cells).add_scalar(-self.cells / 2.0).component_mul(&self.cell)
    }
}
