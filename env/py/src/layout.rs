//! Several objects at rest on the table: packed, in a pile, in a bin.

use crate::convert::{Floats, array, isometry, matrices, read_config, table};
use crate::errors::CoreError;
use crate::gil::detached;
use crate::hand::Hand;
use crate::mesh::Mesh;
use graspbox_episode::{Body, Draw, Layout};
use graspbox_sim::{PhysicsConfig, Wall};
use nalgebra::{Isometry3, Vector3};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::Arc;

/// Lets the meshes come to rest in a layout. Indices of those that stayed (k,), their poses (k, 4, 4), and poses (w, 4, 4) and half extents (w, 3)
/// of the walls; `most` and `spread` as of [`Draw`].
#[pyfunction]
#[pyo3(signature = (meshes, most, spread, hand, layout, physics, seed, cache))]
#[expect(clippy::too_many_arguments, reason = "every setting crosses by itself")]
pub fn arrange<'py>(
    py: Python<'py>,
    meshes: Vec<PyRef<'py, Mesh>>,
    most: Option<usize>,
    spread: f64,
    hand: &Hand,
    layout: &Bound<'_, PyAny>,
    physics: &Bound<'_, PyAny>,
    seed: i128,
    cache: Option<PathBuf>,
) -> PyResult<Bound<'py, PyDict>> {
    let layout: Layout = read_config(layout, "layout")?;
    let physics: PhysicsConfig = read_config(physics, "PhysicsConfig")?;
    let draw = Draw { most, spread, seed: crate::convert::seed(seed)? };
    let (data, hand): (Vec<_>, _) = (meshes.iter().map(|mesh| Arc::clone(&mesh.0)).collect(), Arc::clone(&hand.0));
    let found = detached(py, None, move || {
        let bodies = data.iter().map(|mesh| mesh.body(cache.as_deref())).collect::<Result<Vec<_>, _>>()?;
        let bodies: Vec<&Body> = bodies.iter().map(|body| &**body).collect();
        Ok::<_, crate::errors::CoreError>(layout.arrange(&bodies, &draw, &hand, physics, cache.as_deref())?)
    })?;
    let dict = PyDict::new(py);
    let objects: Vec<i64> = found.objects.iter().map(|index| *index as i64).collect();
    let count = objects.len();
    dict.set_item("objects", array(py, objects, &[count])?)?;
    put_poses(py, &dict, found.world_from_objects.into_iter(), &found.walls)?;
    Ok(dict)
}

/// The walls of a bin: poses (4, 4, 4) and half extents (4, 3), metres; `inside`: sides of its floor along x and y, and height of its walls.
#[pyfunction]
pub fn bin_walls(py: Python<'_>, inside: [f64; 3]) -> PyResult<Bound<'_, PyDict>> {
    let walls = Layout::Bin { inside }.walls().map_err(CoreError::from)?;
    let dict = PyDict::new(py);
    put_walls(py, &dict, &walls)?;
    Ok(dict)
}

/// Walls from their poses (4, 4) and half extents, metres.
///
/// # Errors
/// A pose of another shape, or that is no rigid motion.
pub fn walls(boxes: &[(Floats<'_>, [f64; 3])]) -> Result<Vec<Wall>, CoreError> {
    let wall = |(pose, half): &(Floats<'_>, [f64; 3])| {
        Ok(Wall { world_from_wall: isometry(pose, "walls")?, half: Vector3::from(*half) })
    };
    boxes.iter().map(wall).collect()
}

/// Adds poses of objects (k, 4, 4), and poses (w, 4, 4) and half extents (w, 3) of walls.
pub(crate) fn put_poses<'py>(
    py: Python<'py>,
    dict: &Bound<'py, PyDict>,
    world_from_objects: impl ExactSizeIterator<Item = Isometry3<f64>>,
    walls: &[Wall],
) -> PyResult<()> {
    dict.set_item("world_from_objects", matrices(py, world_from_objects)?)?;
    put_walls(py, dict, walls)
}

/// Adds poses (w, 4, 4) and half extents (w, 3) of walls.
fn put_walls<'py>(py: Python<'py>, dict: &Bound<'py, PyDict>, walls: &[Wall]) -> PyResult<()> {
    dict.set_item("world_from_walls", matrices(py, walls.iter().map(|wall| wall.world_from_wall))?)?;
    dict.set_item("wall_half_extents", table(py, walls.iter().map(|wall| [wall.half.x, wall.half.y, wall.half.z]))?)
}
