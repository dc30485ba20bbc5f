//! `graspbox._core.SettledScene`: an object at rest on the table, and trials on it.

use crate::convert::{
    Array, Floats, array, entries, isometries, isometry, matrices, matrix, matrix_rows, read_config, row_major, table,
    vector,
};
use crate::errors::CoreError;
use crate::gil::{detached, interruptible};
use crate::hand::Hand;
use crate::mesh::{Mesh, MeshData};
use graspbox_episode::forces::PULLS;
use graspbox_episode::study::Measures;
use graspbox_episode::{
    Body, FailureKind, Finished, ForceConfig, ForceOutcome, Progress, Sample, Scene as Core, Study, TrialConfig,
    TrialOutcome, run_forces, run_loaded_trials, run_observed_trials, trace_trial,
};
use graspbox_hand::GraspPose;
use graspbox_plan::Feasibility;
use graspbox_sim::{HandContact, PhysicsConfig, Template};
use nalgebra::{Isometry3, Vector3};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::Arc;

/// Convex parts, mass, centre of mass, inertia.
type BodyArrays<'py> = (Vec<Array<'py, f64>>, f64, Array<'py, f64>, Array<'py, f64>);

/// A handle on a settled object.
#[pyclass(frozen, module = "graspbox._core")]
pub struct SettledScene {
    /// The settled object.
    pub core: Arc<Core>,
    mesh: Arc<MeshData>,
}

/// Poses (n, 4, 4) with their preshapes (n,).
fn grasps(poses: &Floats<'_>, preshape: &Floats<'_>) -> Result<Vec<GraspPose>, CoreError> {
    let poses = isometries(poses, "poses")?;
    let preshapes = vector(preshape, "preshape")?;
    if poses.len() != preshapes.len() {
        let (poses, preshapes) = (poses.len(), preshapes.len());
        return Err(CoreError::Config(format!("there are {poses} poses but {preshapes} preshapes; give one each")));
    }
    let pairs = poses.into_iter().zip(preshapes);
    Ok(pairs.map(|(object_from_hand, preshape)| GraspPose { object_from_hand, preshape }).collect())
}

#[pymethods]
impl SettledScene {
    /// Prepares the mesh (convex parts are cached in `cache`) and lets it settle.
    #[new]
    #[pyo3(signature = (mesh, hand, physics, world_from_object, cache))]
    fn new(
        py: Python<'_>,
        mesh: &Mesh,
        hand: &Hand,
        physics: &Bound<'_, PyAny>,
        world_from_object: Option<Floats<'_>>,
        cache: Option<PathBuf>,
    ) -> PyResult<Self> {
        let physics: PhysicsConfig = read_config(physics, "PhysicsConfig")?;
        let start = world_from_object.map(|m| isometry(&m, "world_from_object")).transpose()?;
        let (mesh, hand) = (Arc::clone(&mesh.0), Arc::clone(&hand.0));
        detached(py, None, move || {
            let body = mesh.body(cache.as_deref())?;
            let core = Arc::new(Core::new(&body, hand, physics, start.as_ref())?);
            if let Some(start) = start {
                warn_of_toppling(&core, &start);
            }
            Ok::<_, CoreError>(Self { core, mesh })
        })
    }

