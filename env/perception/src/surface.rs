//! The surface of an occupancy: points and outward normals at the level of a quarter.
//!
//! A wall half a voxel thick on the boundary of two voxels fills a quarter of each, so a higher level would miss it. The surface of a solid is then a
//! quarter of a voxel too far outside.

use graspbox_mesh::VoxelFrame;
use nalgebra::{Point3, Vector3};

/// Least value of an occupied voxel: a quarter.
pub const OCCUPIED: u8 = 64;
/// The level of the surface.
const LEVEL: f64 = 63.5;
/// Least cosine between the gradient and the direction of a free neighbour for the gradient to be the normal; it is below this in a sheet of one
/// voxel.
const AGREES: f64 = 0.3;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// Position in the frame of the grid, metres.
    pub point: Point3<f64>,
    /// Outward unit normal.
    pub normal: Vector3<f64>,
}

/// Points of the surface: one for each pair of an occupied and a free neighbour, at the level of a quarter between their centres (linear
/// interpolation).
///
/// * `occupancy`: (N, N, N), 0 to 255; voxels beyond the grid are free.
#[must_use]
pub fn surface(grid: &VoxelFrame, occupancy: &[u8]) -> Vec<SurfacePoint> {
    let n = grid.resolution();
    let volume = Volume { n, values: occupancy };
    let mut points = Vec::new();
    for (flat, _) in occupancy.iter().enumerate().filter(|(_, value)| **value >= OCCUPIED) {
        let at = [flat / (n * n), flat / n % n, flat % n].map(|i| i as isize);
        let mut gradient = None;
        for (axis, sign) in [(0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1)] {
            let mut next = at;
            next[axis] += sign;
            let (here, there) = (volume.at(at), volume.at(next));
            if there >= LEVEL {
                continue;
            }
            let outward = Vector3::ith(axis, sign as f64);
            let slope: Vector3<f64> = *gradient.get_or_insert_with(|| volume.gradient(at));
            let normal = (-slope).try_normalize(1e-9).filter(|normal| normal.dot(&outward) >= AGREES);
            let share = (here - LEVEL) / (here - there);
            let center = grid.center(at.map(|i| i as usize));
            points.push(SurfacePoint {
                point: center + outward * (share * grid.voxel_size()),
                normal: normal.unwrap_or(outward),
            });
        }
    }
    points
}

/// An occupancy that is 0 beyond its borders.
struct Volume<'a> {
    n: usize,
    values: &'a [u8],
}

impl Volume<'_> {
    fn at(&self, [i, j, k]: [isize; 3]) -> f64 {
        let n = self.n as isize;
        let inside = |x: isize| (0..n).contains(&x);
        if inside(i) && inside(j) && inside(k) { f64::from(self.values[((i * n + j) * n + k) as usize]) } else { 0.0 }
    }

    /// Differences along the axes, each smoothed across (Sobel's weights 1, 2, 1).
    fn gradient(&self, at: [isize; 3]) -> Vector3<f64> {
        let mut sum = Vector3::zeros();
        for di in -1..=1_isize {
            for dj in -1..=1_isize {
                for dk in -1..=1_isize {
                    let weight = |d: isize| 2.0 - d.abs() as f64;
                    let value = self.at([at[0] + di, at[1] + dj, at[2] + dk]);
                    let (x, y, z) = (di as f64, dj as f64, dk as f64);
                    sum += value
                        * Vector3::new(
                            x * weight(dj) * weight(dk),
                            y * weight(di) * weight(dk),
                            z * weight(di) * weight(dj),
                        );
                }
            }
        }
        sum
    }
}
