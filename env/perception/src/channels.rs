//! Voxel channels of the crop, from one depth image.
//!
//! Values of 0 to 255 stand for 0 to 1; fractions encode the position of a surface within a voxel. With z the depth of a voxel's centre, d the
//! measured depth of the pixel to which it projects and h the side of a voxel:
//!
//! | channel | value |
//! |---|---|
//! | surface | `1 - abs(z - d) / h`, at least 1/2 if the voxel contains a point of the object; from pixels of the object only |
//! | unseen | `(z - d) / h + 1/2`: the share behind the visible surface; 1 outside the image and for pixels without depth |
//! | table | the share below the table |
//!
//! Free space is neither unseen nor below the table.

use crate::crop::Observed;
use graspbox_mesh::VoxelFrame;
use graspbox_render::Camera;
use nalgebra::{Isometry3, Vector3};

pub const CHANNELS: usize = 3;
/// Their names, in order.
pub const CHANNEL_NAMES: [&str; CHANNELS] = ["surface", "unseen", "table"];
/// Least value of a voxel that contains a point of the object.
const TOUCHED: u8 = 128;

/// Fills the channels (3, N, N, N) of one crop.
///
/// * `depth`: (H, W) of the camera's image, metres along the optical axis; 0 for no depth.
pub fn fill_channels(
    grid: &VoxelFrame,
    world_from_crop: &Isometry3<f64>,
    camera: &Camera,
    depth: &[f32],
    observed: &Observed,
    out: &mut [u8],
) {
    let cells = grid.len();
    let (surface, rest) = out.split_at_mut(cells);
    let (unseen, table) = rest.split_at_mut(cells);
    let camera_from_crop = camera.world_from_camera().inv_mul(world_from_crop);
    project(grid, &camera_from_crop, camera, (depth, &observed.object), (surface, unseen));
    mark_points(grid, &camera_from_crop.inverse(), camera, depth, &observed.object, surface);
    let heights: Vec<u8> =
        (0..grid.resolution()).map(|k| share(0.5 - (grid.center([0, 0, k]).z / grid.voxel_size()) as f32)).collect();
    table.chunks_exact_mut(grid.resolution()).for_each(|column| column.copy_from_slice(&heights));
}

/// A share as a byte.
fn share(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

/// Compares the depth of each voxel's centre with that of its pixel.
fn project(
    grid: &VoxelFrame,
    camera_from_crop: &Isometry3<f64>,
    camera: &Camera,
    (depth, object): (&[f32], &[bool]),
    (surface, unseen): (&mut [u8], &mut [u8]),
) {
    let lens = camera.intrinsics();
    let (width, n) = (lens.width as usize, grid.resolution());
    let [fx, fy, cx, cy] = [lens.fx, lens.fy, lens.cx, lens.cy].map(|x| x as f32);
    let (columns, rows) = (lens.width as f32, lens.height as f32);
    let per_voxel = (1.0 / grid.voxel_size()) as f32;
    let step = (camera_from_crop.rotation * Vector3::z() * grid.voxel_size()).cast::<f32>();
    let lines = surface.chunks_exact_mut(n).zip(unseen.chunks_exact_mut(n)).enumerate();
    for (line, (surface, unseen)) in lines {
        let first = (camera_from_crop * grid.center([line / n, line % n, 0])).coords.cast::<f32>();
        for (k, (surface, unseen)) in surface.iter_mut().zip(unseen).enumerate() {
            let p = first + step * k as f32;
            let (u, v) = (fx * p.x / p.z + cx, fy * p.y / p.z + cy);
            *surface = 0;
            *unseen = 255;
            if p.z > 0.0 && u >= 0.0 && v >= 0.0 && u < columns && v < rows {
                let pixel = v as usize * width + u as usize;
                let d = depth[pixel];
                if d > 0.0 {
                    let behind = (p.z - d) * per_voxel;
                    *unseen = share(behind + 0.5);
                    if object[pixel] {
                        *surface = share(1.0 - behind.abs());
                    }
                }
            }
        }
    }
}

/// Marks the voxels that contain points of the object, even of a single pixel.
fn mark_points(
    grid: &VoxelFrame,
    crop_from_camera: &Isometry3<f64>,
    camera: &Camera,
    depth: &[f32],
    object: &[bool],
    surface: &mut [u8],
) {
    let lens = camera.intrinsics();
    let width = lens.width as usize;
    for (pixel, &z) in depth.iter().enumerate().filter(|(pixel, z)| object[*pixel] && **z > 0.0) {
        let (u, v) = ((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
        if let Some(at) = grid.voxel(&(crop_from_camera * lens.unproject(u, v, f64::from(z)))) {
            let cell = &mut surface[grid.index(at)];
            *cell = (*cell).max(TOUCHED);
        }
    }
}
