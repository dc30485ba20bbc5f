//! Voxels of a mesh, with the meaning of binvox's options, and binvox files.
//!
//! | module | purpose |
//! |---|---|
//! | [`grid`] | the cube that is cut into voxels, and which of them are set |
//! | `options` | which voxels are set, and how inside was decided |
//! | `lines` | grid lines, and where faces cross them |
//! | `solid` | voxels whose centre lies inside, by counting crossings along grid lines |
//! | `surface` | voxels that a triangle touches |
//! | [`binvox`] | `.binvox` files |
//!
//! | binvox | here |
//! |---|---|
//! | `-d N` | [`VoxelOptions::resolution`]: N voxels along the longest side of the bounds, whose least corner is the grid's |
//! | (default) | [`VoxelMode::Solid`] |
//! | `-e` | [`VoxelMode::Surface`]; with `exact` the touched voxels are added to the solid instead |
//! | `-down` | `down`: each time a voxel is set where at least 4 of its 8 parts were |
//! | `-ri` | `remove_internal`, last of all: voxels whose six neighbours are set are cleared |

pub mod binvox;
pub mod grid;
pub(crate) mod lines;
mod options;
mod solid;
mod surface;

pub use binvox::{load_binvox, parse_binvox, write_binvox};
pub use grid::{MAX_RESOLUTION, VoxelFrame, VoxelGrid};
pub use options::{FillRule, VoxelMode, VoxelOptions};

use crate::error::MeshError;
use crate::trimesh::TriMesh;
use grid::filled;
use nalgebra::Isometry3;

/// A voxel of a halved grid is set where this many of its eight parts were: binvox's default (`-dmin`).
const MIN_PARTS: u8 = 4;

/// Voxelises a mesh.
///
/// The grid is the cube whose least corner is that of the mesh's bounds and whose side is their longest side. Centres are inside by
/// half-open rules: a centre on the surface is taken a billionth of a voxel towards (+x, +y, +z). A voxel is touched by surfaces
/// within a billionth of its size.
///
/// Returns the grid, in the mesh's frame, and, for [`VoxelMode::Solid`], how inside was decided.
///
/// # Errors
/// [`MeshError::OutOfRange`] for a resolution outside 1 to 1024; [`MeshError::BadParameter`] for one that cannot be halved so often,
/// and for a mesh that is a single point; [`MeshError::OutOfMemory`] (a grid takes 1 byte per voxel, up to 3 while it is made).
pub fn voxelize(mesh: &TriMesh, options: &VoxelOptions) -> Result<(VoxelGrid, Option<FillRule>), MeshError> {
    options.check()?;
    let frame = VoxelFrame::new(options.resolution, mesh.aabb().min, mesh.extent())?;
    let corners: Vec<[f64; 3]> = mesh.vertices().iter().map(|p| frame.to_grid(p)).collect();
    let (mut set, rule) = match options.mode {
        VoxelMode::Solid => {
            let (set, rule) = solid::fill(&corners, mesh.faces(), frame.resolution())?;
            (set, Some(rule))
        }
        VoxelMode::Surface => (filled(frame.len(), false)?, None),
    };
    if options.exact || options.mode == VoxelMode::Surface {
        surface::mark(&corners, mesh.faces(), frame.resolution(), &mut set);
    }
    let mut grid = VoxelGrid::new(frame, set)?;
    for _ in 0..options.down {
        grid = grid.halved(MIN_PARTS)?;
    }
    if options.remove_internal {
        grid.remove_internal()?;
    }
    Ok((grid, rule))
}

/// Voxels of a given cube whose centre lies inside a mesh, of which the cube may hold only a part.
///
/// * `frame_from_mesh`: where the mesh is, in the frame that the cube is given in.
///
/// # Errors
/// [`MeshError::OutOfMemory`].
pub fn voxelize_in(
    mesh: &TriMesh,
    frame_from_mesh: &Isometry3<f64>,
    frame: &VoxelFrame,
) -> Result<VoxelGrid, MeshError> {
    let corners: Vec<[f64; 3]> = mesh.vertices().iter().map(|p| frame.to_grid(&(frame_from_mesh * p))).collect();
    VoxelGrid::new(*frame, solid::fill(&corners, mesh.faces(), frame.resolution())?.0)
}
