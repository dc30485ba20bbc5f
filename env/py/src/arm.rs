//! `graspbox.arms.Arm`: an arm read from its two files, its kinematics, and what it reaches.

pub mod paths;

use crate::convert::{
    Array, Floats, array, isometries, isometry, matrices, matrix, points, read_config, values, vector,
};
use crate::errors::CoreError;
use crate::gil::detached;
use crate::hand::Hand;
use crate::mesh::Mesh;
use crate::plan::Obstacles;
use graspbox_arm::chain::Positions;
use graspbox_arm::reach::Reacher;
use graspbox_arm::{ArmBodies, Inverse, Mounted, Reach, ReachParams, Reason, Scene, Solution, Touched, on_arm, reach};
use graspbox_gym::robot_arm::surface;
use graspbox_hand::arm::assets::{ARMS, arm_asset};
use graspbox_hand::{Arm as Core, Axis, HandError, Slowing};
use nalgebra::Isometry3;
use numpy::PyUntypedArrayMethods;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use rayon::prelude::*;
use std::hash::{Hash, Hasher};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

/// What an arm was made from: by the texts it is compared, by all of it pickled.
struct Source {
    /// Its URDF and its `arm.toml`.
    texts: [String; 2],
    /// Names of the two files in errors and assumptions.
    names: [String; 2],
    /// What was assumed before the URDF was made.
    assumptions: Vec<String>,
}

/// What queries need; made at the first of them.
pub(crate) struct Prepared {
    pub inverse: Inverse,
    pub bodies: ArmBodies,
}

/// A handle on an arm, with what it was made from.
#[pyclass(frozen, eq, hash, module = "graspbox._core")]
pub struct Arm {
    pub(crate) core: Arc<Core>,
    source: Arc<Source>,
    pub(crate) prepared: Arc<OnceLock<Prepared>>,
}

impl PartialEq for Arm {
    fn eq(&self, other: &Self) -> bool {
        self.source.texts == other.source.texts
    }
}

impl Eq for Arm {}

impl Hash for Arm {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.source.texts.hash(state);
    }
}

pub(crate) fn prepared<'a>(cell: &'a OnceLock<Prepared>, arm: &Core) -> &'a Prepared {
    cell.get_or_init(|| {
        let inverse = Inverse::new(arm);
        let bodies = ArmBodies::new(arm, inverse.chain());
        Prepared { inverse, bodies }
    })
}

impl Arm {
    fn read(texts: [String; 2], names: [String; 2], assumptions: Vec<String>) -> PyResult<Self> {
        let core = Core::from_strs(&texts[0], &texts[1], names.each_ref().map(String::as_str)).map_err(arm_error)?;
        let source = Arc::new(Source { texts, names, assumptions });
        Ok(Self { core: Arc::new(core), source, prepared: Arc::new(OnceLock::new()) })
    }

    /// Rows of positions, (n, k).
    fn rows(&self, positions: &Floats<'_>) -> Result<Vec<Vec<f64>>, CoreError> {
        let axes = self.core.axes.len();
        let shape = positions.shape();
        if shape.len() != 2 || shape[1] != axes {
            return Err(CoreError::Config(format!(
                "positions have shape {shape:?}; give (n, {axes}), one per joint of the arm"
            )));
        }
        Ok(values(positions, "positions", &[None, Some(axes)])?.chunks_exact(axes).map(<[f64]>::to_vec).collect())
    }

    /// One number per axis, as an array of the chain's capacity.
    pub(crate) fn positions(&self, values: &Floats<'_>, name: &str) -> Result<Positions, CoreError> {
        let (numbers, axes) = (vector(values, name)?, self.core.axes.len());
        if numbers.len() != axes {
            let given = numbers.len();
            return Err(CoreError::Config(format!("{name} has {given} values; give {axes}, one per joint of the arm")));
        }
        Ok(prepared(&self.prepared, &self.core).inverse.positions_of(&numbers))
    }

    fn numbers<'py>(&self, py: Python<'py>, number: impl Fn(&Axis) -> f64) -> PyResult<Array<'py, f64>> {
        array(py, self.core.axes.iter().map(number).collect(), &[self.core.axes.len()])
    }
}

/// A link, and its surface.
type LinkSurface<'py> = (usize, Array<'py, f64>, Array<'py, u32>);