    /// Objects that lie among each other and walls, as `arrange` returns them; a trial may grasp any of them without a `target`.
    #[staticmethod]
    #[pyo3(signature = (meshes, world_from_objects, walls, target, hand, physics, cache))]
    #[expect(clippy::too_many_arguments, reason = "what is in the scene crosses by itself")]
    fn of_objects(
        py: Python<'_>,
        meshes: Vec<PyRef<'_, Mesh>>,
        world_from_objects: Floats<'_>,
        walls: Vec<(Floats<'_>, [f64; 3])>,
        target: Option<usize>,
        hand: &Hand,
        physics: &Bound<'_, PyAny>,
        cache: Option<PathBuf>,
    ) -> PyResult<Self> {
        let physics: PhysicsConfig = read_config(physics, "PhysicsConfig")?;
        let poses = isometries(&world_from_objects, "world_from_objects")?;
        let walls = crate::layout::walls(&walls)?;
        let (data, hand): (Vec<_>, _) = (meshes.iter().map(|mesh| Arc::clone(&mesh.0)).collect(), Arc::clone(&hand.0));
        detached(py, None, move || {
            let bodies = data.iter().map(|mesh| mesh.body(cache.as_deref())).collect::<Result<Vec<_>, _>>()?;
            let bodies: Vec<&Body> = bodies.iter().map(|body| &**body).collect();
            let core = Arc::new(Core::of_objects(&bodies, &poses, &walls, target, hand, physics)?);
            let mesh = Arc::clone(&data[core.target()]);
            Ok::<_, CoreError>(Self { core, mesh })
        })
    }

    #[getter]
    fn name(&self) -> &str {
        self.core.name()
    }

    #[getter]
    fn mesh(&self) -> Mesh {
        Mesh(Arc::clone(&self.mesh))
    }

    #[getter]
    fn world_from_object<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        matrix(py, self.core.world_from_object())
    }

    #[getter]
    fn target(&self) -> usize {
        self.core.target()
    }

