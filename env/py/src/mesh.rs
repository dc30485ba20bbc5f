//! `graspbox.Mesh`: a mesh with its name and mass.

use crate::convert::{self, Array, Floats, array, matrices, points, read_config, row_major, table, triples};
use crate::errors::CoreError;
use crate::gil::detached;
use graspbox_episode::{Body, DEFAULT_DENSITY, ObjectSpec};
use graspbox_mesh::{
    CleanOptions, LoadOptions, Mass, MassProperties, MeshError, PartsParams, RestingOptions, TriMesh, check_watertight,
    clean, convex_hull, least_width, load, mass_properties, resting_poses, sample_surface,
};
use graspbox_render::Model;
use nalgebra::Point3;
use numpy::PyReadonlyArrayDyn;
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;
use std::ffi::CString;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// Most samples of one call: more would not fit into memory with their arrays.
const MAX_SAMPLES: usize = 20_000_000;
/// Number of faces above which the user is warned that preparation takes long.
const LARGE_MESH: usize = 300_000;

/// Data shared by all handles on a mesh.
pub struct MeshData {
    /// The object as it was passed.
    pub spec: ObjectSpec,
    /// The file that it was read from, for errors.
    file: Option<PathBuf>,
    properties: MassProperties,
    body: OnceLock<Arc<Body>>,
    render_model: OnceLock<Model>,
    surface: OnceLock<Model>,
}

impl MeshData {
    /// Computes the mass properties of a cleaned object.
    ///
    /// # Errors
    /// `MeshError` for a flat mesh, `ConfigError` for an invalid mass.
    pub fn new(spec: ObjectSpec) -> Result<Self, CoreError> {
        let properties = weigh(&spec.mesh, spec.mass)?;
        Ok(Self::with(spec, properties, None))
    }

    /// Computes the mass properties of an object after the cleaning of [`Body::prepare`].
    ///
    /// * `solid`: whether they are those of the solid, which takes up to a second for an open surface, or of its convex hull.
    fn cleaned(
        mut spec: ObjectSpec,
        cleaning: Option<&CleanOptions>,
        file: Option<PathBuf>,
        solid: bool,
    ) -> Result<Self, MeshError> {
        let standard = CleanOptions::default();
        if let Some(options) = cleaning {
            spec.mesh = clean(&spec.mesh, options)?.0;
        }
        spec.mesh.check_extent()?;
        if !solid {
            let properties = weigh(&convex_hull(spec.mesh.vertices())?, spec.mass)?;
            return Ok(Self::with(spec, properties, file));
        }
        let as_simulated = cleaning.is_some_and(|options| options.orient && options.weld == standard.weld);
        let properties = if as_simulated {
            weigh(&spec.mesh, spec.mass)
        } else {
            weigh(&clean(&spec.mesh, &standard)?.0, spec.mass)
        };
        let data = Self::with(spec, properties?, file);
        if let Some(caveat) = data.properties.method.caveat() {
            tracing::warn!(target: "graspbox", "{}: {caveat}", data.described());
        }
        Ok(data)
    }

    /// An object that is already prepared.
    pub fn of_body(body: Body) -> Self {
        let (name, mesh) = (body.name().to_owned(), body.mesh().clone());
        let parts = body.parts().iter().map(|part| part.vertices().to_vec()).collect();
        let properties = body.mass_properties().clone();
        let spec = ObjectSpec { name, mesh, mass: Some(properties.mass), parts: Some(parts) };
        Self { body: OnceLock::from(Arc::new(body)), ..Self::with(spec, properties, None) }
    }

    fn with(spec: ObjectSpec, properties: MassProperties, file: Option<PathBuf>) -> Self {
        Self { spec, file, properties, body: OnceLock::new(), render_model: OnceLock::new(), surface: OnceLock::new() }
    }

    /// The file if there is one, else the name.
    fn described(&self) -> String {
        match &self.file {
            Some(file) => format!("`{}`", file.display()),
            None => format!("object `{}`", self.spec.name),
        }
    }

    /// The object for the simulation, prepared at first use; convex parts are cached in the folder `cache`.
    ///
    /// # Errors
    /// As [`Body::prepare`].
    pub fn body(&self, cache: Option<&Path>) -> Result<Arc<Body>, CoreError> {
        if let Some(body) = self.body.get() {
            return Ok(Arc::clone(body));
        }
        let prepared = Body::prepare(&self.spec, cache).map_err(CoreError::from);
        let body = Arc::new(match &self.file {
            Some(_) => prepared.map_err(|error| error.about(&self.described()))?,
            None => prepared?,
        });
        Ok(Arc::clone(self.body.get_or_init(|| body)))
    }

    /// The render model in full detail, prepared at first use. Levels of detail take longer than a picture, and half a minute for a million faces.
    ///
    /// # Errors
    /// As [`Model::without_levels`].
    pub fn surface(&self) -> Result<&Model, CoreError> {
        if let Some(model) = self.render_model.get().or_else(|| self.surface.get()) {
            return Ok(model);
        }
        let made = Model::without_levels(&self.spec.mesh)?;
        Ok(self.surface.get_or_init(|| made))
    }

