//! Cleaning: weld, drop degenerate and duplicate faces, orient, split into components; and the watertight test.
//!
//! Nothing is filled or remeshed: an open mesh stays open, and the report notes it.

mod intersect;
mod orient;
mod topology;

pub use topology::{Defect, check_manifold, check_watertight, components, is_closed};

use crate::error::MeshError;
use crate::fast_hash::{FastMap, map_for, set_for};
use crate::range::in_range;
use crate::trimesh::TriMesh;
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};
use topology::check_fans;

/// Steps of [`clean`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct CleanOptions {
    /// Vertices nearer than this share of the mesh's longest side become one. 0 merges only equal coordinates.
    pub weld: f64,
    /// Components with less than this share of the surface are dropped, in [0, 1); 0 keeps all. The largest one always stays.
    pub min_component_area: f64,
    /// Turn faces so that neighbours agree and every component faces outward. A cavity faces inward: a component that lies wholly inside
    /// another one and touches it nowhere; where two overlap, both are solids.
    pub orient: bool,
}

impl Default for CleanOptions {
    /// Weld within a millionth (ten times f32 rounding), keep every component, orient.
    fn default() -> Self {
        Self { weld: 1e-6, min_component_area: 0.0, orient: true }
    }
}

/// Report of [`clean`].
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CleanReport {
    /// Vertices merged into another.
    pub welded_vertices: usize,
    /// Faces with two equal corners after welding. (A sliver with three corners stays: without it the mesh would tear.)
    pub degenerate_faces: usize,
    /// Faces with the same corners as another one; of a pair with opposite sides both are dropped.
    pub duplicate_faces: usize,
    /// Flipped faces.
    pub flipped_faces: usize,
    /// Number of components.
    pub components: usize,
    /// Components dropped for being small.
    pub dropped_components: usize,
    /// Faces dropped with them.
    pub dropped_faces: usize,
    /// Vertices that no face used, before or after.
    pub unused_vertices: usize,
    /// Every edge has two faces that agree on a side.
    pub watertight: bool,
    /// Watertight, and every vertex has one fan of faces.
    pub manifold: bool,
}

/// Repairs a mesh without adding surface.
///
/// Returns the mesh and a report. Vertices keep their order and their bits.
///
/// # Errors
/// [`MeshError::OutOfRange`] for an option outside its range; [`MeshError::Empty`] when every face was degenerate.
pub fn clean(mesh: &TriMesh, options: &CleanOptions) -> Result<(TriMesh, CleanReport), MeshError> {
    check_share("weld", options.weld)?;
    check_share("min_component_area", options.min_component_area)?;
    let mut report = CleanReport::default();
    let given = mesh.vertices().len();
    // First of all: a vertex without a face, far away, would make the weld distance large.
    let mesh = &compact(mesh.vertices(), mesh.faces().to_vec())?;
    let remap = weld(mesh.vertices(), options.weld * mesh.extent());
    report.welded_vertices = remap.iter().enumerate().filter(|&(i, &v)| v as usize != i).count();
    let mut faces = keep_faces(mesh, &remap, &mut report);
    if faces.is_empty() {
        return Err(MeshError::Empty);
    }
    drop_small(mesh.vertices(), &mut faces, options.min_component_area, &mut report);
    if options.orient {
        report.flipped_faces = orient::orient(mesh.vertices(), &mut faces);
    }
    let unwelded = given - report.welded_vertices;
    let mesh = compact(mesh.vertices(), faces)?;
    report.unused_vertices = unwelded - mesh.vertices().len();
    report.watertight = check_watertight(&mesh).is_ok();
    report.manifold = report.watertight && check_fans(&mesh).is_ok();
    Ok((mesh, report))
}

fn check_share(name: &'static str, value: f64) -> Result<(), MeshError> {
    Ok(in_range(name, value, 0.0..1.0, "")?)
}

/// For each vertex the first one within `distance`, from the 27 grid cells of that width around it.
fn weld(vertices: &[Point3<f64>], distance: f64) -> Vec<u32> {
    // With distance 0 the cell is the coordinate itself; adding 0 makes -0 equal to 0.
    let exact = distance == 0.0;
    let key = |p: &Point3<f64>| -> [i64; 3] {
        if exact {
            [0, 1, 2].map(|k| (p[k] + 0.0).to_bits() as i64)
        } else {
            [0, 1, 2].map(|k| (p[k] / distance).floor() as i64)
        }
    };
    let reach: &[i64] = if exact { &[0] } else { &[-1, 0, 1] };
    let mut cells: FastMap<[i64; 3], Vec<u32>> = map_for(vertices.len());
    let mut remap = Vec::with_capacity(vertices.len());
    for (i, p) in vertices.iter().enumerate() {
        let home = key(p);
        let mut found: Option<u32> = None;
        for x in reach {
            for y in reach {
                for z in reach {
                    let cell = [home[0].wrapping_add(*x), home[1].wrapping_add(*y), home[2].wrapping_add(*z)];
                    for &v in cells.get(&cell).into_iter().flatten() {
                        let near = (vertices[v as usize] - p).norm_squared() <= distance * distance;
                        if near && found.is_none_or(|best| v < best) {
                            found = Some(v);
                        }
                    }
                }
            }
        }
        let target = found.unwrap_or_else(|| {
            cells.entry(home).or_default().push(i as u32);
            i as u32
        });
        remap.push(target);
    }
    remap
}

