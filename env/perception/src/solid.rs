//! The true occupancy of a crop: the target of a completion network.

use crate::PerceptionError;
use graspbox_mesh::{TriMesh, VoxelFrame, voxelize_in};
use nalgebra::Isometry3;

/// Sub-voxels along each side of a voxel.
const PARTS: usize = 2;

/// Share of each voxel that an object fills, (N, N, N), 0 to 255 for 0 to 1, counted in sub-voxels of half the side.
///
/// * `crop_from_object`: pose of the object in the frame of the grid.
///
/// # Errors
/// [`PerceptionError::Mesh`] if the grid does not fit into memory.
pub fn solid(mesh: &TriMesh, crop_from_object: &Isometry3<f64>, grid: &VoxelFrame) -> Result<Vec<u8>, PerceptionError> {
    let n = grid.resolution();
    let fine = VoxelFrame::new(n * PARTS, grid.origin(), grid.side())?;
    let flags = voxelize_in(mesh, crop_from_object, &fine)?.into_flags();
    let mut counts = vec![0_u16; grid.len()];
    for (line, flags) in flags.chunks_exact(n * PARTS).enumerate() {
        let (i, j) = (line / (n * PARTS) / PARTS, line % (n * PARTS) / PARTS);
        let start = grid.index([i, j, 0]);
        for (count, parts) in counts[start..start + n].iter_mut().zip(flags.chunks_exact(PARTS)) {
            *count += parts.iter().map(|set| u16::from(*set)).sum::<u16>();
        }
    }
    let whole = PARTS.pow(3) as u16;
    Ok(counts.into_iter().map(|count| ((count * 255 + whole / 2) / whole) as u8).collect())
}