    /// The render model with levels of detail, prepared at first use.
    ///
    /// # Errors
    /// As [`Model::new`].
    pub fn render_model(&self) -> Result<&Model, CoreError> {
        if let Some(model) = self.render_model.get() {
            return Ok(model);
        }
        let made = Model::new(&self.spec.mesh)?;
        Ok(self.render_model.get_or_init(|| made))
    }
}

fn weigh(mesh: &TriMesh, mass: Option<f64>) -> Result<MassProperties, MeshError> {
    mass_properties(mesh, mass.map_or(Mass::Density(DEFAULT_DENSITY), Mass::Kilograms))
}

/// A triangle mesh with a name and a mass in Rust memory: metres, kilograms, the frame of its file. Immutable; copies share it, and pickles
/// contain its arrays.
#[pyclass(frozen, module = "graspbox._core")]
pub struct Mesh(pub Arc<MeshData>);

/// Contents of a pickle: the arguments of the constructor.
type State<'py> = (Array<'py, f64>, Array<'py, u32>, String, Option<f64>, Option<()>, Option<Vec<Array<'py, f64>>>);

fn cleaning_options(options: Option<&Bound<'_, PyAny>>) -> Result<Option<CleanOptions>, CoreError> {
    options.map(|options| read_config(options, "cleaning options")).transpose()
}

impl Mesh {
    /// Cleans a mesh, with a Python warning before a large one, and computes its mass properties; errors and log events name its file.
    fn cleaned(
        py: Python<'_>,
        spec: ObjectSpec,
        cleaning: Option<CleanOptions>,
        file: Option<PathBuf>,
        solid: bool,
    ) -> PyResult<Self> {
        if spec.mesh.faces().len() > LARGE_MESH {
            warn_large(py, spec.mesh.faces().len())?;
        }
        let data = detached(py, None, move || {
            MeshData::cleaned(spec, cleaning.as_ref(), file.clone(), solid).map_err(|error| match &file {
                Some(file) => CoreError::in_file(error, file),
                None => error.into(),
            })
        })?;
        Ok(Self(Arc::new(data)))
    }
}

fn warn_large(py: Python<'_>, faces: usize) -> PyResult<()> {
    let text = format!(
        "the mesh has {faces} faces: cleaning it and preparing it for simulation take tens of seconds to minutes; \
         graspable objects need {LARGE_MESH} at most"
    );
    // Level 2: the caller of the public function.
    PyErr::warn(py, &py.get_type::<PyUserWarning>(), &CString::new(text)?, 2)
}

