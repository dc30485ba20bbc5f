//! Blocks of voxels that are entirely in front of the visible surfaces, behind them, or outside the image.
//!
//! A box in the camera's frame bounds the centres of a block, a rectangle of pixels bounds that box, and the extrema of the tiles that it overlaps
//! bound the depths in the rectangle. If these bounds decide nothing, the block is classified voxel by voxel.

use crate::Camera;
use graspbox_mesh::VoxelFrame;
use nalgebra::{Isometry3, Vector3};
use std::ops::Range;

/// Voxels along each side of a block.
pub(super) const BLOCK: usize = 4;

/// Tiles along the longer side of an image: about as many as there are blocks across it.
const TILES: usize = 16;

/// Margin of the bounds for rounding, metres and pixels.
const ROUNDING: f64 = 1e-9;

/// Relation of a view to the centres of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Visibility {
    /// All are behind a surface, or outside the image or its range.
    None,
    /// All are in front of the visible surfaces.
    Through,
    /// They differ, or the bounds are too wide.
    Mixed,
}

/// Bounds of some centres in the camera's frame, metres.
pub(super) struct Bounds {
    low: Vector3<f64>,
    high: Vector3<f64>,
}

/// The centres of the voxels in the camera's frame, metres.
pub(super) struct Centers {
    origin: Vector3<f64>,
    /// Vector from a centre to the next along each axis of the grid.
    pub steps: [Vector3<f64>; 3],
    /// Half the side of a voxel.
    pub half: f64,
}

impl Centers {
    pub fn new(grid: &VoxelFrame, camera_from_grid: &Isometry3<f64>) -> Self {
        let turn = camera_from_grid.rotation.to_rotation_matrix();
        let steps = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| turn * axis * grid.voxel_size());
        Self { origin: (camera_from_grid * grid.center([0; 3])).coords, steps, half: 0.5 * grid.voxel_size() }
    }

    /// Centre of voxel (i, j, k).
    #[inline]
    pub fn at(&self, i: usize, j: usize, k: usize) -> Vector3<f64> {
        self.origin + self.steps[0] * i as f64 + self.steps[1] * j as f64 + self.steps[2] * k as f64
    }

    /// Bounds of the centres of a block.
    #[inline]
    pub fn bounds(&self, block: [&Range<usize>; 3]) -> Bounds {
        let (mut middle, mut reach) = (self.origin, Vector3::repeat(ROUNDING));
        for (range, step) in block.into_iter().zip(&self.steps) {
            let last = (range.end - 1) as f64;
            middle += step * (0.5 * (range.start as f64 + last));
            reach += step.abs() * (0.5 * (last - range.start as f64));
        }
        Bounds { low: middle - reach, high: middle + reach }
    }
}

/// Least and greatest depth of each tile of an image.
pub(super) struct Tiles<'a> {
    camera: &'a Camera,
    /// Pixels along each side of a tile.
    side: usize,
    columns: usize,
    depths: Vec<[f32; 2]>,
}

impl<'a> Tiles<'a> {
    /// * `depth`: (H, W), metres; 0 where nothing was measured.
    pub fn new(camera: &'a Camera, depth: &[f32], nothing_is_free: bool) -> Self {
        let lens = camera.intrinsics();
        let (width, height) = (lens.width as usize, lens.height as usize);
        let side = width.max(height).div_ceil(TILES);
        let columns = width.div_ceil(side);
        let mut depths = vec![[f32::INFINITY, f32::NEG_INFINITY]; columns * height.div_ceil(side)];
        // An empty pixel is free at any depth, or is ignored.
        let [least, most] = if nothing_is_free { [f32::INFINITY; 2] } else { [0.0, f32::NEG_INFINITY] };
        for (v, row) in depth.chunks_exact(width).enumerate() {
            let tiles = &mut depths[v / side * columns..];
            for (pixels, tile) in row.chunks(side).zip(tiles) {
                for &d in pixels {
                    let (low, high) = if d == 0.0 { (least, most) } else { (d, d) };
                    tile[0] = if low < tile[0] { low } else { tile[0] };
                    tile[1] = if high > tile[1] { high } else { tile[1] };
                }
            }
        }
        Self { camera, side, columns, depths }
    }

    /// Relation of the view to centres within `bounds`, for surfaces `half` metres thick on both sides of their depth.
    pub fn sight(&self, bounds: &Bounds, half: f64) -> Visibility {
        let (near, far) = (self.camera.near(), self.camera.far());
        let [back, front] = [bounds.low.z, bounds.high.z];
        if front < near || back > far {
            return Visibility::None;
        }
        if back < near || front > far {
            return Visibility::Mixed;
        }
        let lens = self.camera.intrinsics();
        let columns = pixels([bounds.low.x, bounds.high.x], [back, front], lens.fx, lens.cx);
        let rows = pixels([bounds.low.y, bounds.high.y], [back, front], lens.fy, lens.cy);
        let (width, height) = (f64::from(lens.width), f64::from(lens.height));
        if columns[1] < 0.0 || rows[1] < 0.0 || columns[0] >= width || rows[0] >= height {
            return Visibility::None;
        }
        let whole = columns[0] >= 0.0 && rows[0] >= 0.0 && columns[1] < width && rows[1] < height;
        let [least, most] = self.depths(self.tiles(columns, width), self.tiles(rows, height));
        if back > f64::from(most) + half {
            Visibility::None
        } else if whole && front < f64::from(least) - half {
            Visibility::Through
        } else {
            Visibility::Mixed
        }
    }

    /// Tiles between two positions along a side of the image of `size` pixels.
    #[inline]
    fn tiles(&self, [first, last]: [f64; 2], size: f64) -> Range<usize> {
        first.max(0.0) as usize / self.side..last.min(size - 1.0) as usize / self.side + 1
    }

    /// Least and greatest depth in a range of tiles.
    #[inline]
    fn depths(&self, columns: Range<usize>, rows: Range<usize>) -> [f32; 2] {
        let mut found = [f32::INFINITY, f32::NEG_INFINITY];
        for row in rows {
            for tile in &self.depths[row * self.columns..][columns.clone()] {
                found = [found[0].min(tile[0]), found[1].max(tile[1])];
            }
        }
        found
    }
}

/// Interval of image positions, along one axis, of points between `low` and `high` along that axis and between `back` and `front` along the optical
/// axis.
#[inline]
fn pixels([low, high]: [f64; 2], [back, front]: [f64; 2], focal: f64, middle: f64) -> [f64; 2] {
    let least = low / if low < 0.0 { back } else { front };
    let most = high / if high < 0.0 { front } else { back };
    [focal * least + middle - ROUNDING, focal * most + middle + ROUNDING]
}