    /// Resting poses of the objects beside the target, in their order.
    #[getter]
    fn world_from_others<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        let others = (0..self.core.template().object_count()).filter(|object| *object != self.core.target());
        let poses: Vec<Isometry3<f64>> = others.map(|object| self.core.world_from(object)).collect();
        matrices(py, poses.into_iter())
    }

    #[getter]
    fn center_of_mass<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        let center = self.core.center_of_mass();
        array(py, vec![center.x, center.y, center.z], &[3])
    }

    /// The physical model of the object: convex parts as points (n, 3) each, mass (kg), centre of mass (3,), inertia about it (3, 3); object frame.
    fn body<'py>(&self, py: Python<'py>) -> PyResult<BodyArrays<'py>> {
        // Prepared together with the scene: the cache is not read again.
        let body = self.mesh.body(None)?;
        let parts = body.parts().iter().map(|hull| table(py, hull.vertices().iter().map(|p| [p.x, p.y, p.z])));
        let properties = body.mass_properties();
        let center = properties.center_of_mass;
        Ok((
            parts.collect::<PyResult<_>>()?,
            properties.mass,
            array(py, vec![center.x, center.y, center.z], &[3])?,
            array(py, row_major(&properties.inertia).to_vec(), &[3, 3])?,
        ))
    }

    /// Feasibility of each pose for the open hand, with an approach of `standoff` metres and `clearance` metres to all obstacles: flags (n,).
    #[pyo3(signature = (poses, preshape, clearance, standoff, num_threads))]
    fn check<'py>(
        &self,
        py: Python<'py>,
        poses: Floats<'_>,
        preshape: Floats<'_>,
        clearance: f64,
        standoff: f64,
        #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
    ) -> PyResult<Array<'py, bool>> {
        let grasps = grasps(&poses, &preshape)?;
        let scene = Arc::clone(&self.core);
        let found = detached(py, num_threads, move || scene.check(&grasps, clearance, standoff))?;
        let flags: Vec<bool> = found.into_iter().map(|found| found == Feasibility::Feasible).collect();
        let count = flags.len();
        array(py, flags, &[count])
    }

    /// Tries every pose, with the object's friction and mass multiplied by `factors` (n, 2); arrays by name.
    #[pyo3(signature = (poses, preshape, factors, config, num_threads))]
    fn simulate<'py>(
        &self,
        py: Python<'py>,
        poses: Floats<'_>,
        preshape: Floats<'_>,
        factors: Floats<'_>,
        config: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let grasps = grasps(&poses, &preshape)?;
        let factors = entries(&factors, "factors", &[Some(grasps.len()), Some(2)])?.as_chunks::<2>().0.to_vec();
        let config: TrialConfig = read_config(config, "TrialConfig")?;
        let progress = Arc::new(Progress::default());
        let (scene, watched) = (Arc::clone(&self.core), Arc::clone(&progress));
        let trials = interruptible(
            py,
            num_threads,
            move || progress.stop(),
            move || run_observed_trials(&scene, &grasps, &factors, config, &watched, Study::new),
        )?;
        outcome_arrays(py, &trials)
    }

    /// Tries every pose with the object's mass multiplied by each of `masses` (k,), after closing once: success and security, (n, k) each.
    #[pyo3(signature = (poses, preshape, masses, config, num_threads))]
    fn simulate_masses<'py>(
        &self,
        py: Python<'py>,
        poses: Floats<'_>,
        preshape: Floats<'_>,
        masses: Floats<'_>,
        config: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
    ) -> PyResult<(Array<'py, bool>, Array<'py, bool>)> {
        let grasps = grasps(&poses, &preshape)?;
        let masses = vector(&masses, "masses")?;
        let config: TrialConfig = read_config(config, "TrialConfig")?;
        let progress = Arc::new(Progress::default());
        let (scene, watched, shape) = (Arc::clone(&self.core), Arc::clone(&progress), [grasps.len(), masses.len()]);
        let rows = interruptible(
            py,
            num_threads,
            move || progress.stop(),
            move || run_loaded_trials(&scene, &grasps, &masses, config, &watched),
        )?;
        let flags = |get: fn(&TrialOutcome) -> bool| array(py, rows.iter().flatten().map(get).collect(), &shape);
        Ok((flags(|outcome| outcome.success)?, flags(|outcome| outcome.secure)?))
    }

    /// Tries every pose under six forces and by a lift; arrays by name.
    #[pyo3(signature = (poses, preshape, config, num_threads))]
    fn forces<'py>(
        &self,
        py: Python<'py>,
        poses: Floats<'_>,
        preshape: Floats<'_>,
        config: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let grasps = grasps(&poses, &preshape)?;
        let config: ForceConfig = read_config(config, "ForceConfig")?;
        let progress = Arc::new(Progress::default());
        let (scene, watched) = (Arc::clone(&self.core), Arc::clone(&progress));
        let outcomes = interruptible(
            py,
            num_threads,
            move || progress.stop(),
            move || run_forces(&scene, &grasps, config, &watched),
        )?;
        force_arrays(py, &outcomes)
    }

    /// Runs one trial with `factors` on friction and mass. Returns its outcome and its trace, a sample every 10 ms (none if the pose is infeasible); arrays by name.
    fn trace<'py>(
        &self,
        py: Python<'py>,
        pose: Floats<'_>,
        preshape: f64,
        factors: [f64; 2],
        config: &Bound<'_, PyAny>,
    ) -> PyResult<(Bound<'py, PyDict>, Bound<'py, PyDict>)> {
        let pose = GraspPose { object_from_hand: isometry(&pose, "pose")?, preshape };
        let config: TrialConfig = read_config(config, "TrialConfig")?;
        let progress = Arc::new(Progress::default());
        let (scene, watched) = (Arc::clone(&self.core), Arc::clone(&progress));
        let trial = interruptible(
            py,
            None,
            move || progress.stop(),
            move || trace_trial(&scene, &pose, factors, config, &watched, Study::new),
        )?;
        let samples = sample_arrays(py, &trial.trace, self.core.template())?;
        Ok((outcome_arrays(py, &[trial])?, samples))
    }
}

