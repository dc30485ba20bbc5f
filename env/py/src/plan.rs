//! Box trees and plans as arrays.

use crate::convert::{Floats, array, isometry, matrices, matrix, read_config, row_major, table};
use crate::errors::CoreError;
use crate::gil::detached;
use crate::hand::Hand;
use crate::mesh::{Mesh, MeshData};
use graspbox_mesh::default_pose;
use graspbox_plan::{
    BoxNode, BoxTree, Candidate, DecomposeParams, Neighbour, Obstacle, Plan, PlanObject, PlanParams, decompose as cut,
    plan as plan_grasps, rank_features, rank_weights as weights_of,
};
use nalgebra::{Isometry3, Vector3};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Decomposes a mesh into boxes. Arrays by name, one row per node of the tree, depth first.
#[pyfunction]
pub fn decompose<'py>(py: Python<'py>, mesh: &Mesh, params: &Bound<'_, PyAny>) -> PyResult<Bound<'py, PyDict>> {
    let params: DecomposeParams = read_config(params, "DecomposeConfig")?;
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
    dict.set_item("axes", array(py, boxes().flat_map(|b| row_major(&b.axes)).collect(), &[n, 3, 3])?)?;
    dict.set_item("half_extents", table(py, boxes().map(|b| <[f64; 3]>::from(b.half_extents)))?)?;
    dict.set_item("children", table(py, tree.nodes.iter().map(children))?)?;
    dict.set_item("depth", array(py, tree.nodes.iter().map(|node| node.depth as i64).collect(), &[n])?)?;
    Ok(dict)
}

/// Obstacles around an object or an arm.
pub struct Obstacles {
    objects: Vec<(Arc<MeshData>, Isometry3<f64>)>,
    walls: Vec<(Isometry3<f64>, Vector3<f64>)>,
}

