//! Surface nets: a vertex for each sheet of the surface in a grid cell, a quad across each edge that it crosses.
//!
//! Source: Gibson, "Constrained elastic surface nets", MICCAI 1998. Here the vertices are then pulled onto the surface,
//! each within its own cell, which keeps the quads from crossing. A cell with two sheets has two
//! vertices, after Nielson, "Dual marching cubes", Visualization 2004.
//!
//! Own code: the crate `fast-surface-nets` places one vertex per cell, so two sheets in one cell join at a non-manifold edge.

use crate::surface::{P3, Surface};
use graspbox_mesh::clean::components;
use graspbox_mesh::{MeshError, check_manifold};
use nalgebra::{Matrix3, Vector3};

/// Accepted range of the number of faces; outside of it, the grid gets coarser or finer.
const FACES: (usize, usize) = (700, 7800);
/// Grids tried: offsets of the grid, and changes of its step.
const TRIES: usize = 10;

/// A closed manifold surface of `distance` = 0 on a grid of about `step` (per axis, metres) over `low`..`high`.
///
/// # Errors
/// [`MeshError::NoManifoldSurface`] when no grid gives one in ten tries.
pub(crate) fn surface(
    distance: impl Fn(&P3) -> f64,
    (low, high): (P3, P3),
    step: Vector3<f64>,
) -> Result<Surface, MeshError> {
    let mut step = step;
    for attempt in 0..TRIES {
        // Two surfaces in one cell may join by mistake; another offset of the grid separates them.
        let origin = low - step * (1.0 + 0.37 * attempt as f64 % 1.0);
        let net = Net::new(&distance, origin, high, step).polygonize();
        let faces = net.quads.len() * 2;
        if faces > FACES.1 {
            step *= (faces as f64 / (FACES.1 as f64 * 0.93)).sqrt();
        } else if faces < FACES.0 {
            step *= 0.7;
        } else if let Some(net) = in_one_piece(net)
            && check_manifold(&net.clone().into_mesh()?).is_ok()
        {
            return Ok(net);
        }
    }
    Err(MeshError::NoManifoldSurface { tries: TRIES })
}

/// Greatest share of the quads in loose pieces: pockets in a crease of a cell's size, never a limb.
const LOOSE: f64 = 0.01;