/// Outcomes of n grasps by name. The 7 rows of `motions` (shift and turn since the start, then since the hand closed) and of `verdicts` (the
/// same limits) are the pulls and the lift; of the m contacts, `contact_of` is the grasp, and `contacts` has link, point, normal, force and
/// friction.
fn force_arrays<'py>(py: Python<'py>, outcomes: &[ForceOutcome]) -> PyResult<Bound<'py, PyDict>> {
    let n = outcomes.len();
    let numbers = |get: fn(&ForceOutcome) -> f64| array(py, outcomes.iter().map(get).collect(), &[n]);
    let moved = outcomes.iter().flat_map(|o| o.pulls.iter().chain([&o.lift]));
    let motions = moved.clone().flat_map(|m| [m.since_start, m.since_closed]).flat_map(|m| [m.shift, m.turn]).collect();
    let verdicts = moved.flat_map(|m| [m.passes, m.holds]).collect();
    let contacts = outcomes.iter().enumerate().flat_map(|(i, o)| o.contacts.iter().map(move |contact| (i, contact)));
    let (owners, rows): (Vec<i64>, Vec<[f64; 9]>) = contacts
        .map(|(i, c)| {
            let (p, n) = (c.point, c.normal);
            (i as i64, [c.link as f64, p.x, p.y, p.z, n.x, n.y, n.z, c.force, c.friction])
        })
        .unzip();
    let dict = PyDict::new(py);
    dict.set_item("start_depth", numbers(|o| o.start_depth)?)?;
    dict.set_item("closed_depth", numbers(|o| o.closed_depth)?)?;
    dict.set_item("motions", array::<f64>(py, motions, &[n, PULLS + 1, 2, 2])?)?;
    dict.set_item("verdicts", array::<bool>(py, verdicts, &[n, PULLS + 1, 2])?)?;
    dict.set_item("time", numbers(|o| o.time)?)?;
    let count = owners.len();
    dict.set_item("contact_of", array(py, owners, &[count])?)?;
    dict.set_item("contacts", table(py, rows.into_iter())?)?;
    Ok(dict)
}

/// Warns if the object fell over from `start`: poses that were planned for `start` no longer fit.
fn warn_of_toppling(scene: &Core, start: &Isometry3<f64>) {
    /// Greatest tilt of an object that settles without falling over, radians (6 degrees).
    const TILT: f64 = 0.1;
    let moved = scene.world_from_object().rotation * start.rotation.inverse();
    let tilt = (moved * Vector3::z()).angle(&Vector3::z());
    if tilt > TILT {
        tracing::warn!(
            target: "graspbox",
            "object `{}` tilted by {:.0} degrees from its world_from_object before it came to rest; plan with \
             `world_from_object=scene.world_from_object`",
            scene.name(),
            tilt.to_degrees()
        );
    }
}

/// Outcomes and the study's measures as arrays (n,) by name.
fn outcome_arrays<'py>(py: Python<'py>, trials: &[Finished<Study>]) -> PyResult<Bound<'py, PyDict>> {
    let n = &[trials.len()];
    let outcomes: Vec<TrialOutcome> = trials.iter().map(|trial| trial.outcome.clone()).collect();
    let measures: Vec<Measures> =
        trials.iter().map(|trial| trial.observer.as_ref().map_or_else(Measures::default, Study::measures)).collect();
    let numbers = |get: fn(&TrialOutcome) -> f64| array(py, outcomes.iter().map(get).collect(), n);
    let flags = |get: fn(&TrialOutcome) -> bool| array(py, outcomes.iter().map(get).collect::<Vec<bool>>(), n);
    let measured = |get: fn(&Measures) -> f64| array(py, measures.iter().map(get).collect(), n);
    let legacy: Vec<bool> = measures.iter().map(|m| m.reading.is_some_and(|reading| reading.success)).collect();
    let dict = PyDict::new(py);
    dict.set_item("success", flags(|o| o.success)?)?;
    dict.set_item("secure", flags(|o| o.secure)?)?;
    dict.set_item("legacy_success", array(py, legacy, n)?)?;
    dict.set_item("kindness", measured(|m| m.reading.map_or(f64::NAN, |reading| reading.kindness))?)?;
    dict.set_item("kindness_rate", measured(|m| m.kindness_rate)?)?;
    dict.set_item("survives_shake", flags(|o| o.survives_shake.unwrap_or(false))?)?;
    dict.set_item("shake_shift", numbers(|o| o.shake_shift.unwrap_or(f64::NAN))?)?;
    dict.set_item("lift", numbers(|o| o.lift)?)?;
    dict.set_item("time", numbers(|o| o.time)?)?;
    let counts = outcomes.iter().map(|o| o.unconverged_steps as i64).collect::<Vec<i64>>();
    dict.set_item("unconverged_steps", array(py, counts, n)?)?;
    let names = outcomes.iter().map(|o| o.failure.map_or("", FailureKind::name)).collect::<Vec<_>>();
    dict.set_item("failure", names)?;
    Ok(dict)
}

