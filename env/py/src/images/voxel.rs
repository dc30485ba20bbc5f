//! Voxels of a mesh, and binvox files.

use crate::convert::{Array, Floats, array, cube, point};
use crate::errors::CoreError;
use crate::gil::detached;
use crate::mesh::Mesh;
use graspbox_mesh::{VoxelFrame, VoxelGrid, VoxelOptions};
use numpy::PyReadonlyArrayDyn;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// Flags (n, n, n), least corner (3,) and side of a voxel.
type Arrays<'py> = (Array<'py, bool>, Array<'py, f64>, f64);

fn arrays(py: Python<'_>, grid: VoxelGrid) -> PyResult<Arrays<'_>> {
    let frame = *grid.frame();
    let n = frame.resolution();
    let origin = frame.origin();
    Ok((
        array(py, grid.into_flags(), &[n, n, n])?,
        array(py, vec![origin.x, origin.y, origin.z], &[3])?,
        frame.voxel_size(),
    ))
}

/// Voxelizes a mesh. Also returns the method that separated inside from outside, for a solid.
#[pyfunction]
pub fn voxelize<'py>(
    py: Python<'py>,
    mesh: &Mesh,
    resolution: usize,
    mode: &str,
    down: u32,
    remove_internal: bool,
    exact: bool,
) -> PyResult<(Arrays<'py>, Option<&'static str>)> {
    let options =
        VoxelOptions { resolution, mode: mode.parse().map_err(CoreError::from)?, down, remove_internal, exact };
    let data = Arc::clone(&mesh.0);
    let (grid, rule) = detached(py, None, move || graspbox_mesh::voxelize(&data.spec.mesh, &options))?;
    Ok((arrays(py, grid)?, rule.map(graspbox_mesh::FillRule::name)))
}

/// Reads a `.binvox` file.
#[pyfunction]
pub fn load_binvox(py: Python<'_>, path: PathBuf) -> PyResult<Arrays<'_>> {
    let grid = detached(py, None, move || {
        graspbox_mesh::load_binvox(&path).map_err(|error| CoreError::in_file(error, &path))
    })?;
    arrays(py, grid)
}

/// Writes a `.binvox` file.
#[pyfunction]
pub fn save_binvox(
    py: Python<'_>,
    path: PathBuf,
    occupancy: PyReadonlyArrayDyn<'_, bool>,
    origin: Floats<'_>,
    voxel_size: f64,
) -> PyResult<()> {
    let (n, flags) = cube(&occupancy, "occupancy")?;
    let origin = point(&origin, "origin")?;
    detached(py, None, move || {
        let frame = VoxelFrame::new(n, origin, voxel_size * n as f64)?;
        graspbox_mesh::write_binvox(&path, &VoxelGrid::new(frame, flags)?)
    })
}