/// The arguments of [`Arm::new`].
type NewArguments<'a> = (&'a str, &'a str, (&'a str, &'a str), &'a [String]);

#[pymethods]
impl Arm {
    /// Reads an arm from the text of its two files.
    #[new]
    #[pyo3(signature = (urdf, toml, names=None, assumptions=Vec::new()))]
    fn new(urdf: String, toml: String, names: Option<(String, String)>, assumptions: Vec<String>) -> PyResult<Self> {
        let (first, second) = names.unwrap_or_else(|| ("URDF".to_owned(), "arm.toml".to_owned()));
        Self::read([urdf, toml], [first, second], assumptions)
    }

    /// An arm that comes with the package.
    #[staticmethod]
    fn named(name: &str) -> PyResult<Self> {
        let found = arm_asset(name).map_err(arm_error)?;
        let names = [format!("{name}.urdf"), "arm.toml".to_owned()];
        Self::read([found.urdf.to_owned(), found.toml.to_owned()], names, Vec::new())
    }

    /// Names of the arms that come with the package.
    #[staticmethod]
    fn names() -> Vec<&'static str> {
        ARMS.iter().map(|asset| asset.name).collect()
    }

    /// Reads an arm from its URDF and its `arm.toml`.
    #[staticmethod]
    fn load(urdf: PathBuf, toml: PathBuf) -> PyResult<Self> {
        let [u, t] = Core::read_files(&urdf, &toml).map_err(arm_error)?;
        Self::read([u, t], [urdf.display().to_string(), toml.display().to_string()], Vec::new())
    }

    fn __getnewargs__(&self) -> NewArguments<'_> {
        let Source { texts: [urdf, toml], names: [first, second], assumptions } = &*self.source;
        (urdf, toml, (first, second), assumptions)
    }

    /// Arms are immutable: copies are the same object.
    fn __copy__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (_memo, /))]
    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    /// The text of its URDF and of its `arm.toml`.
    #[getter]
    fn files(&self) -> (&str, &str) {
        (&self.source.texts[0], &self.source.texts[1])
    }

    /// What its URDF does not say and was assumed, a sentence each, with file and line.
    #[getter]
    fn assumptions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let own = self.core.assumptions.iter().map(ToString::to_string);
        PyTuple::new(py, self.source.assumptions.iter().cloned().chain(own).collect::<Vec<_>>())
    }

    #[getter]
    fn name(&self) -> &str {
        &self.core.name
    }

    /// Names of the joints that move the flange, from the base on.
    #[getter]
    fn joints(&self) -> Vec<&str> {
        self.core.axis_joints().map(|joint| joint.name.as_str()).collect()
    }

    /// Names of the links.
    #[getter]
    fn links(&self) -> Vec<&str> {
        self.core.links.iter().map(|link| link.name.as_str()).collect()
    }

    /// Least and greatest position of each joint, (k, 2), rad or m.
    #[getter]
    fn joint_limits<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        crate::convert::table(py, self.core.axis_joints().map(|joint| joint.limits))
    }

    /// Greatest speed of each joint, (k,), rad/s or m/s.
    #[getter]
    fn speeds<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        self.numbers(py, |axis| axis.speed)
    }

    /// Greatest acceleration of each joint, (k,), rad/s2 or m/s2; infinite where none is known.
    #[getter]
    fn accelerations<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        self.numbers(py, |axis| axis.acceleration.unwrap_or(f64::INFINITY))
    }

    /// Greatest jerk of each joint, (k,), rad/s3 or m/s3; infinite where none is known.
    #[getter]
    fn jerks<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        self.numbers(py, |axis| axis.jerk.unwrap_or(f64::INFINITY))
    }

    /// Lower speeds near the ends of ranges, (k, 4): at a distance d from the least position (column 0) or the greatest (1) a joint moves
    /// towards it by at most sqrt(rate d) - offset (2 and 3), rad or m and s; infinite positions where nothing is slowed.
    #[getter]
    fn slowing<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        let row = |axis: &Axis| match &axis.slowing {
            Some(Slowing { ends: [lower, upper], rate, offset }) => [*lower, *upper, *rate, *offset],
            None => [f64::NEG_INFINITY, f64::INFINITY, 1.0, 0.0],
        };
        crate::convert::table(py, self.core.axes.iter().map(row))
    }

    /// Positions of the joints at home, (k,), rad or m.
    #[getter]
    fn home<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        self.numbers(py, |axis| axis.home)
    }

    /// Greatest mass at the flange, kg.
    #[getter]
    fn payload(&self) -> f64 {
        self.core.payload
    }

    /// Distance from the first joint beyond which the flange cannot be, metres.
    #[getter]
    fn reach_length(&self) -> f64 {
        prepared(&self.prepared, &self.core).inverse.chain().length()
    }

    /// Names of links that touch by design, beside those of neighbouring bodies.
    #[getter]
    fn touching_by_design(&self) -> Vec<(String, String)> {
        let pairs = prepared(&self.prepared, &self.core).bodies.by_design();
        pairs.into_iter().map(|[a, b]| (a.to_owned(), b.to_owned())).collect()
    }

    /// Pose of the base of a hand on the flange, (4, 4), as its files and those of the arm state it.
    fn flange_from_base_of<'py>(&self, py: Python<'py>, hand: &Hand) -> PyResult<Array<'py, f64>> {
        matrix(py, &self.core.flange_from_base_of(&hand.0))
    }

    /// Poses of the flange, (n, 4, 4) `base_from_flange`, with the joints at `positions` (n, k).
    fn flange_poses<'py>(&self, py: Python<'py>, positions: Floats<'py>) -> PyResult<Array<'py, f64>> {
        let rows = self.rows(&positions)?;
        let pose = |row: &Vec<f64>| Ok(self.core.forward_kinematics(row)?[self.core.flange]);
        let poses = rows.iter().map(pose).collect::<Result<Vec<_>, HandError>>().map_err(arm_error)?;
        matrices(py, poses.into_iter())
    }

    /// Frames of the links, (l, 4, 4) `base_from_link`, with the joints at `positions` (k,).
    fn link_frames<'py>(&self, py: Python<'py>, positions: Floats<'py>) -> PyResult<Array<'py, f64>> {
        let frames = self.core.forward_kinematics(&vector(&positions, "positions")?).map_err(arm_error)?;
        matrices(py, frames.into_iter())
    }

    /// Surfaces of the collision shapes: for each link with some, its index, vertices (n, 3) in its frame, metres, and faces (m, 3).
    fn link_surfaces<'py>(&self, py: Python<'py>) -> PyResult<Vec<LinkSurface<'py>>> {
        let mut found = Vec::new();
        for (index, link) in self.core.links.iter().enumerate() {
            let shapes: Vec<_> = link.colliders.iter().map(|one| (one.shape, one.link_from_shape)).collect();
            let Some(mesh) = surface(&shapes).map_err(CoreError::from)? else { continue };
            let vertices = crate::convert::table(py, mesh.vertices().iter().map(|p| [p.x, p.y, p.z]))?;
            found.push((index, vertices, crate::convert::table(py, mesh.faces().iter().copied())?));
        }
        Ok(found)
    }

    /// Jacobian of the flange, (6, k), base frame: velocity (m) and angular velocity (rad) per rad or m, with the joints at `positions` (k,).
    fn jacobian<'py>(&self, py: Python<'py>, positions: Floats<'py>) -> PyResult<Array<'py, f64>> {
        let positions = vector(&positions, "positions")?;
        self.core.forward_kinematics(&positions).map_err(arm_error)?; // checks their number
        let inverse = &prepared(&self.prepared, &self.core).inverse;
        let frames = inverse.chain().frames(&inverse.positions_of(&positions));
        let columns: Vec<_> = (0..positions.len()).map(|axis| inverse.chain().column(&frames, axis)).collect();
        array(py, (0..6).flat_map(|row| columns.iter().map(move |column| column[row])).collect(), &[6, columns.len()])
    }

    /// Postures for poses of the flange, (n, 4, 4) `base_from_flange`, without a look at collisions. Arrays by name, one row per pose.
    #[pyo3(signature = (poses, params, num_threads=None))]
    fn inverse<'py>(
        &self,
        py: Python<'py>,
        poses: Floats<'py>,
        params: &Bound<'py, PyAny>,
        #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let poses = isometries(&poses, "poses")?;
        let params: ReachParams = read_config(params, "ReachConfig")?;
        let (core, cell) = (Arc::clone(&self.core), Arc::clone(&self.prepared));
        let answers = detached(py, num_threads, move || {
            params.check()?;
            let inverse = &prepared(&cell, &core).inverse;
            Ok::<_, CoreError>(poses.par_iter().map(|pose| solved(inverse, pose, &params)).collect::<Vec<_>>())
        })?;
        self.answers(py, &answers, &params, &[])
    }

    /// Which poses `world_from_hand` (n, 4, 4) of an open hand, with preshapes (n,), the arm reaches. Arrays by name, one row per pose.
    #[pyo3(signature = (poses, preshapes, hand, world_from_base, mount, points, objects, walls, params, cache, num_threads))]
    #[allow(clippy::too_many_arguments)]
    fn reach<'py>(
        &self,
        py: Python<'py>,
        poses: Floats<'py>,
        preshapes: Floats<'py>,
        hand: &Hand,
        world_from_base: Floats<'py>,
        mount: Option<Floats<'py>>,
        points: Floats<'py>,
        objects: Vec<(PyRef<'py, Mesh>, Floats<'py>)>,
        walls: Vec<(Floats<'py>, [f64; 3])>,
        params: &Bound<'py, PyAny>,
        cache: Option<PathBuf>,
        #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let around = Obstacles::new(&objects, &walls)?;
        let params: ReachParams = read_config(params, "ReachConfig")?;
        let asked = asked(&poses, &preshapes)?;
        let world_from_base = isometry(&world_from_base, "world_from_base")?;
        let mount = mount.map(|m| isometry(&m, "mount")).transpose()?;
        let cloud = self::points(&points, "points")?;
        let (core, cell, hand) = (Arc::clone(&self.core), Arc::clone(&self.prepared), Arc::clone(&hand.0));
        let (answers, names) = detached(py, num_threads, move || {
            let Prepared { inverse, bodies } = prepared(&cell, &core);
            let (names, obstacles) = around.named(cache.as_deref())?.into_iter().unzip::<String, _, Vec<_>, Vec<_>>();
            let obstacles = obstacles.into_iter().map(|other| (other.obstacle, other.world_from_obstacle)).collect();
            let scene = Scene::new(world_from_base, &cloud, obstacles, params.clearance, params.point_radius)?;
            let reacher = Reacher { arm: &core, inverse, bodies, scene: &scene, params };
            let flange_from_base = mount.unwrap_or_else(|| core.flange_from_base_of(&hand));
            Ok::<_, CoreError>((reach(&reacher, &hand, &flange_from_base, &asked)?, names))
        })?;
        self.answers(py, &answers, &params, &names)
    }

    /// Which `points` (n, 3), world frame, are within `distances` (n,) of the arm with its joints at `positions` (k,), or of a hand.
    #[pyo3(signature = (points, distances, positions, world_from_base, hand=None, mount=None, num_threads=None))]
    #[allow(clippy::too_many_arguments)]
    fn on_arm<'py>(
        &self,
        py: Python<'py>,
        points: Floats<'py>,
        distances: Floats<'py>,
        positions: Floats<'py>,
        world_from_base: Floats<'py>,
        hand: Option<&Hand>,
        mount: Option<Floats<'py>>,
        #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
    ) -> PyResult<Array<'py, bool>> {
        let (cloud, distances) = (self::points(&points, "points")?, vector(&distances, "distances")?);
        let positions = vector(&positions, "positions")?;
        self.core.forward_kinematics(&positions).map_err(arm_error)?; // checks their number
        let world_from_base = isometry(&world_from_base, "world_from_base")?;
        let mount = mount.map(|m| isometry(&m, "mount")).transpose()?;
        let (n, m) = (cloud.len(), distances.len());
        if n != m {
            return Err(CoreError::Config(format!("there are {n} points and {m} distances; give one per point")).into());
        }
        let (core, cell, hand) = (Arc::clone(&self.core), Arc::clone(&self.prepared), hand.map(|h| Arc::clone(&h.0)));
        let near = detached(py, num_threads, move || {
            let Prepared { inverse, bodies } = prepared(&cell, &core);
            let mounted = hand.as_deref().map(|hand| Mounted {
                hand,
                flange_from_base: mount.unwrap_or_else(|| core.flange_from_base_of(hand)),
            });
            Ok::<_, CoreError>(on_arm((inverse, bodies), &positions, &world_from_base, mounted, &cloud, &distances)?)
        })?;
        array(py, near, &[n])
    }

    fn __repr__(&self) -> String {
        format!("Arm({:?}, {} joints)", self.core.name, self.core.axes.len())
    }
}

