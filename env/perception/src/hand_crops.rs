//! Voxels around the hand at many poses: trilinear samples of the crop's voxels in the cells of a [`HandGrid`].
//!
//! Positions and shares are fixed-point numbers, and the channels of a voxel are lanes of one word, since the baseline instruction set converts bytes
//! to floats one by one. Values differ from exact interpolation by at most 2 of 255.

use crate::hand_grid::HandGrid;
use graspbox_mesh::VoxelFrame;
use nalgebra::{Isometry3, Vector3};
use rayon::prelude::*;

/// Number of channels: completed, surface, unseen, table.
pub const HAND_CHANNELS: usize = 4;
/// Their names, in order.
pub const HAND_CHANNEL_NAMES: [&str; HAND_CHANNELS] = ["completed", "surface", "unseen", "table"];
/// Number of channels from the crop; the table is known everywhere.
const READ: usize = 3;
/// Fractional bits of a position in voxels.
const POINT: u32 = 20;
/// Mask of the lanes of a word.
const LANES: u64 = 0x00FF_00FF_00FF_00FF;
/// Half of the last bit of each lane's product, for rounding.
const HALVES: u64 = 0x0080_0080_0080_0080;

/// The voxels of one crop; each channel occupies 16 bits of a word.
pub struct CropVolume {
    grid: VoxelFrame,
    cells: Vec<u64>,
}

impl CropVolume {
    /// Packs the channels `completed`, `surface` and `unseen`, each (N, N, N), 0 to 255.
    #[must_use]
    pub fn new(grid: &VoxelFrame, channels: [&[u8]; READ]) -> Self {
        let [completed, surface, unseen] = channels;
        let lanes = completed.iter().zip(surface).zip(unseen);
        let cells = lanes.map(|((a, b), c)| u64::from(*a) | u64::from(*b) << 16 | u64::from(*c) << 32).collect();
        Self { grid: *grid, cells }
    }
}

/// The channels (m, 4, X, Y, Z) around the hand at m poses, 0 to 255 for 0 to 1.
///
/// * `volumes`: the crops.
/// * `poses`: for each hand pose, the index of its crop and the pose in the crop frame.
///
/// The first three channels are 0 for cells outside the crop. The last is the share of a cell below the table z = 0.
#[must_use]
pub fn hand_crops(hand: &HandGrid, volumes: &[CropVolume], poses: &[(usize, Isometry3<f64>)]) -> Vec<u8> {
    let size = HAND_CHANNELS * hand.cells.len();
    let mut out = vec![0; size * poses.len()];
    let rows = out.par_chunks_mut(size).zip(poses);
    rows.for_each(|(out, (crop, pose))| sample(hand, &volumes[*crop], pose, out));
    out
}

fn sample(hand: &HandGrid, volume: &CropVolume, crop_from_hand: &Isometry3<f64>, out: &mut [u8]) {
    let cells = &hand.cells;
    let n = volume.grid.resolution();
    let per_voxel = 1.0 / volume.grid.voxel_size();
    let [nx, ny, nz] = cells.shape;
    let (completed, rest) = out.split_at_mut(cells.len());
    let (surface, rest) = rest.split_at_mut(cells.len());
    let (unseen, table) = rest.split_at_mut(cells.len());
    let step = crop_from_hand.rotation * Vector3::z() * cells.cell;
    let in_voxels = fixed(step * per_voxel);
    let rise = (step.z / cells.cell * 255.0) as f32;
    for line in 0..nx * ny {
        let first = crop_from_hand * cells.center([line / ny, line % ny, 0]);
        let below = ((0.5 - first.z / cells.cell) * 255.0 + 0.5) as f32;
        let start = fixed(((first - volume.grid.origin()) * per_voxel).add_scalar(-0.5));
        let column = line * nz..(line + 1) * nz;
        for (k, table) in table[column.clone()].iter_mut().enumerate() {
            *table = (below - rise * k as f32) as u8;
        }
        let read = completed[column.clone()].iter_mut().zip(&mut surface[column.clone()]).zip(&mut unseen[column]);
        let mut at = start;
        for ((completed, surface), unseen) in read {
            let value = trilinear(&volume.cells, n, at);
            *completed = value as u8;
            *surface = (value >> 16) as u8;
            *unseen = (value >> 32) as u8;
            at = [at[0] + in_voxels[0], at[1] + in_voxels[1], at[2] + in_voxels[2]];
        }
    }
}

/// Fixed-point numbers, which suffice for poses a few hundred crops away.
fn fixed(v: Vector3<f64>) -> [i64; 3] {
    [v.x, v.y, v.z].map(|x| (x * f64::from(1 << POINT)).round() as i64)
}

/// Interpolates the lanes of the eight voxels around a point, in voxels from the centre of the first one; 0 outside.
#[inline]
fn trilinear(cells: &[u64], n: usize, at: [i64; 3]) -> u64 {
    let [i, j, k] = at.map(|x| x >> POINT);
    let last = n as u64 - 1;
    // As unsigned numbers, negative ones are large.
    if i as u64 >= last || j as u64 >= last || k as u64 >= last {
        return 0;
    }
    let [x, y, z] = at.map(|x| (x >> (POINT - 8)) as u64 & 0xFF);
    let base = (i as usize * n + j as usize) * n + k as usize;
    let mix = |a: u64, b: u64, share: u64| ((a * (256 - share) + b * share + HALVES) >> 8) & LANES;
    let pair = |start: usize| mix(cells[start], cells[start + 1], z);
    let near = mix(pair(base), pair(base + n), y);
    let far = mix(pair(base + n * n), pair(base + n * n + n), y);
    mix(near, far, x)
}
