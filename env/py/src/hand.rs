//! `graspbox.Hand`: a hand read from its two files.

use crate::convert::{Array, Floats, array, matrices, table, vector};
use crate::description::{Description, describe};
use crate::errors::CoreError;
use graspbox_hand::assets::{ASSETS, asset};
use graspbox_hand::{Hand as Core, JointKind, Material};
use graspbox_plan::closing_center;
use nalgebra::{UnitQuaternion, Vector3};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::collections::BTreeMap;
use std::hash::{Hash, Hasher};
use std::path::PathBuf;
use std::sync::Arc;

/// Poses (n, 4, 4), half extents (n, 3), pad flags (n,), and joints (n,).
type Shapes<'py> = (Array<'py, f64>, Array<'py, f64>, Array<'py, bool>, Array<'py, i64>);
/// The arguments of [`Hand::new`].
type NewArguments<'a> = (&'a str, &'a str, (&'a str, &'a str), &'a [String]);
/// Frames (j, 4, 4), chains (j,), and revolute flags (j,).
type JointFrames<'py> = (Array<'py, f64>, Array<'py, i64>, Array<'py, bool>);

/// What a hand was made from: by the texts it is compared, by all of it pickled.
struct Source {
    /// Its URDF and its `hand.toml`.
    texts: [String; 2],
    /// Names of the two files in errors and assumptions.
    names: [String; 2],
    /// What was assumed before the URDF was made.
    assumptions: Vec<String>,
}

/// A handle on a hand, with what it was made from.
#[pyclass(frozen, eq, hash, module = "graspbox._core")]
pub struct Hand(pub Arc<Core>, Arc<Source>);

impl PartialEq for Hand {
    fn eq(&self, other: &Self) -> bool {
        self.1.texts == other.1.texts
    }
}

impl Eq for Hand {}

impl Hash for Hand {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.1.texts.hash(state);
    }
}

impl Hand {
    fn read(texts: [String; 2], names: [String; 2], assumptions: Vec<String>) -> PyResult<Self> {
        let hand =
            Core::from_strs(&texts[0], &texts[1], names.each_ref().map(String::as_str)).map_err(CoreError::from)?;
        Ok(Self(Arc::new(hand), Arc::new(Source { texts, names, assumptions })))
    }
}

#[pymethods]
impl Hand {
    /// Reads a hand from the text of its two files.
    #[new]
    #[pyo3(signature = (urdf, toml, names=None, assumptions=Vec::new()))]
    fn new(urdf: String, toml: String, names: Option<(String, String)>, assumptions: Vec<String>) -> PyResult<Self> {
        let (first, second) = names.unwrap_or_else(|| ("URDF".to_owned(), "hand.toml".to_owned()));
        Self::read([urdf, toml], [first, second], assumptions)
    }

    /// A hand that comes with the package.
    #[staticmethod]
    fn named(name: &str) -> PyResult<Self> {
        let found = asset(name).map_err(CoreError::from)?;
        let names = [format!("{name}.urdf"), "hand.toml".to_owned()];
        Self::read([found.urdf.to_owned(), found.toml.to_owned()], names, Vec::new())
    }

