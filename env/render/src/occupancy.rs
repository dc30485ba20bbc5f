//! Fusion of depth images into voxels: occupied, free or unseen.
//!
//! Each voxel is classified by its centre and, in each view, the pixel to which the centre projects. With z the depth of the centre, d the depth at
//! that pixel and h the side of a voxel, it is
//!
//! 1. occupied, if in some view `|z - d| <= h / 2`, or the point of some pixel is in the voxel;
//! 2. else free, if in some view `z < d - h / 2`, or the pixel is empty up to the far clipping depth;
//! 3. else unseen: behind a surface, or outside every image or its depth range.
//!
//! Occupied takes precedence over free, because a view at a grazing angle has long rays through the voxels of a surface. Details thinner
//! than a pixel may be missed, and a surface is misplaced by as much as its depth changes within half a pixel.
//!
//! Most voxels are far in front of the visible surfaces, or far behind them: `blocks` classifies many of them at once.

mod blocks;

use crate::error::RenderError;
use crate::{Camera, Frame};
use blocks::{BLOCK, Centers, Tiles, Visibility};
use graspbox_mesh::{VoxelFrame, in_range};
use nalgebra::{Isometry3, Vector3};

/// State of a voxel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum Occupancy {
    /// No view covers it.
    #[default]
    Unseen = 0,
    /// A view passes through it.
    Free = 1,
    /// A view sees a surface in it.
    Occupied = 2,
}

/// A depth image and the camera that took it.
#[derive(Clone, Copy, Debug)]
pub struct DepthView<'a> {
    /// Intrinsics, pose and depth range.
    pub camera: Camera,
    /// (H, W): metres along the optical axis; 0 where nothing was measured.
    pub depth: &'a [f32],
}

impl<'a> DepthView<'a> {
    /// The depth image of `frame`; `None` for a frame without an image.
    #[must_use]
    pub fn of(frame: &'a Frame) -> Option<Self> {
        let camera = *frame.camera()?;
        Some(Self { camera, depth: &frame.depth })
    }

    fn check(&self) -> Result<(), RenderError> {
        let pixels = self.camera.intrinsics().pixels() as f64;
        let have = self.depth.len() as f64;
        in_range("length of a depth image", have, pixels..=pixels, "(rows times columns of its camera)")?;
        let unit = "m (0 where nothing was measured)";
        Ok(self.depth.iter().try_for_each(|&d| in_range("depth", f64::from(d), 0.0..=1e4, unit))?)
    }
}

/// Fuses `views` into the voxels of `grid`; states in the order of [`VoxelFrame::index`].
///
/// * `world_from_grid`: pose of the grid's frame (the object's, the hand's or the world's).
/// * `nothing_is_free`: whether a pixel without depth means free space up to the far clipping depth, as in rendered images; otherwise the
///   pixel is ignored, as for a sensor with missing pixels.
///
/// # Errors
/// [`RenderError::OutOfRange`] for an image of another size than its camera's, and for depths that are negative or not finite.
pub fn occupancy(
    grid: &VoxelFrame,
    world_from_grid: &Isometry3<f64>,
    views: &[DepthView],
    nothing_is_free: bool,
) -> Result<Vec<Occupancy>, RenderError> {
    let mut cells = Vec::new();
    occupancy_into(grid, world_from_grid, views, nothing_is_free, &mut cells)?;
    Ok(cells)
}

/// As [`occupancy`], into `cells`, whose memory is reused.
///
/// # Errors
/// Those of [`occupancy`].
pub fn occupancy_into(
    grid: &VoxelFrame,
    world_from_grid: &Isometry3<f64>,
    views: &[DepthView],
    nothing_is_free: bool,
    cells: &mut Vec<Occupancy>,
) -> Result<(), RenderError> {
    views.iter().try_for_each(DepthView::check)?;
    cells.clear();
    cells.resize(grid.len(), Occupancy::Unseen);
    for view in views {
        let camera_from_grid = view.camera.world_from_camera().inv_mul(world_from_grid);
        mark_points(grid, &camera_from_grid.inverse(), view, cells);
        judge_centers(grid, &camera_from_grid, view, nothing_is_free, cells);
    }
    Ok(())
}