#[pymethods]
impl Mesh {
    /// A mesh from vertices (n, 3) and faces (m, 3); `parts` are the vertices of convex parts, each (k, 3). Not `solid`, it has the mass properties
    /// of its convex hull.
    #[new]
    #[pyo3(signature = (vertices, faces, name, mass, cleaning, parts, solid = true))]
    fn new(
        vertices: Floats<'_>,
        faces: PyReadonlyArrayDyn<'_, u32>,
        name: String,
        mass: Option<f64>,
        cleaning: Option<&Bound<'_, PyAny>>,
        parts: Option<Vec<Floats<'_>>>,
        solid: bool,
    ) -> PyResult<Self> {
        let (vertices, triangles) = (points(&vertices, "vertices")?, triples(&faces, "faces")?);
        let part = |(i, part): (usize, &Floats<'_>)| points(part, &format!("parts[{i}]"));
        let parts = parts.map(|parts| parts.iter().enumerate().map(part).collect()).transpose()?;
        let cleaning = cleaning_options(cleaning)?;
        let mesh = TriMesh::new(vertices, triangles).map_err(CoreError::from)?;
        Self::cleaned(faces.py(), ObjectSpec { name, mesh, mass, parts }, cleaning, None, solid)
    }

    /// A mesh of a closed surface, whose convex parts are made at once, with settings `parts`, and are cached nowhere.
    #[staticmethod]
    #[pyo3(signature = (vertices, faces, name, mass, parts))]
    fn in_parts(
        py: Python<'_>,
        vertices: Floats<'_>,
        faces: PyReadonlyArrayDyn<'_, u32>,
        name: String,
        mass: f64,
        parts: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let (vertices, faces) = (points(&vertices, "vertices")?, triples(&faces, "faces")?);
        let params: PartsParams = read_config(parts, "PartsConfig")?;
        detached(py, None, move || {
            let mesh = TriMesh::new(vertices, faces)?;
            mesh.check_extent()?;
            let spec = ObjectSpec { name, mesh, mass: Some(mass), parts: None };
            Ok::<_, CoreError>(Self(Arc::new(MeshData::of_body(Body::prepare_with(&spec, &params, None)?))))
        })
    }

    /// The object with every length times `scale`, of the same density. Its convex parts, cached in `cache`, are scaled too.
    fn scaled(&self, py: Python<'_>, scale: f64, cache: Option<PathBuf>) -> PyResult<Self> {
        let data = Arc::clone(&self.0);
        detached(py, None, move || {
            let body = data.body(cache.as_deref())?.scaled(scale)?;
            Ok::<_, CoreError>(Self(Arc::new(MeshData::of_body(body))))
        })
    }

    /// Reads a file; `solid` as in the constructor.
    #[staticmethod]
    #[pyo3(signature = (path, name, mass, options, cleaning, solid = true))]
    fn load(
        py: Python<'_>,
        path: PathBuf,
        name: String,
        mass: Option<f64>,
        options: &Bound<'_, PyAny>,
        cleaning: Option<&Bound<'_, PyAny>>,
        solid: bool,
    ) -> PyResult<Self> {
        let options: LoadOptions = read_config(options, "load options")?;
        let cleaning = cleaning_options(cleaning)?;
        let file = path.clone();
        let read = move || load(&file, &options).map_err(|error| CoreError::in_file(error, &file));
        let mesh = detached(py, None, read)?;
        Self::cleaned(py, ObjectSpec { name, mesh, mass, parts: None }, cleaning, Some(path), solid)
    }

    fn __getnewargs__<'py>(&self, py: Python<'py>) -> PyResult<State<'py>> {
        let spec = &self.0.spec;
        let part = |part: &Vec<Point3<f64>>| table(py, part.iter().map(|p| [p.x, p.y, p.z]));
        let parts = spec.parts.as_ref().map(|parts| parts.iter().map(part).collect()).transpose()?;
        Ok((self.vertices(py)?, self.faces(py)?, spec.name.clone(), spec.mass, None, parts))
    }

    fn __copy__(&self) -> Self {
        Self(Arc::clone(&self.0))
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.__copy__()
    }

    /// Name of the object.
    #[getter]
    fn name(&self) -> &str {
        &self.0.spec.name
    }

    /// Vertices (n, 3), metres: a new copy.
    #[getter]
    fn vertices<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        table(py, self.0.spec.mesh.vertices().iter().map(|p| [p.x, p.y, p.z]))
    }

    /// Faces (m, 3) as indices of vertices, counter-clockwise from outside: a new copy.
    #[getter]
    fn faces<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, u32>> {
        table(py, self.0.spec.mesh.faces().iter().copied())
    }

    /// Least and greatest corner (2, 3) of the axis-aligned bounds, metres.
    #[getter]
    fn bounds<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        let aabb = self.0.spec.mesh.aabb();
        table(py, [aabb.min, aabb.max].into_iter().map(|p| [p.x, p.y, p.z]))
    }

    /// Surface area, m2.
    #[getter]
    fn area(&self) -> f64 {
        self.0.spec.mesh.area()
    }

    /// Enclosed volume, m3; that of the convex hull if the mesh encloses hardly any.
    #[getter]
    fn volume(&self) -> f64 {
        self.0.properties.volume
    }

    /// Mass, kg: as passed, else the volume times 400 kg/m3.
    #[getter]
    fn mass(&self) -> f64 {
        self.0.properties.mass
    }

    /// Centre of mass (3,), metres, for uniform density.
    #[getter]
    fn center_of_mass<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        let center = self.0.properties.center_of_mass;
        array(py, vec![center.x, center.y, center.z], &[3])
    }

    /// Inertia tensor (3, 3) about the centre of mass, along the mesh's axes, kg m2.
    #[getter]
    fn inertia<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        array(py, row_major(&self.0.properties.inertia).to_vec(), &[3, 3])
    }

    /// True if every edge has exactly two faces with consistent orientation.
    #[getter]
    fn watertight(&self) -> bool {
        check_watertight(&self.0.spec.mesh).is_ok()
    }

    /// Points (n, 3) and outward unit normals (n, 3) of the surface, uniform by area.
    ///
    /// `count` is at most 20 million. The same mesh, count and seed give the same samples.
    fn sample<'py>(&self, py: Python<'py>, count: i128, seed: i128) -> PyResult<(Array<'py, f64>, Array<'py, f64>)> {
        let samples = usize::try_from(count).ok().filter(|n| *n <= MAX_SAMPLES);
        let bad = || CoreError::Config(format!("count is {count}; give 0 to {MAX_SAMPLES} samples"));
        let (count, seed) = (samples.ok_or_else(bad)?, convert::seed(seed)?);
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

    /// Smallest distance of two vertical planes between which the object lies, metres.
    ///
    /// `world_from_object` is a pose (4, 4), metres; the z axis of the world is vertical.
    fn least_width(&self, world_from_object: Floats<'_>) -> PyResult<f64> {
        let pose = convert::isometry(&world_from_object, "world_from_object")?;
        Ok(least_width(self.0.spec.mesh.vertices(), &pose))
    }

    fn __repr__(&self) -> String {
        let mesh = &self.0.spec.mesh;
        format!("Mesh({:?}, {} vertices, {} faces)", self.0.spec.name, mesh.vertices().len(), mesh.faces().len())
    }
}
