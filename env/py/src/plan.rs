//! Box trees: the geometry of planning as arrays.

use crate::convert::{array, config, row_major, table};
use crate::errors::CoreError;
use crate::gil::detached;
use crate::mesh::Mesh;
use graspbox_plan::{BoxNode, BoxTree, DecomposeParams, decompose as cut};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::sync::Arc;

/// Cuts a mesh into boxes; `params` is JSON. Arrays by name, one row a node of the tree, depth first.
#[pyfunction]
pub fn decompose<'py>(py: Python<'py>, mesh: &Mesh, params: &str) -> PyResult<Bound<'py, PyDict>> {
    let params: DecomposeParams = config(params, "DecomposeConfig")?;
    let data = Arc::clone(&mesh.0);
    let tree = detached(py, None, move || Ok::<_, CoreError>(cut(&data.spec.mesh, &params)?))?;
    tree_arrays(py, &tree)
}

fn tree_arrays<'py>(py: Python<'py>, tree: &BoxTree) -> PyResult<Bound<'py, PyDict>> {
    let n = tree.nodes.len();
    let boxes = || tree.nodes.iter().map(|node| &node.bounds);
    let children = |node: &BoxNode| node.cut.map_or([-1, -1], |(_, pair)| pair.map(|child| child as i64));
    let dict = PyDict::new(py);
    dict.set_item("center", table(py, boxes().map(|b| <[f64; 3]>::from(b.center.coords)))?)?;
    dict.set_item(
        "axes",
        array(py, boxes().flat_map(|b| row_major(&b.axes)).collect(), &[n, 3, 3])?,
    )?;
    dict.set_item(
        "half_extents",
        table(py, boxes().map(|b| <[f64; 3]>::from(b.half_extents)))?,
    )?;
    dict.set_item("children", table(py, tree.nodes.iter().map(children))?)?;
    dict.set_item(
        "depth",
        array(py, tree.nodes.iter().map(|node| node.depth as i64).collect(), &[n])?,
    )?;
    Ok(dict)
}
