//! `graspbox.Mesh`: a mesh with its name and mass, held in Rust.

use crate::convert::{Array, Floats, array, config, matrices, row_major, table};
use crate::errors::CoreError;
use crate::gil::detached;
use graspbox_camera::Model;
use graspbox_episode::{Body, DEFAULT_DENSITY, ObjectSpec};
use graspbox_mesh::{
    CleanOptions, LoadOptions, Mass, MassProperties, RestingOptions, TriMesh, check_watertight, clean, convex_hull,
    load, mass_properties, resting_poses, sample_surface,
};
use numpy::PyReadonlyArrayDyn;
use pyo3::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// Most samples of one call: more would not fit into memory beside their arrays.
const MAX_SAMPLES: usize = 20_000_000;

/// What every holder of a mesh shares.
pub struct MeshData {
    /// The object as it was given.
    pub spec: ObjectSpec,
    properties: MassProperties,
    body: OnceLock<Arc<Body>>,
    look: OnceLock<Model>,
    surface: OnceLock<Model>,
}

impl MeshData {
    /// Takes an object and weighs it.
    ///
    /// # Errors
    /// For a flat mesh or an impossible mass.
    pub fn new(spec: ObjectSpec) -> Result<Self, CoreError> {
        let mass = spec.mass.map_or(Mass::Density(DEFAULT_DENSITY), Mass::Kilograms);
        let properties = mass_properties(&spec.mesh, mass)?;
        Ok(Self { spec, properties, body: OnceLock::new(), look: OnceLock::new(), surface: OnceLock::new() })
    }

    /// The object as the simulation takes it, prepared at its first use; convex parts are kept in the folder `cache`.
    ///
    /// # Errors
    /// As [`Body::prepare`].
    pub fn body(&self, cache: Option<&Path>) -> Result<Arc<Body>, CoreError> {
        if let Some(body) = self.body.get() {
            return Ok(Arc::clone(body));
        }
        let body = Arc::new(Body::prepare(&self.spec, cache)?);
        Ok(Arc::clone(self.body.get_or_init(|| body)))
    }

    /// The mesh as the renderer takes it in full detail, prepared at its first use. Levels of detail cost more than a
    /// picture, and those of a million faces half a minute.
    ///
    /// # Errors
    /// As [`Model::without_levels`].
    pub fn surface(&self) -> Result<&Model, CoreError> {
        if let Some(model) = self.look.get().or_else(|| self.surface.get()) {
            return Ok(model);
        }
        let made = Model::without_levels(&self.spec.mesh)?;
        Ok(self.surface.get_or_init(|| made))
    }

    /// The mesh as the renderer takes it, prepared at its first use.
    ///
    /// # Errors
    /// As [`Model::new`].
    pub fn look(&self) -> Result<&Model, CoreError> {
        if let Some(look) = self.look.get() {
            return Ok(look);
        }
        let made = Model::new(&self.spec.mesh)?;
        Ok(self.look.get_or_init(|| made))
    }
}

/// A handle on a mesh.
#[pyclass(frozen, module = "graspbox._core")]
pub struct Mesh(pub Arc<MeshData>);

#[pymethods]
impl Mesh {
    /// Reads a file; `options` and `cleaning` are JSON.
    #[staticmethod]
    #[pyo3(signature = (path, name, mass, options, cleaning))]
    fn load(
        py: Python<'_>,
        path: PathBuf,
        name: String,
        mass: Option<f64>,
        options: &str,
        cleaning: Option<&str>,
    ) -> PyResult<Self> {
        let options: LoadOptions = config(options, "load options")?;
        let cleaning: Option<CleanOptions> = cleaning.map(|text| config(text, "cleaning options")).transpose()?;
        let data = detached(py, None, move || {
            let named = |error| CoreError::in_file(error, &path);
            let mut mesh = load(&path, &options).map_err(named)?;
            if let Some(cleaning) = &cleaning {
                mesh = clean(&mesh, cleaning).map_err(named)?.0;
            }
            MeshData::new(ObjectSpec { name, mesh, mass, parts: None })
        })?;
        Ok(Self(Arc::new(data)))
    }