fn sample_arrays<'py>(py: Python<'py>, samples: &[Sample], template: &Template) -> PyResult<Bound<'py, PyDict>> {
    let (n, hand, others) = (samples.len(), template.hand(), template.object_count() - 1);
    let numbers = |get: fn(&Sample) -> f64| array(py, samples.iter().map(get).collect(), &[n]);
    let dict = PyDict::new(py);
    dict.set_item("time", numbers(|s| s.time)?)?;
    dict.set_item("distance", numbers(|s| s.distance)?)?;
    dict.set_item("hand_force", numbers(|s| s.hand_force)?)?;
    dict.set_item("world_from_hand", matrices(py, samples.iter().map(|s| s.world_from_hand))?)?;
    dict.set_item("world_from_object", matrices(py, samples.iter().map(|s| s.world_from_object))?)?;
    let poses: Vec<Isometry3<f64>> = samples.iter().flat_map(|s| s.world_from_others.iter().copied()).collect();
    dict.set_item("world_from_others", matrix_rows(py, &poses, [n, others])?)?;
    let rows = |name: &str, width: usize, get: fn(&Sample) -> &Vec<f64>| {
        let values = samples.iter().flat_map(|s| get(s).iter().copied()).collect();
        dict.set_item(name, array::<f64>(py, values, &[n, width])?)
    };
    rows("joints", hand.coordinates().count(), |s| &s.joints)?;
    rows("actuators", hand.actuators.len(), |s| &s.actuators)?;
    rows("loads", hand.actuators.len(), |s| &s.loads)?;
    rows("tensions", hand.tendons.len(), |s| &s.tensions)?;
    rows("tactile", hand.sensors.len(), |s| &s.tactile)?;
    contact_arrays(py, samples, hand, &dict)?;
    Ok(dict)
}

/// The contacts of all samples, one row each: forces on the object, world frame.
fn contact_arrays(
    py: Python<'_>,
    samples: &[Sample],
    hand: &graspbox_hand::Hand,
    dict: &Bound<'_, PyDict>,
) -> PyResult<()> {
    let found = || samples.iter().enumerate().flat_map(|(row, s)| s.contacts.iter().map(move |c| (row, s, c)));
    let count = found().count();
    let first_shape = |link: usize| hand.links[..link].iter().map(|l| l.colliders.len()).sum::<usize>();
    let vectors = |get: fn(&Sample, &HandContact) -> Vector3<f64>| {
        array::<f64>(py, found().flat_map(|(_, s, c)| <[f64; 3]>::from(get(s, c))).collect(), &[count, 3])
    };
    let indices = |values: Vec<i64>| array(py, values, &[count]);
    dict.set_item("contact_samples", indices(found().map(|(row, ..)| row as i64).collect())?)?;
    let shapes = found().map(|(.., c)| (first_shape(c.link) + c.shape) as i64);
    dict.set_item("contact_shapes", indices(shapes.collect())?)?;
    dict.set_item("contact_points", vectors(|s, c| (s.world_from_hand * c.point).coords)?)?;
    dict.set_item("contact_normals", vectors(|s, c| s.world_from_hand * -c.normal)?)?;
    dict.set_item("contact_forces", vectors(|s, c| s.world_from_hand * -(c.normal * c.force + c.friction_force))?)
}