/// The net without loose pieces; `None` if these are more than [`LOOSE`].
fn in_one_piece(mut net: Surface) -> Option<Surface> {
    let corners: Vec<[u32; 3]> = net.quads.iter().flat_map(|&[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    let (labels, count) = components(&corners);
    let mut sizes = vec![0usize; count];
    labels.iter().for_each(|&l| sizes[l] += 1);
    let largest = (0..count).max_by_key(|&l| sizes[l])?;
    if ((corners.len() - sizes[largest]) as f64) > LOOSE * corners.len() as f64 {
        return None;
    }
    let mut index = 0;
    net.quads.retain(|_| {
        index += 2;
        labels[index - 2] == largest
    });
    Some(net)
}

/// The label of an edge that the surface does not cross.
const NO_SHEET: usize = 12;

/// Corner `bits` (x, y, z from the lowest bit) of a cell.
fn corner(at: [usize; 3], bits: usize) -> [usize; 3] {
    [at[0] + (bits & 1), at[1] + (bits >> 1 & 1), at[2] + (bits >> 2 & 1)]
}

/// Corners of an edge: `4 * axis + du + 2 * dv`, u and v being the axes after it.
fn edge_corners(edge: usize) -> [usize; 2] {
    let (axis, place) = (edge / 4, edge % 4);
    let from = (place & 1) << ((axis + 1) % 3) | (place >> 1) << ((axis + 2) % 3);
    [from, from | 1 << axis]
}

/// Gives both edges' sheets one label.
fn unite(sheet: &mut [usize; 12], a: usize, b: usize) {
    let (old, new) = (sheet[a].max(sheet[b]), sheet[a].min(sheet[b]));
    sheet.iter_mut().filter(|s| **s == old).for_each(|s| *s = new);
}

struct Net<'a, F> {
    distance: &'a F,
    origin: P3,
    step: Vector3<f64>,
    count: [usize; 3],
    values: Vec<f64>,
}

impl<'a, F: Fn(&P3) -> f64> Net<'a, F> {
    fn new(distance: &'a F, origin: P3, high: P3, step: Vector3<f64>) -> Self {
        let count = [0, 1, 2].map(|axis| ((high[axis] - origin[axis]) / step[axis]).ceil() as usize + 2);
        let mut net = Self { distance, origin, step, count, values: Vec::new() };
        net.values.reserve(count.iter().product());
        for i in 0..count[0] {
            for j in 0..count[1] {
                for k in 0..count[2] {
                    net.values.push(distance(&net.point([i, j, k])));
                }
            }
        }
        net
    }

    fn point(&self, at: [usize; 3]) -> P3 {
        self.origin + Vector3::from_fn(|axis, _| at[axis] as f64 * self.step[axis])
    }

    fn index(&self, at: [usize; 3]) -> usize {
        (at[0] * self.count[1] + at[1]) * self.count[2] + at[2]
    }

    fn inside(&self, at: [usize; 3]) -> bool {
        self.values[self.index(at)] < 0.0
    }

    fn polygonize(&self) -> Surface {
        let mut surface = Surface::default();
        // For each crossed cell, the vertex of each of its 12 edges.
        let mut slots = vec![u32::MAX; self.values.len()];
        let mut edge_vertices: Vec<[u32; 12]> = Vec::new();
        self.each(|at| {
            let sheets = self.sheets(at);
            if sheets.iter().any(|s| *s < NO_SHEET) {
                slots[self.index(at)] = edge_vertices.len() as u32;
                let mut vertices = [u32::MAX; 12];
                for sheet in 0..12 {
                    if sheets.contains(&sheet) {
                        let edges = (0..12).filter(|&e| sheets[e] == sheet);
                        edges.clone().for_each(|e| vertices[e] = surface.vertices.len() as u32);
                        surface.vertices.push(self.sheet_point(at, edges));
                    }
                }
                edge_vertices.push(vertices);
            }
        });
        self.each(|at| {
            for axis in 0..3 {
                let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
                let mut end = at;
                end[axis] += 1;
                let (a, b) = (self.inside(at), self.inside(end));
                if a == b || at[u] == 0 || at[v] == 0 {
                    continue;
                }
                // The edge's number in each of the four cells around it.
                let vertex = |du: usize, dv: usize| {
                    let mut c = at;
                    (c[u], c[v]) = (c[u] - du, c[v] - dv);
                    edge_vertices[slots[self.index(c)] as usize][axis * 4 + du + 2 * dv]
                };
                let [p, q, r, s] = [vertex(1, 1), vertex(0, 1), vertex(0, 0), vertex(1, 0)];
                surface.quads.push(if a { [p, q, r, s] } else { [p, s, r, q] });
            }
        });
        surface
    }

    /// The sheet (a number below 12) of each crossed edge of a cell; [`NO_SHEET`] for the others.
    fn sheets(&self, at: [usize; 3]) -> [usize; 12] {
        let inside: [bool; 8] = std::array::from_fn(|bits| self.inside(corner(at, bits)));
        let mut sheet = [NO_SHEET; 12];
        for (edge, label) in sheet.iter_mut().enumerate() {
            let [a, b] = edge_corners(edge);
            if inside[a] != inside[b] {
                *label = edge;
            }
        }
        if sheet == [NO_SHEET; 12] {
            return sheet;
        }
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for side in 0..2 {
                // The face's edges: along u at both ends of v, along v at both ends of u.
                let along_u = |dv: usize| u * 4 + dv + 2 * side;
                let along_v = |du: usize| v * 4 + side + 2 * du;
                let edges = [along_u(0), along_v(1), along_u(1), along_v(0)];
                let crossed: Vec<usize> = edges.into_iter().filter(|&e| sheet[e] < NO_SHEET).collect();
                let first_inside = inside[side << axis];
                match crossed[..] {
                    [a, b] => unite(&mut sheet, a, b),
                    // Inside corners face each other across the face: each is cut off by itself.
                    [a, b, c, d] if first_inside => (unite(&mut sheet, d, a), unite(&mut sheet, b, c)).1,
                    [a, b, c, d] => (unite(&mut sheet, a, b), unite(&mut sheet, c, d)).1,
                    _ => {}
                }
            }
        }
        sheet
    }

    /// Visits every cell by its lowest corner.
    fn each(&self, mut visit: impl FnMut([usize; 3])) {
        for i in 0..self.count[0] - 1 {
            for j in 0..self.count[1] - 1 {
                for k in 0..self.count[2] - 1 {
                    visit([i, j, k]);
                }
            }
        }
    }

    /// The point of one sheet in a cell: where the tangent planes at its edges' crossings meet best, which keeps edges
    /// sharp (Ju et al., "Dual contouring of Hermite data", SIGGRAPH 2002), pulled onto the surface.
    fn sheet_point(&self, at: [usize; 3], edges: impl Iterator<Item = usize> + Clone) -> P3 {
        let crossing = |edge: usize| {
            let [from, to] = edge_corners(edge).map(|bits| corner(at, bits));
            let (a, b) = (self.values[self.index(from)], self.values[self.index(to)]);
            let (p, q) = (self.point(from), self.point(to));
            p + (q - p) * (a / (a - b))
        };
        let points: Vec<P3> = edges.map(crossing).collect();
        let mean = P3::from(points.iter().map(|p| p.coords).sum::<Vector3<f64>>() / points.len() as f64);
        // A weak pull to the mean keeps flat places well posed.
        let (mut planes, mut pull) = (Matrix3::identity() * 0.05, Vector3::zeros());
        for p in &points {
            let normal = self.gradient(p).normalize();
            planes += normal * normal.transpose();
            pull += normal * normal.dot(&(p - mean));
        }
        let best = planes.try_inverse().map_or(mean, |inverse| mean + inverse * pull);
        self.settle(best, self.point(at))
    }

    fn gradient(&self, p: &P3) -> Vector3<f64> {
        let h = self.step.min() * 1e-3;
        Vector3::from_fn(|axis, _| {
            let e = Vector3::ith(axis, h);
            ((self.distance)(&(p + e)) - (self.distance)(&(p - e))) / (2.0 * h)
        })
    }

    /// Moves a point onto the surface, within the cell.
    fn settle(&self, start: P3, cell: P3) -> P3 {
        let rim = self.step * 0.05;
        let within = |p: P3| p.sup(&(cell + rim)).inf(&(cell + self.step - rim));
        let mut p = within(start);
        for _ in 0..2 {
            let gradient = self.gradient(&p);
            p = within(p - gradient * ((self.distance)(&p) / gradient.norm_squared().max(0.25)));
        }
        p
    }
}