impl Obstacles {
    pub fn new(objects: &[(PyRef<'_, Mesh>, Floats<'_>)], walls: &[(Floats<'_>, [f64; 3])]) -> Result<Self, CoreError> {
        let objects = objects.iter().map(|(mesh, pose)| Ok((Arc::clone(&mesh.0), isometry(pose, "neighbours")?)));
        let walls = walls.iter().map(|(pose, half)| Ok((isometry(pose, "walls")?, Vector3::from(*half))));
        Ok(Self {
            objects: objects.collect::<Result<_, CoreError>>()?,
            walls: walls.collect::<Result<_, CoreError>>()?,
        })
    }

    fn is_empty(&self) -> bool {
        self.objects.is_empty() && self.walls.is_empty()
    }

    fn neighbours(&self, cache: Option<&Path>) -> Result<Arc<[Neighbour]>, CoreError> {
        Ok(self.named(cache)?.into_iter().map(|(_, neighbour)| neighbour).collect())
    }

    /// The obstacles, with their names.
    pub fn named(&self, cache: Option<&Path>) -> Result<Vec<(String, Neighbour)>, CoreError> {
        let objects = self.objects.iter().map(|(mesh, pose)| {
            let body = mesh.body(cache)?;
            let (obstacle, mass) = (Arc::clone(body.obstacle()), Some(body.mass_properties().mass));
            Ok((body.name().to_owned(), Neighbour { obstacle, world_from_obstacle: *pose, mass }))
        });
        let walls = self.walls.iter().enumerate().map(|(index, (pose, half))| {
            let obstacle = Arc::new(Obstacle::cuboid(half)?);
            Ok((format!("wall {}", index + 1), Neighbour { obstacle, world_from_obstacle: *pose, mass: None }))
        });
        objects.chain(walls).collect()
    }
}

/// Plans grasps. `neighbours` are other objects with their poses, `walls` boxes with their half extents. Arrays by name, one row per candidate: feasible ones first, best first. With `features`, also the features of
/// the ranking (NaN for poses that are not feasible).
#[pyfunction]
#[pyo3(signature = (mesh, hand, params, world_from_object, cache, num_threads, features, neighbours, walls))]
#[allow(clippy::too_many_arguments)]
pub fn plan<'py>(
    py: Python<'py>,
    mesh: &Mesh,
    hand: &Hand,
    params: &Bound<'_, PyAny>,
    world_from_object: Option<Floats<'py>>,
    cache: Option<PathBuf>,
    #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
    features: bool,
    neighbours: Vec<(PyRef<'py, Mesh>, Floats<'py>)>,
    walls: Vec<(Floats<'py>, [f64; 3])>,
) -> PyResult<Bound<'py, PyDict>> {
    let around = Obstacles::new(&neighbours, &walls)?;
    let params: PlanParams = read_config(params, "PlanConfig")?;
    let pose = world_from_object.map(|m| isometry(&m, "world_from_object")).transpose()?;
    let (data, hand) = (Arc::clone(&mesh.0), Arc::clone(&hand.0));
    let planned_for = Arc::clone(&hand);
    let plan = detached(py, num_threads, move || {
        let body = data.body(cache.as_deref())?;
        body.check_fits(&hand)?;
        let world_from_object = pose.unwrap_or_else(|| default_pose(body.mesh()));
        if around.is_empty() && !body.rests_at(&world_from_object) {
            tracing::warn!(
                target: "graspbox",
                "object `{}` does not rest at this world_from_object, so trials will find it elsewhere; plan with \
                 `world_from_object=Scene(mesh).world_from_object`",
                body.name()
            );
        }
        let object = PlanObject {
            mesh: body.mesh(),
            obstacle: body.obstacle(),
            center_of_mass: body.mass_properties().center_of_mass,
            world_from_object,
            neighbours: around.neighbours(cache.as_deref())?,
        };
        Ok::<_, CoreError>(plan_grasps(&object, &hand, &params)?)
    })?;
    let dict = plan_arrays(py, &plan)?;
    if features {
        let terms = weights_of(&planned_for).len();
        let read = |c: &Candidate| match &c.prediction {
            Some(prediction) => rank_features(&planned_for, prediction, c.grasp.preshape),
            None => vec![f64::NAN; terms],
        };
        let rows: Vec<f64> = plan.candidates.iter().flat_map(read).collect();
        dict.set_item("features", array(py, rows, &[plan.candidates.len(), terms])?)?;
    }
    Ok(dict)
}

/// Name and weight of each term of the ranking for a hand, in the order of the features' columns.
#[pyfunction]
pub fn rank_weights(hand: &Hand) -> Vec<(String, f64)> {
    weights_of(&hand.0)
}

fn plan_arrays<'py>(py: Python<'py>, plan: &Plan) -> PyResult<Bound<'py, PyDict>> {
    let all = &plan.candidates;
    let n = &[all.len()];
    let dict = PyDict::new(py);
    dict.set_item("tree", tree_arrays(py, &plan.tree)?)?;
    dict.set_item("world_from_object", matrix(py, &plan.world_from_object)?)?;
    dict.set_item("poses", matrices(py, all.iter().map(|c| c.grasp.object_from_hand))?)?;
    dict.set_item("preshape", array(py, all.iter().map(|c| c.grasp.preshape).collect(), n)?)?;
    dict.set_item("box", array(py, all.iter().map(|c| c.box_index as i64).collect(), n)?)?;
    dict.set_item("face", array(py, all.iter().map(|c| c.face as i64).collect(), n)?)?;
    dict.set_item("score", array(py, all.iter().map(|c| c.score).collect(), n)?)?;
    dict.set_item("touch", array(py, all.iter().map(|c| c.touch.depth).collect(), n)?)?;
    dict.set_item("press", array(py, all.iter().map(|c| c.touch.press).collect(), n)?)?;
    dict.set_item("feasible", array(py, all.iter().map(|c| c.feasible()).collect::<Vec<bool>>(), n)?)?;
    Ok(dict)
}