/// Poses with their preshapes.
pub(crate) fn asked(poses: &Floats<'_>, preshapes: &Floats<'_>) -> Result<Vec<(Isometry3<f64>, f64)>, CoreError> {
    let (poses, preshapes) = (isometries(poses, "poses")?, vector(preshapes, "preshapes")?);
    if poses.len() != preshapes.len() {
        let (n, m) = (poses.len(), preshapes.len());
        return Err(CoreError::Config(format!("there are {n} poses and {m} preshapes; give one preshape per pose")));
    }
    Ok(poses.into_iter().zip(preshapes).collect())
}

/// Postures of a pose of the flange.
fn solved(inverse: &Inverse, pose: &Isometry3<f64>, params: &ReachParams) -> Reach {
    let mut solutions: Vec<Solution> = Vec::new();
    let found = inverse.solve(pose, params.starts, params.max_angle, |solution| {
        solutions.push(solution);
        if solutions.len() >= params.solutions { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    Reach { reason: found.map_or_else(Reason::from, |()| Reason::Reached), solutions }
}

impl Arm {
    /// Arrays of the answers: `solutions` (n, s, k), NaN where there are fewer; `reason` (n,), a code of `graspbox.arms.Reason`; `room`,
    /// `singular` and `angle` (n,) of the first solution, NaN without one; and `why`, a sentence each.
    fn answers<'py>(
        &self,
        py: Python<'py>,
        answers: &[Reach],
        params: &ReachParams,
        names: &[String],
    ) -> PyResult<Bound<'py, PyDict>> {
        let (n, axes, most) = (answers.len(), self.core.axes.len(), params.solutions);
        let mut solutions = vec![f64::NAN; n * most * axes];
        for (rows, answer) in solutions.chunks_exact_mut(most * axes).zip(answers) {
            for (row, solution) in rows.chunks_exact_mut(axes).zip(&answer.solutions) {
                row.copy_from_slice(solution.values(axes));
            }
        }
        let chain = prepared(&self.prepared, &self.core).inverse.chain();
        let first = |number: &dyn Fn(&Solution) -> f64| {
            let numbers = answers.iter().map(|answer| answer.solutions.first().map_or(f64::NAN, number)).collect();
            array(py, numbers, &[n])
        };
        let dict = PyDict::new(py);
        dict.set_item("solutions", array(py, solutions, &[n, most, axes])?)?;
        dict.set_item("reason", array(py, answers.iter().map(|answer| code(&answer.reason)).collect(), &[n])?)?;
        dict.set_item("room", first(&|s| chain.room(&s.positions))?)?;
        dict.set_item("singular", first(&|s| chain.least_singular_value(&s.positions))?)?;
        dict.set_item("angle", first(&|s| s.angle)?)?;
        let bodies = &prepared(&self.prepared, &self.core).bodies;
        let why = answers.iter().map(|answer| answer.reason.sentence(&self.core, bodies, names));
        let why: Vec<String> = why.collect();
        dict.set_item("why", why)?;
        Ok(dict)
    }
}

/// Names of the reasons, in the order of their codes: the members of `graspbox.arms.Reason`.
pub const REASONS: [&str; 10] = [
    "REACHED",
    "TOO_FAR",
    "AT_LIMIT",
    "TOUCHES_ARM",
    "TOUCHES_HAND",
    "TOUCHES_TABLE",
    "TOUCHES_POINTS",
    "TOUCHES_OBJECT",
    "TURNED",
    "NOT_FOUND",
];

/// Place of a reason among [`REASONS`].
fn code(reason: &Reason) -> i64 {
    match reason {
        Reason::Reached => 0,
        Reason::TooFar => 1,
        Reason::AtLimit(_) => 2,
        Reason::ArmTouchesArm(_) => 3,
        Reason::ArmTouchesHand(_) => 4,
        Reason::ArmTouches(_, Touched::Table) => 5,
        Reason::ArmTouches(_, Touched::Points) => 6,
        Reason::ArmTouches(_, Touched::Obstacle(_)) => 7,
        Reason::Turned(_) => 8,
        Reason::NotFound => 9,
    }
}

/// An error about the files of an arm.
fn arm_error(error: HandError) -> CoreError {
    match CoreError::from(error) {
        CoreError::Hand(text) => CoreError::Arm(text),
        other => other,
    }
}
