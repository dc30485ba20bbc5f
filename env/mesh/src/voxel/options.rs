//! Which voxels are set, and how inside was decided.

use super::grid::check_resolution;
use crate::error::{MeshError, require};
use std::str::FromStr;

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

/// Rule that decided which voxels are inside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FillRule {
    /// The mesh is closed and oriented: it winds around its inside.
    Winding,
    /// The mesh is closed, but neighbours disagree about a side: the inside is an odd number of crossings away.
    Parity,
    /// The mesh has holes: a place is inside if at least four of the six rays along the axes find the mesh winding around it.
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

/// Kind of voxels that [`voxelize`](crate::voxelize) makes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VoxelOptions {
    /// Voxels along each side of the grid before it is halved, 1 to 1024.
    pub resolution: usize,
    /// Which voxels are set.
    pub mode: VoxelMode,
    /// Number of halvings of the resolution, which must stay whole.
    pub down: u32,
    /// Clear the voxels whose six neighbours are set. Space beyond the grid counts as empty.
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
    pub(super) fn check(&self) -> Result<(), MeshError> {
        check_resolution(self.resolution)?;
        let whole = self.resolution.trailing_zeros() >= self.down;
        let rule = "the resolution cannot be halved that often; choose a resolution that two divides often enough";
        require(whole, "down", f64::from(self.down), rule)
    }
}