/// Marks the voxels that contain the point of a pixel.
fn mark_points(grid: &VoxelFrame, grid_from_camera: &Isometry3<f64>, view: &DepthView, cells: &mut [Occupancy]) {
    let lens = view.camera.intrinsics();
    // A pixel's point in voxels from the least corner: `corner + depth * ray`.
    let per_metre = 1.0 / grid.voxel_size();
    let turn = grid_from_camera.rotation.to_rotation_matrix().into_inner() * per_metre;
    let corner = (grid_from_camera.translation.vector - grid.origin().coords) * per_metre;
    let n = grid.resolution();
    let most = n as f64;
    let inside = |x: f64| (0.0..most).contains(&x);
    let across = turn * Vector3::x() / lens.fx;
    for (v, row) in view.depth.chunks_exact(lens.width as usize).enumerate() {
        let at = |u: f64| turn * Vector3::new((u - lens.cx) / lens.fx, (v as f64 + 0.5 - lens.cy) / lens.fy, 1.0);
        let first = at(0.5);
        for (u, &d) in row.iter().enumerate().filter(|(_, d)| **d > 0.0) {
            let p = corner + (first + across * u as f64) * f64::from(d);
            if inside(p.x) && inside(p.y) && inside(p.z) {
                // Over i32, which converts in one instruction.
                let [i, j, k] = [p.x, p.y, p.z].map(|x| x as i32 as usize);
                cells[(i * n + j) * n + k] = Occupancy::Occupied;
            }
        }
    }
}

/// Compares the depth of each centre with that of its pixel.
fn judge_centers(
    grid: &VoxelFrame,
    camera_from_grid: &Isometry3<f64>,
    view: &DepthView,
    nothing_is_free: bool,
    cells: &mut [Occupancy],
) {
    let centers = Centers::new(grid, camera_from_grid);
    let tiles = Tiles::new(&view.camera, view.depth, nothing_is_free);
    let n = grid.resolution();
    let ends = |first: usize| first..(first + BLOCK).min(n);
    for i in (0..n).step_by(BLOCK).map(ends) {
        for j in (0..n).step_by(BLOCK).map(ends) {
            for k in (0..n).step_by(BLOCK).map(ends) {
                let sight = tiles.sight(&centers.bounds([&i, &j, &k]), centers.half);
                if sight == Visibility::None {
                    continue;
                }
                for (i, j) in i.clone().flat_map(|i| j.clone().map(move |j| (i, j))) {
                    let row = &mut cells[(i * n + j) * n..][k.clone()];
                    if sight == Visibility::Through {
                        row.iter_mut().filter(|c| **c != Occupancy::Occupied).for_each(|c| *c = Occupancy::Free);
                    } else {
                        let first = centers.at(i, j, k.start);
                        judge_row(first, centers.steps[2], centers.half, view, nothing_is_free, row);
                    }
                }
            }
        }
    }
}

/// Classifies the centres `first`, `first + step` and so on, camera's frame.
fn judge_row(
    first: Vector3<f64>,
    step: Vector3<f64>,
    half: f64,
    view: &DepthView,
    nothing_is_free: bool,
    cells: &mut [Occupancy],
) {
    let lens = view.camera.intrinsics();
    let range = view.camera.near()..=view.camera.far();
    let (width, height) = (f64::from(lens.width), f64::from(lens.height));
    let focal = Vector3::new(lens.fx, lens.fy, 1.0);
    let (first, step) = (first.component_mul(&focal), step.component_mul(&focal));
    for (k, cell) in cells.iter_mut().enumerate() {
        let p = first + step * k as f64;
        if *cell == Occupancy::Occupied || !range.contains(&p.z) {
            continue;
        }
        let nearness = 1.0 / p.z;
        let (u, v) = (p.x * nearness + lens.cx, p.y * nearness + lens.cy);
        if !(u >= 0.0 && v >= 0.0 && u < width && v < height) {
            continue;
        }
        let d = f64::from(view.depth[v as i32 as usize * lens.width as usize + u as i32 as usize]);
        if d == 0.0 {
            if nothing_is_free {
                *cell = Occupancy::Free;
            }
        } else if (p.z - d).abs() <= half {
            *cell = Occupancy::Occupied;
        } else if p.z < d {
            *cell = Occupancy::Free;
        }
    }
}