    /// Names of the hands that come with the package.
    #[staticmethod]
    fn names() -> Vec<&'static str> {
        ASSETS.iter().map(|asset| asset.name).collect()
    }

    /// The text of its URDF and of its `hand.toml`.
    #[getter]
    fn files(&self) -> (&str, &str) {
        (&self.1.texts[0], &self.1.texts[1])
    }

    /// What its URDF does not say and was assumed, a sentence each, with file and line.
    #[getter]
    fn assumptions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        let own = self.0.assumptions.iter().map(ToString::to_string);
        PyTuple::new(py, self.1.assumptions.iter().cloned().chain(own).collect::<Vec<_>>())
    }

    /// Reads a hand from its URDF and its `hand.toml`.
    #[staticmethod]
    fn load(urdf: PathBuf, toml: PathBuf) -> PyResult<Self> {
        let [u, t] = Core::read_files(&urdf, &toml).map_err(CoreError::from)?;
        let names = [urdf.display().to_string(), toml.display().to_string()];
        Self::read([u, t], names, Vec::new())
    }

    fn __getnewargs__(&self) -> NewArguments<'_> {
        let Source { texts: [urdf, toml], names: [first, second], assumptions } = &*self.1;
        (urdf, toml, (first, second), assumptions)
    }

    /// Hands are immutable: copies are the same object.
    fn __copy__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (_memo, /))]
    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    /// All that its files say, as plain values: see [`Description`].
    #[getter]
    fn description(&self) -> Description {
        describe(&self.0)
    }

    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    /// Names of the chains that leave the base: fingers, in most hands.
    #[getter]
    fn chains(&self) -> Vec<String> {
        self.0.chains().into_iter().map(|chain| chain.name).collect()
    }

    /// Names of the independent joints, in the order of their positions.
    #[getter]
    fn joints(&self) -> Vec<&str> {
        self.0.coordinates().map(|joint| self.0.joints[joint].name.as_str()).collect()
    }

    /// Index of the chain of each independent joint.
    #[getter]
    fn joint_chains(&self) -> Vec<usize> {
        let chain = |joint: usize| self.0.chain_of_link(self.0.joints[joint].child);
        self.0.coordinates().filter_map(chain).collect()
    }

    /// Least and greatest position of each independent joint, (c, 2), rad or m.
    #[getter]
    fn joint_limits<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        let limits: Vec<[f64; 2]> = self.0.coordinates().map(|joint| self.0.joints[joint].limits).collect();
        table(py, limits.into_iter())
    }

    /// Names of the actuators.
    #[getter]
    fn actuators(&self) -> Vec<&str> {
        self.0.actuators.iter().map(|actuator| actuator.name.as_str()).collect()
    }

    /// Names of the tendons.
    #[getter]
    fn tendons(&self) -> Vec<&str> {
        self.0.tendons.iter().map(|tendon| tendon.name.as_str()).collect()
    }

    /// Speed at which a trial closes each actuator except the preshape's, rad/s or m/s; 0 for one that does not close.
    #[getter]
    fn closing_speeds(&self) -> Vec<f64> {
        let hand = &self.0;
        let speed = |index| if hand.grasp.closing.contains(&index) { hand.actuators[index].default_speed } else { 0.0 };
        hand.grasp_actuators().map(speed).collect()
    }

    /// Positions (a,) of the actuators but the preshape's of the open hand, rad or m.
    fn open_positions<'py>(&self, py: Python<'py>, preshape: f64) -> PyResult<Array<'py, f64>> {
        let all = self.0.open_positions(preshape);
        let positions: Vec<f64> = self.0.grasp_actuators().map(|index| all[index]).collect();
        let count = positions.len();
        array(py, positions, &[count])
    }

    #[getter]
    fn preshape_limits(&self) -> (f64, f64) {
        let [low, high] = self.0.preshape_limits();
        (low, high)
    }

    #[getter]
    fn preshape_unit(&self) -> &'static str {
        self.0.preshape_unit()
    }

    /// Preshapes that the planner tries, by name.
    #[getter]
    fn preshapes(&self) -> BTreeMap<&str, f64> {
        self.0.preshapes().iter().map(|named| (named.name.as_str(), named.value)).collect()
    }

    /// Width of the widest object that goes between the open fingers, as the preshapes state it, metres; infinite where one states none.
    #[getter]
    fn widest(&self) -> f64 {
        self.0.widest()
    }

    /// Grasp centre, (3,), hand frame, metres.
    #[getter]
    fn grasp_center<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        array(py, self.0.grasp.center.coords.as_slice().to_vec(), &[3])
    }

    /// Closing centre with `preshape`, (3,), metres: above the point of the palm where its chains meet, at the depth of the grasp centre.
    fn closing_center<'py>(&self, py: Python<'py>, preshape: f64) -> PyResult<Array<'py, f64>> {
        let on_palm = closing_center(&self.0, preshape).map_err(CoreError::from)?;
        array(py, vec![on_palm.x, on_palm.y, self.0.grasp.center.z], &[3])
    }

    /// Positions (c,) of the independent joints of the open hand, rad or m.
    fn open<'py>(&self, py: Python<'py>, preshape: f64) -> PyResult<Array<'py, f64>> {
        let positions = self.0.open_configuration(preshape);
        let count = positions.len();
        array(py, positions, &[count])
    }

    /// Positions (c,) of the independent joints of the hand closed by a share of their travel, 0 to 1, rad or m.
    fn closed<'py>(&self, py: Python<'py>, preshape: f64, share: f64) -> PyResult<Array<'py, f64>> {
        let positions = self.0.closed_configuration(preshape, share);
        let count = positions.len();
        array(py, positions, &[count])
    }

    /// Frames of the links, in the order of the description, with the independent joints at `positions` (c,): `hand_from_link` (l, 4, 4).
    fn link_frames<'py>(&self, py: Python<'py>, positions: Floats<'_>) -> PyResult<Array<'py, f64>> {
        let links = self.0.hand_from_links(&vector(&positions, "positions")?).map_err(CoreError::from)?;
        matrices(py, links.into_iter())
    }

    /// Collision shapes as boxes with the independent joints at `positions` (c,): `hand_from_shape` (n, 4, 4), half extents (n, 3), pad flags (n,),
    /// and the row of [`Hand::joint_frames`] of the joint that moves each, -1 for the palm (n,).
    fn shapes<'py>(&self, py: Python<'py>, positions: Floats<'_>) -> PyResult<Shapes<'py>> {
        let positions = vector(&positions, "positions")?;
        let shapes = self.0.shapes_at(&positions).map_err(CoreError::from)?;
        let pads: Vec<bool> = shapes.iter().map(|s| s.collider.material == Material::Pad).collect();
        let moving: Vec<usize> = self.0.chains().into_iter().flat_map(|chain| chain.joints).collect();
        let carrier = |link: usize| {
            let first = self.0.carrier(link);
            moving.iter().position(|joint| joint + 1 == first).map_or(-1, |row| row as i64)
        };
        let count = shapes.len();
        Ok((
            matrices(py, shapes.iter().map(|s| s.hand_from_shape))?,
            table(py, shapes.iter().map(|s| s.collider.shape.half_extents(&UnitQuaternion::identity()).into()))?,
            array(py, pads, &[count])?,
            array(py, shapes.iter().map(|s| carrier(s.link)).collect(), &[count])?,
        ))
    }

    /// Frames of all moving joints, chain by chain from root to tip, with the independent ones at `positions` (c,): hand_from_joint (j, 4, 4),
    /// whose x axis is the joint's axis, the index of the chain of each (j,), and revolute flags (j,).
    fn joint_frames<'py>(&self, py: Python<'py>, positions: Floats<'_>) -> PyResult<JointFrames<'py>> {
        let links = self.0.hand_from_links(&vector(&positions, "positions")?).map_err(CoreError::from)?;
        let frame = |joint: usize| {
            let description = &self.0.joints[joint];
            let turn = UnitQuaternion::rotation_between(&Vector3::x(), &description.axis)
                .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI));
            links[description.child] * turn
        };
        let chains = self.0.chains();
        let joints = chains.iter().enumerate().flat_map(|(index, chain)| chain.joints.iter().map(move |j| (index, *j)));
        let joints: Vec<(usize, usize)> = joints.collect();
        Ok((
            matrices(py, joints.iter().map(|(_, joint)| frame(*joint)))?,
            array(py, joints.iter().map(|(chain, _)| *chain as i64).collect(), &[joints.len()])?,
            array(
                py,
                joints.iter().map(|(_, j)| self.0.joints[*j].kind == JointKind::Revolute).collect(),
                &[joints.len()],
            )?,
        ))
    }

    fn __repr__(&self) -> String {
        let (joints, actuators) = (self.0.coordinates().count(), self.0.actuators.len());
        format!("Hand({:?}, {joints} joints, {actuators} actuators)", self.0.name)
    }
}
