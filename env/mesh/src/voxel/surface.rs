//! Voxels that a triangle touches.
//!
//! A box and a triangle touch where the box' centre lies in the triangle grown by the box. That body is the intersection of 13 slabs,
//! one for each direction of the separating axis theorem: the box' three, the triangle's normal, and the products of their edges.

use nalgebra::Vector3;

/// Half a voxel, and a billionth more: a face between two voxels touches both, for any rounding of its coordinates.
const REACH: f64 = 0.5 + 1e-9;

/// Where the centre of a touching voxel can be along one direction.
struct Slab {
    direction: Vector3<f64>,
    least: f64,
    greatest: f64,
}

impl Slab {
    fn new(direction: Vector3<f64>, triangle: &[Vector3<f64>; 3]) -> Self {
        let along = triangle.map(|p| direction.dot(&p));
        let reach = REACH * direction.abs().sum();
        Self {
            direction,
            least: along[0].min(along[1]).min(along[2]) - reach,
            greatest: along[0].max(along[1]).max(along[2]) + reach,
        }
    }

    fn holds(&self, center: &Vector3<f64>) -> bool {
        let along = self.direction.dot(center);
        self.least <= along && along <= self.greatest
    }
}

/// Sets the voxels that any triangle touches; `corners` in voxels from the least corner of n x n x n voxels.
pub fn mark(corners: &[[f64; 3]], faces: &[[u32; 3]], n: usize, set: &mut [bool]) {
    for face in faces {
        mark_triangle(&face.map(|v| Vector3::from(corners[v as usize])), n, set);
    }
}

fn mark_triangle(triangle: &[Vector3<f64>; 3], n: usize, set: &mut [bool]) {
    let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
    let bounds = axes.map(|axis| Slab::new(axis, triangle));
    // Voxels whose centre lies between `least` and `greatest`, along one axis; a cast stops at 0.
    let range = |least: f64, greatest: f64| {
        let end = ((greatest - 0.5).floor() + 1.0).min(n as f64) as usize;
        (least - 0.5).ceil() as usize..end
    };
    let ranges = [0, 1, 2].map(|a| range(bounds[a].least, bounds[a].greatest));
    if ranges.iter().filter(|range| range.len() == 1).count() > 1 {
        // A triangle within a bar of voxels touches all that it reaches along it.
        for at in voxels(&ranges, n) {
            set[at] = true;
        }
        return;
    }
    let edges = [0, 1, 2].map(|e| triangle[(e + 1) % 3] - triangle[e]);
    let normal = edges[0].cross(&edges[1]);
    let plane = Slab::new(normal, triangle);
    let slabs: [Slab; 9] = std::array::from_fn(|s| Slab::new(edges[s / 3].cross(&axes[s % 3]), triangle));
    // Along the axis that the plane faces most, only the voxels next to the plane are tested.
    let steep = normal.iamax();
    let (u, v) = ((steep + 1) % 3, (steep + 2) % 3);
    let mut at = [0; 3];
    for a in ranges[u].clone() {
        for b in ranges[v].clone() {
            (at[u], at[v]) = (a, b);
            let mut center = Vector3::zeros();
            (center[u], center[v]) = (a as f64 + 0.5, b as f64 + 0.5);
            let near = near_plane(&plane, &center, steep, &ranges[steep], &range);
            for c in near {
                (at[steep], center[steep]) = (c, c as f64 + 0.5);
                if plane.holds(&center) && slabs.iter().all(|slab| slab.holds(&center)) {
                    set[(at[0] * n + at[1]) * n + at[2]] = true;
                }
            }
        }
    }
}

/// Flat indices of a box of voxels.
fn voxels(ranges: &[std::ops::Range<usize>; 3], n: usize) -> impl Iterator<Item = usize> {
    let [i, j, k] = ranges.clone();
    i.flat_map(move |i| {
        let k = k.clone();
        j.clone().flat_map(move |j| k.clone().map(move |k| (i * n + j) * n + k))
    })
}

/// The part of `whole` that can lie in `plane` along the axis `steep`, with a voxel to spare for rounding.
fn near_plane(
    plane: &Slab,
    center: &Vector3<f64>,
    steep: usize,
    whole: &std::ops::Range<usize>,
    range: &impl Fn(f64, f64) -> std::ops::Range<usize>,
) -> std::ops::Range<usize> {
    let slope = plane.direction[steep];
    if slope == 0.0 {
        return whole.clone();
    }
    let base = plane.direction.dot(center);
    let ends = ((plane.least - base) / slope, (plane.greatest - base) / slope);
    let near = range(ends.0.min(ends.1) - 1.0, ends.0.max(ends.1) + 1.0);
    whole.start.max(near.start)..whole.end.min(near.end)
}
