//! How far a hand is from the middle of the object that it grasps: a long object that is held at its end tips or slips out.
//!
//! The cells around a hand do not show the end of a long object. This measure sees the whole crop.

use crate::hand_grid::HandGrid;
use crate::surface::OCCUPIED;
use graspbox_mesh::VoxelFrame;
use nalgebra::{Isometry3, Vector2};
use rayon::prelude::*;

/// Standard deviation of the weights of voxels by their distance from the fingertips in plan view, metres. It bounds the lever, and keeps the other
/// end of a heap out of it.
const NEARBY: f64 = 0.05;

/// Distance in plan view, metres, from the point where the fingertips close to the middle of the occupied voxels near it, at each of m poses.
///
/// * `occupancy`: (N, N, N), 0 to 255.
/// * `grasps`: for each grasp `crop_from_hand` and the index of the preshape.
///
/// The middle is the mean of the occupied voxels, weighted by a normal distribution around that point, in plan view; without any the distance is 0.
#[must_use]
pub fn levers(hand: &HandGrid, grid: &VoxelFrame, occupancy: &[u8], grasps: &[(Isometry3<f64>, usize)]) -> Vec<f64> {
    let columns = columns(grid, occupancy);
    let lever = |(pose, preshape): &(Isometry3<f64>, usize)| {
        let tip = (pose * hand.fingertips(*preshape)).xy().coords;
        distance_to_middle(&columns, &tip)
    };
    grasps.par_iter().map(lever).collect()
}

/// The occupied voxels over one another.
struct Column {
    center: Vector2<f64>,
    voxels: f64,
}

/// The columns that are not empty.
fn columns(grid: &VoxelFrame, occupancy: &[u8]) -> Vec<Column> {
    let n = grid.resolution();
    let column = |(line, values): (usize, &[u8])| {
        let voxels = values.iter().filter(|value| **value >= OCCUPIED).count();
        (voxels > 0).then(|| Column { center: grid.center([line / n, line % n, 0]).xy().coords, voxels: voxels as f64 })
    };
    occupancy.chunks_exact(n).enumerate().filter_map(column).collect()
}

fn distance_to_middle(columns: &[Column], tip: &Vector2<f64>) -> f64 {
    let square = |column: &Column| (column.center - tip).norm_squared();
    // The largest weight is 1, so that their sum is at least that of one voxel.
    let nearest = columns.iter().map(square).fold(f64::INFINITY, f64::min);
    let mut middle = Vector2::zeros();
    let mut total = 0.0;
    for column in columns {
        let weight = column.voxels * (0.5 * (nearest - square(column)) / NEARBY.powi(2)).exp();
        middle += weight * (column.center - tip);
        total += weight;
    }
    if total > 0.0 { middle.norm() / total } else { 0.0 }
}