/// Largest share of faces that may vanish as flaps; a mesh with more of them was modelled with both sides of its surface.
const MAX_FLAPS: f64 = 0.01;

/// The faces that still are triangles after welding, each once.
///
/// Welding folds slivers into flaps: two faces with the same corners and opposite sides, which bound nothing. Both go, or
/// their edges would be left open.
fn keep_faces(mesh: &TriMesh, remap: &[u32], report: &mut CleanReport) -> Vec<[u32; 3]> {
    let welded = mesh.faces().iter().map(|face| face.map(|v| remap[v as usize]));
    let faces: Vec<[u32; 3]> = welded.filter(|[a, b, c]| a != b && b != c && c != a).collect();
    report.degenerate_faces = mesh.faces().len() - faces.len();
    // Faces by their corners: how many more run one way round than the other.
    let mut turns: FastMap<[u32; 3], i32> = map_for(faces.len());
    for face in &faces {
        let (corners, turn) = canonical(*face);
        *turns.entry(corners).or_insert(0) += turn;
    }
    let flaps = turns.values().filter(|t| **t == 0).count();
    let drop_flaps = flaps as f64 <= MAX_FLAPS * faces.len() as f64;
    let mut seen = set_for(turns.len());
    let before = faces.len();
    let kept: Vec<[u32; 3]> = faces
        .into_iter()
        .filter(|face| {
            let (corners, turn) = canonical(*face);
            let net = turns[&corners];
            let cancelled = net == 0 && drop_flaps;
            !cancelled && (net == 0 || net.signum() == turn) && seen.insert(corners)
        })
        .collect();
    report.duplicate_faces = before - kept.len();
    kept
}

/// The corners in ascending order, and whether that is the same turn (1) or the other one (-1).
fn canonical(face: [u32; 3]) -> ([u32; 3], i32) {
    let mut sorted = face;
    sorted.sort_unstable();
    let [a, b, c] = sorted;
    let same = [[a, b, c], [b, c, a], [c, a, b]].contains(&face);
    (sorted, if same { 1 } else { -1 })
}

fn drop_small(vertices: &[Point3<f64>], faces: &mut Vec<[u32; 3]>, min_share: f64, report: &mut CleanReport) {
    let (labels, count) = components(faces);
    report.components = count;
    let mut areas = vec![0.0; count];
    for (face, &label) in faces.iter().zip(&labels) {
        areas[label] += area_vector(vertices, *face).norm();
    }
    let total: f64 = areas.iter().sum();
    let largest = areas.iter().copied().fold(0.0, f64::max);
    let keep: Vec<bool> = areas.iter().map(|&a| a >= min_share * total || a == largest).collect();
    report.dropped_components = keep.iter().filter(|k| !**k).count();
    let before = faces.len();
    let mut label = labels.iter();
    faces.retain(|_| label.next().is_some_and(|&l| keep[l]));
    report.dropped_faces = before - faces.len();
}

pub(crate) fn area_vector(vertices: &[Point3<f64>], face: [u32; 3]) -> Vector3<f64> {
    let [a, b, c] = face.map(|v| vertices[v as usize]);
    (b - a).cross(&(c - a)) * 0.5
}

/// Drops vertices that no face uses.
pub(crate) fn compact(vertices: &[Point3<f64>], mut faces: Vec<[u32; 3]>) -> Result<TriMesh, MeshError> {
    let mut used = vec![false; vertices.len()];
    faces.iter().flatten().for_each(|&v| used[v as usize] = true);
    let mut next = 0;
    let index: Vec<u32> = used
        .iter()
        .map(|&u| {
            let i = next;
            next += u32::from(u);
            i
        })
        .collect();
    faces.iter_mut().flatten().for_each(|v| *v = index[*v as usize]);
    let vertices = vertices.iter().zip(&used).filter(|(_, u)| **u).map(|(p, _)| *p).collect();
    TriMesh::new(vertices, faces)
}