    /// Takes vertices (n, 3) and faces (m, 3).
    #[staticmethod]
    #[pyo3(signature = (vertices, faces, name, mass))]
    fn from_arrays(
        vertices: Floats<'_>,
        faces: PyReadonlyArrayDyn<'_, u32>,
        name: String,
        mass: Option<f64>,
    ) -> PyResult<Self> {
        let vertices = crate::convert::points(&vertices, "vertices")?;
        let mesh = TriMesh::new(vertices, crate::convert::triples(&faces, "faces")?).map_err(CoreError::from)?;
        Ok(Self(Arc::new(MeshData::new(ObjectSpec { name, mesh, mass, parts: None })?)))
    }

    #[getter]
    fn name(&self) -> &str {
        &self.0.spec.name
    }

    #[getter]
    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        table(py, self.0.spec.mesh.vertices().iter().map(|p| [p.x, p.y, p.z]))
    }

    #[getter]
    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, u32>> {
        table(py, self.0.spec.mesh.faces().iter().copied())
    }

    #[getter]
    fn bounds<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        let aabb = self.0.spec.mesh.aabb();
        table(py, [aabb.min, aabb.max].into_iter().map(|p| [p.x, p.y, p.z]))
    }

    #[getter]
    fn area(&self) -> f64 {
        self.0.spec.mesh.area()
    }

    #[getter]
    fn volume(&self) -> f64 {
        self.0.properties.volume
    }

    #[getter]
    fn mass(&self) -> f64 {
        self.0.properties.mass
    }

    #[getter]
    fn center_of_mass<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        let center = self.0.properties.center_of_mass;
        array(py, vec![center.x, center.y, center.z], &[3])
    }

    #[getter]
    fn inertia<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        array(py, row_major(&self.0.properties.inertia).to_vec(), &[3, 3])
    }

    #[getter]
    fn watertight(&self) -> bool {
        check_watertight(&self.0.spec.mesh).is_ok()
    }

    /// Points (n, 3) and outward unit normals (n, 3) of the surface, uniform by area.
    fn sample<'py>(&self, py: Python<'py>, count: usize, seed: u64) -> PyResult<(Array<'py, f64>, Array<'py, f64>)> {
        if count > MAX_SAMPLES {
            return Err(CoreError::Config(format!("count is {count}; ask for at most {MAX_SAMPLES} samples")).into());
        }
        let data = Arc::clone(&self.0);
        let samples = detached(py, None, move || Ok::<_, CoreError>(sample_surface(&data.spec.mesh, count, seed)))?;
        let points = table(py, samples.iter().map(|s| [s.point.x, s.point.y, s.point.z]))?;
        let normals = table(py, samples.iter().map(|s| [s.normal.x, s.normal.y, s.normal.z]))?;
        Ok((points, normals))
    }

    /// Stable poses on a table, the most probable first: (n, 4, 4) `world_from_object`, and probabilities (n,).
    fn resting_poses<'py>(&self, py: Python<'py>) -> PyResult<(Array<'py, f64>, Array<'py, f64>)> {
        let data = Arc::clone(&self.0);
        let poses = detached(py, None, move || {
            let hull = convex_hull(data.spec.mesh.vertices())?;
            Ok::<_, CoreError>(resting_poses(&hull, &data.properties.center_of_mass, &RestingOptions::default())?)
        })?;
        let probabilities: Vec<f64> = poses.iter().map(|p| p.probability).collect();
        let count = poses.len();
        Ok((matrices(py, poses.iter().map(|p| p.world_from_object))?, array(py, probabilities, &[count])?))
    }

    fn __repr__(&self) -> String {
        let mesh = &self.0.spec.mesh;
        format!("Mesh({:?}, {} vertices, {} faces)", self.0.spec.name, mesh.vertices().len(), mesh.faces().len())
    }
}
