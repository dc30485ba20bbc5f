//! `graspbox.Hand`: a hand read from its two files.

use crate::convert::{Array, Floats, array, matrices, table, vector};
use crate::errors::CoreError;
use graspbox_hand::reflex::{REFLEX_TOML, REFLEX_URDF};
use graspbox_hand::{Hand as Core, HandConfiguration, Material, MotorKind};
use nalgebra::UnitQuaternion;
use pyo3::prelude::*;
use std::hash::{Hash, Hasher};
use std::path::PathBuf;
use std::sync::Arc;

/// Poses (n, 4, 4), half extents (n, 3), and which are pads (n,).
type Shapes<'py> = (Array<'py, f64>, Array<'py, f64>, Array<'py, bool>);

/// A handle on a hand, with the text of its two files, by which it is pickled and compared.
#[pyclass(frozen, eq, hash, module = "graspbox._core")]
pub struct Hand(pub Arc<Core>, Arc<[String; 2]>);

impl PartialEq for Hand {
    fn eq(&self, other: &Self) -> bool {
        self.1 == other.1
    }
}

impl Eq for Hand {}

impl Hash for Hand {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.1.hash(state);
    }
}

#[pymethods]
impl Hand {
    /// Reads a hand from the text of its two files.
    #[new]
    fn new(urdf: String, toml: String) -> PyResult<Self> {
        let hand = Core::from_strs(&urdf, &toml, ["URDF", "hand.toml"]).map_err(CoreError::from)?;
        Ok(Self(Arc::new(hand), Arc::new([urdf, toml])))
    }

    /// The ReFlex.
    #[staticmethod]
    fn reflex() -> PyResult<Self> {
        let hand = Core::reflex().map_err(CoreError::from)?.clone();
        Ok(Self(Arc::new(hand), Arc::new([REFLEX_URDF.to_owned(), REFLEX_TOML.to_owned()])))
    }

    /// The text of the ReFlex's URDF and `hand.toml`.
    #[staticmethod]
    fn reflex_files() -> (&'static str, &'static str) {
        (REFLEX_URDF, REFLEX_TOML)
    }

    /// Reads a hand from its URDF and its `hand.toml`.
    #[staticmethod]
    fn load(urdf: PathBuf, toml: PathBuf) -> PyResult<Self> {
        let [u, t] = Core::read_files(&urdf, &toml).map_err(CoreError::from)?;
        let names = [urdf.display().to_string(), toml.display().to_string()];
        let hand = Core::from_strs(&u, &t, names.each_ref().map(String::as_str)).map_err(CoreError::from)?;
        Ok(Self(Arc::new(hand), Arc::new([u, t])))
    }

    fn __getnewargs__(&self) -> (&str, &str) {
        (&self.1[0], &self.1[1])
    }

    /// Hands are immutable: copies are the same object.
    fn __copy__(slf: Py<Self>) -> Py<Self> {
        slf
    }

    #[pyo3(signature = (_memo, /))]
    fn __deepcopy__(slf: Py<Self>, _memo: &Bound<'_, PyAny>) -> Py<Self> {
        slf
    }

    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    #[getter]
    fn fingers(&self) -> usize {
        self.0.fingers.len()
    }

    /// Speed at which a trial closes each motor but the preshape's, rad/s, in the order of the motors.
    #[getter]
    fn closing_speeds(&self) -> Vec<f64> {
        let spools = self.0.motors.iter().filter(|motor| motor.kind != MotorKind::Preshape);
        spools.map(|motor| motor.default_speed).collect()
    }

    #[getter]
    fn preshape_limits(&self) -> (f64, f64) {
        let [low, high] = self.0.preshape_limits;
        (low, high)
    }

    /// Collision shapes as boxes at the given angles: `hand_from_shape` (n, 4, 4), half extents (n, 3), and which are pads (n,).
    fn shapes<'py>(
        &self,
        py: Python<'py>,
        preshape: f64,
        proximal: Floats<'_>,
        distal: Floats<'_>,
    ) -> PyResult<Shapes<'py>> {
        let configuration = HandConfiguration {
            preshape,
            proximal: vector(&proximal, "proximal")?,
            distal: vector(&distal, "distal")?,
        };
        let shapes = self.0.shapes_at(&configuration).map_err(CoreError::from)?;
        let pads: Vec<bool> = shapes.iter().map(|s| s.collider.material == Material::Pad).collect();
        let count = shapes.len();
        Ok((
            matrices(py, shapes.iter().map(|s| s.hand_from_shape))?,
            table(py, shapes.iter().map(|s| s.collider.shape.half_extents(&UnitQuaternion::identity()).into()))?,
            array(py, pads, &[count])?,
        ))
    }

    fn __repr__(&self) -> String {
        format!("Hand({:?}, {} fingers)", self.0.name, self.0.fingers.len())
    }
}
