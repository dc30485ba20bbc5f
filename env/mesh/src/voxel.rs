//! Voxels of a mesh, with the meaning of binvox's options, and binvox files.
//!
//! | module | what it does |
//! |---|---|
//! | [`grid`] | the cube that is cut into voxels, and which of them are set |
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
mod solid;
mod surface;

pub use binvox::{load_binvox, parse_binvox, write_binvox};
pub use grid::{VoxelFrame, VoxelGrid};

use crate::{MeshError, TriMesh};
use std::str::FromStr;

/// Most voxels along a side: binvox's own limit; a grid of it takes 1 GiB.
pub const MAX_RESOLUTION: usize = 1024;
/// A voxel of a halved grid is set where this many of its eight parts were: binvox's default (`-dmin`).
const MIN_PARTS: u8 = 4;

/// Which voxels are set.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VoxelMode {
    /// Those whose centre lies inside.
    Solid,
    /// Those that a triangle touches.
    Surface,
}

impl VoxelMode {
    /// Its name: `solid` or `surface`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Solid => "solid",
            Self::Surface => "surface",
        }
    }
}

impl FromStr for VoxelMode {
    type Err = MeshError;

    fn from_str(name: &str) -> Result<Self, MeshError> {
        [Self::Solid, Self::Surface]
            .into_iter()
            .find(|mode| mode.name() == name)
            .ok_or_else(|| MeshError::UnknownMode { name: name.into() })
    }
}

/// How inside was told from outside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FillRule {
    /// The mesh is closed and oriented: inside is what it winds around.
    Winding,
    /// The mesh is closed, but neighbours disagree about a side: inside is what an odd number of crossings leads to.
    Parity,
    /// The mesh has holes: inside is what at least four of the six rays along the axes find it winding around.
    Vote,
}

impl FillRule {
    /// Its name: `winding`, `parity` or `vote`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Winding => "winding",
            Self::Parity => "parity",
            Self::Vote => "vote",
        }
    }
}

/// What [`voxelize`] makes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VoxelOptions {
    /// Voxels along each side of the grid before it is halved, 1 to 1024.
    pub resolution: usize,
    /// Which voxels are set.
    pub mode: VoxelMode,
    /// How often the resolution is halved; it must stay whole.
    pub down: u32,
    /// Clear the voxels whose six neighbours are set. What lies beyond the grid counts as empty.
    pub remove_internal: bool,
    /// Set every voxel that a triangle touches as well; in [`VoxelMode::Surface`] they are all there is.
    pub exact: bool,
}

impl Default for VoxelOptions {
    /// A solid of 32 voxels a side, and nothing else done to it.
    fn default() -> Self {
        Self { resolution: 32, mode: VoxelMode::Solid, down: 0, remove_internal: false, exact: false }
    }
}

impl VoxelOptions {
    fn check(&self) -> Result<(), MeshError> {
        if !(1..=MAX_RESOLUTION).contains(&self.resolution) {
            return Err(MeshError::BadParameter {
                name: "resolution",
                value: self.resolution as f64,
                rule: "give 1 to 1024 voxels a side",
            });
        }
        if self.resolution.trailing_zeros() < self.down {
            return Err(MeshError::BadParameter {
                name: "down",
                value: f64::from(self.down),
                rule: "the resolution cannot be halved that often; choose a resolution that two divides often enough",
            });
        }
        Ok(())
    }
}

/// Voxelises a mesh.
///
/// The grid is the cube whose least corner is that of the mesh's bounds and whose side is their longest side. Centres are inside by
/// half-open rules: a centre on the surface is taken a billionth of a voxel towards (+x, +y, +z). A voxel is touched by what comes
/// within a billionth of its size.
///
/// Returns the grid, in the mesh's frame, and, for [`VoxelMode::Solid`], how inside was told from outside.
///
/// # Errors
/// [`MeshError::BadParameter`] for a resolution outside 1 to 1024 or one that cannot be halved so often, and for a mesh that is a
/// single point.
pub fn voxelize(mesh: &TriMesh, options: &VoxelOptions) -> Result<(VoxelGrid, Option<FillRule>), MeshError> {
    options.check()?;
    let frame = VoxelFrame::new(options.resolution, mesh.aabb().min, mesh.extent())?;
    let corners: Vec<[f64; 3]> = mesh.vertices().iter().map(|p| frame.to_grid(p)).collect();
    let (mut set, rule) = match options.mode {
        VoxelMode::Solid => {
            let (set, rule) = solid::fill(&corners, mesh.faces(), frame.resolution());
            (set, Some(rule))
        }
        VoxelMode::Surface => (vec![false; frame.len()], None),
    };
    if options.exact || options.mode == VoxelMode::Surface {
        surface::mark(&corners, mesh.faces(), frame.resolution(), &mut set);
    }
    let mut grid = VoxelGrid::new(frame, set)?;
    for _ in 0..options.down {
        grid = grid.halved(MIN_PARTS)?;
    }
    if options.remove_internal {
        grid.remove_internal();
    }
    Ok((grid, rule))
}
