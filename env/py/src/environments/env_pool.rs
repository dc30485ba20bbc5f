//! `graspbox._core.EnvPool`: many environments in one call; `Objects`: the objects that they sample.

use crate::arm::Arm;
use crate::convert::{Array, Floats, array, entries, isometry, matrix, read_config, to_python};
use crate::environments::env_arrays::arrays;
use crate::errors::CoreError;
use crate::gil::{awaited, detached, interruptible};
use crate::hand::Hand;
use crate::layout::put_poses;
use crate::mesh::{Mesh, MeshData};
use graspbox_gym::pool::env_pool::StepBatches;
use graspbox_gym::rewards::goal_terms::{GOAL_TERMS, goal_terms};
use graspbox_gym::starts::initial_samples::InitialSamples;
use graspbox_gym::starts::random_stream::RandomStream;
use graspbox_gym::{
    self as gym, Batch, EnvConfig, EnvError, ObjectDescription, ResetOptions, RobotArm, Source, Tables,
};
use graspbox_sim::PhysicsConfig;
use numpy::{PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use rayon::prelude::*;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};

/// An input array of float32.
type FloatArray<'py> = PyReadonlyArrayDyn<'py, f32>;

#[derive(FromPyObject)]
enum Given<'py> {
    Mesh(PyRef<'py, Mesh>),
    Description(Bound<'py, PyAny>),
}

/// A handle on objects that environments share; each is prepared at first use.
#[pyclass(frozen, weakref, module = "graspbox._core")]
pub struct Objects(Arc<gym::Objects>);

#[pymethods]
impl Objects {
    /// Takes meshes, or descriptions (`name`, and `path` or `family` and `seed`; `scale`, `mass`). `base` is the pose (4, 4) of the arm's base.
    #[new]
    #[pyo3(signature = (sources, hand, physics, cache, arm=None, base=None))]
    fn new(
        sources: Vec<Given<'_>>,
        hand: &Hand,
        physics: &Bound<'_, PyAny>,
        cache: Option<PathBuf>,
        arm: Option<&Arm>,
        base: Option<Floats<'_>>,
    ) -> PyResult<Self> {
        let physics: PhysicsConfig = read_config(physics, "PhysicsConfig")?;
        let source = |given: Given<'_>| match given {
            Given::Mesh(mesh) => Ok(Source::Given(Arc::new(mesh.0.spec.clone()))),
            Given::Description(values) => Ok(read_config::<ObjectDescription>(&values, "an object")?.try_into()?),
        };
        let sources = sources.into_iter().map(source).collect::<Result<Vec<_>, CoreError>>()?;
        let base = base.map(|pose| isometry(&pose, "base")).transpose()?;
        let mut objects = gym::Objects::new(sources, Arc::clone(&hand.0), physics, cache).map_err(CoreError::from)?;
        if let Some(arm) = arm {
            objects = objects.on_arm(Arc::clone(&arm.core), base).map_err(CoreError::from)?;
        }
        Ok(Self(Arc::new(objects)))
    }

    #[getter]
    fn names(&self) -> Vec<&str> {
        self.0.names().collect()
    }

    /// Pose of the arm's base, (4, 4); None without an arm.
    #[getter]
    fn world_from_arm<'py>(&self, py: Python<'py>) -> PyResult<Option<Array<'py, f64>>> {
        self.0.arm().map(|arm| matrix(py, &arm.world_from_base)).transpose()
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    /// Prepares objects in all resting poses, with their render models if `model` is true.
    fn prepare(
        &self,
        py: Python<'_>,
        indices: Vec<usize>,
        model: bool,
        #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
    ) -> PyResult<()> {
        let objects = Arc::clone(&self.0);
        let (stopped, stop) = stopper();
        interruptible(py, num_threads, stop, move || {
            let each = indices.into_par_iter().with_max_len(1);
            each.try_for_each(|index| match stopped.load(Ordering::Acquire) {
                true => Err(CoreError::Interrupted),
                false => Ok(objects.prepare(index, model)?),
            })
        })
    }

    fn __repr__(&self) -> String {
        format!("Objects({} objects)", self.0.len())
    }
}

/// A received environment, with the results of its step.
type Arrival = (usize, Result<StepBatches, CoreError>);

/// A pool of environments.
#[pyclass(frozen, module = "graspbox._core")]
pub struct EnvPool {
    pub(crate) core: Arc<gym::EnvPool>,
    pub(crate) num_threads: Option<usize>,
    sender: Mutex<Sender<Arrival>>,
    arrivals: Mutex<Receiver<Arrival>>,
}

/// Results of a call: arrays of every environment, and of the ended episodes if any ended and was followed by the next in the call.
type Rows<'py> = (Bound<'py, PyDict>, Option<Bound<'py, PyDict>>);

#[pymethods]
impl EnvPool {
    #[new]
    #[pyo3(signature = (objects, config, num_envs, num_threads))]
    fn new(
        objects: &Objects,
        config: &Bound<'_, PyAny>,
        num_envs: usize,
        #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
    ) -> PyResult<Self> {
        let config: EnvConfig = read_config(config, "EnvConfig")?;
        let core = gym::EnvPool::new(Arc::clone(&objects.0), config, num_envs).map_err(CoreError::from)?;
        crate::gil::thread_count(num_threads)?;
        let (sender, arrivals) = channel();
        Ok(Self { core: Arc::new(core), num_threads, sender: Mutex::new(sender), arrivals: Mutex::new(arrivals) })
    }

    #[getter]
    fn num_envs(&self) -> usize {
        self.core.len()
    }

    /// Begins new episodes where `mask` is true; `options`: none, one for all environments, or one per environment.
    #[pyo3(signature = (seeds=None, mask=None, options=None, out=None))]
    fn reset<'py>(
        &self,
        py: Python<'py>,
        seeds: Option<Vec<Option<u64>>>,
        mask: Option<PyReadonlyArrayDyn<'py, bool>>,
        options: Option<Vec<Bound<'py, PyAny>>>,
        out: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let count = self.core.len();
        let seeds = seeds.unwrap_or_else(|| vec![None; count]);
        let mask = mask.map(|m| entries(&m, "the reset mask", &[Some(count)]).map(<[bool]>::to_vec));
        let mask = mask.transpose()?;
        let options: Vec<ResetOptions> = match options {
            None => vec![ResetOptions::default()],
            Some(given) => {
                given.iter().map(|options| read_config(options, "reset options")).collect::<Result<_, _>>()?
            }
        };
        let core = Arc::clone(&self.core);
        let (stopped, stop) = stopper();
        let batch = interruptible(py, self.num_threads, stop, move || {
            core.reset_until(&stopped, &seeds, mask.as_deref(), &options)
        })?;
        arrays(py, self.core.spec(), batch, out)
    }

    /// Steps every environment; `actions` is (num_envs, action) float32.
    #[pyo3(signature = (actions, out=None))]
    fn step<'py>(
        &self,
        py: Python<'py>,
        actions: FloatArray<'py>,
        out: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Rows<'py>> {
        let actions = self.actions(&actions, self.core.len())?;
        let core = Arc::clone(&self.core);
        let (stopped, stop) = stopper();
        let stepped = interruptible(py, self.num_threads, stop, move || core.step_until(&stopped, &actions))?;
        self.rows(py, stepped, out)
    }

    /// Starts steps of environments; `recv` returns them in the order in which they finish.
    fn send(&self, py: Python<'_>, actions: FloatArray<'_>, envs: Vec<usize>) -> PyResult<()> {
        let actions = self.actions(&actions, envs.len())?;
        let sender = self.sender.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let core = Arc::clone(&self.core);
        detached(py, self.num_threads, move || {
            core.send(&envs, &actions, move |env, result| {
                // There is no receiver once the pool has been dropped.
                drop(sender.send((env, result.map_err(CoreError::from))));
            })
        })
    }

    /// The next `count` environments that finish, in the format of [`EnvPool::step`]; the array `env` contains their indices.
    ///
    /// A signal cancels steps that have not begun; their environments are unchanged.
    #[pyo3(signature = (count))]
    fn recv<'py>(&self, py: Python<'py>, count: usize) -> PyResult<Rows<'py>> {
        let away = self.core.away();
        if count == 0 || count > away {
            return Err(CoreError::Config(format!("count is {count}; {away} steps are pending")).into());
        }
        let mut arrived = Vec::with_capacity(count);
        if let Err(error) = self.gather(py, &mut arrived, count) {
            // Environments that have finished already are kept for the next call.
            let sender = self.sender.lock().unwrap_or_else(PoisonError::into_inner);
            for (env, stepped) in arrived {
                drop(sender.send((env, Ok(stepped))));
            }
            return Err(error);
        }
        let spec = self.core.spec();
        let (mut now, mut last) = (Batch::new(spec, count), Batch::new(spec, 0));
        for (env, stepped) in arrived {
            self.core.arrived(env);
            now.append(stepped.now);
            last.append(stepped.last);
        }
        self.rows(py, StepBatches { now, last }, None)
    }

    /// The present results of every environment.
    fn now<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        arrays(py, self.core.spec(), self.core.now(), None)
    }

    /// The complete state of an environment.
    fn get_state<'py>(&self, py: Python<'py>, env: usize) -> PyResult<Bound<'py, PyBytes>> {
        let core = Arc::clone(&self.core);
        let bytes = detached(py, self.num_threads, move || core.env(env)?.save(core.spec(), env))?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// Restores a state from `get_state`. Returns the arrays of that environment only.
    fn set_state<'py>(&self, py: Python<'py>, env: usize, state: &[u8]) -> PyResult<Bound<'py, PyDict>> {
        let (core, state) = (Arc::clone(&self.core), state.to_vec());
        let batch = detached(py, self.num_threads, move || core.restore(env, &state))?;
        arrays(py, self.core.spec(), batch, None)
    }

    /// Object (world_from_object), hand (world_from_hand) and the arm's estimate of the hand, (num_envs, 4, 4) each.
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<[Array<'py, f64>; 3]> {
        let mut poses = [const { Vec::new() }; 3];
        for env in 0..self.core.len() {
            let locked = self.core.env(env).map_err(CoreError::from)?;
            let episode = locked.episode().ok_or(EnvError::NotReset { env }).map_err(CoreError::from)?;
            let world = episode.episode().world();
            poses[0].push(world.world_from_object());
            poses[1].push(world.world_from_hand());
            poses[2].push(*episode.arm().estimated_pose());
        }
        let [object, hand, believed] = poses.map(|p| crate::convert::matrices(py, p.into_iter()));
        Ok([object?, hand?, believed?])
    }

    /// The objects of an environment: their handles, indices in the set (k,) and poses (k, 4, 4), the target's place among them (None without
    /// one), and the walls as in `arrange`.
    fn scene<'py>(&self, py: Python<'py>, env: usize) -> PyResult<Bound<'py, PyDict>> {
        let locked = self.core.env(env).map_err(CoreError::from)?;
        let episode = locked.episode().ok_or(EnvError::NotReset { env }).map_err(CoreError::from)?;
        let bodies = episode.objects().map(|object| Mesh(Arc::new(MeshData::of_body(object.prepared.body().clone()))));
        let dict = PyDict::new(py);
        dict.set_item("meshes", bodies.collect::<Vec<_>>())?;
        let indices: Vec<i64> = episode.objects().map(|object| object.index as i64).collect();
        let count = indices.len();
        dict.set_item("objects", array(py, indices, &[count])?)?;
        let scene = episode.episode().scene();
        dict.set_item("target", (!scene.is_any_target()).then(|| scene.target()))?;
        put_poses(
            py,
            &dict,
            episode.episode().world().world_from_objects(),
            &self.core.spec().config.clutter.walls().map_err(CoreError::from)?,
        )?;
        Ok(dict)
    }

    fn __repr__(&self) -> String {
        format!("EnvPool({} environments)", self.core.len())
    }
}

/// A flag for one call, and the function that sets it after a signal: environments that the call has not reached by then are unchanged.
fn stopper() -> (Arc<AtomicBool>, impl FnOnce()) {
    let flag = Arc::new(AtomicBool::new(false));
    let set = Arc::clone(&flag);
    (flag, move || set.store(true, Ordering::Release))
}

impl Drop for EnvPool {
    fn drop(&mut self) {
        self.core.call_back();
    }
}

impl EnvPool {
    /// Waits until `count` environments have finished; a signal cancels steps that have not begun.
    fn gather(&self, py: Python<'_>, arrived: &mut Vec<(usize, StepBatches)>, count: usize) -> PyResult<()> {
        while arrived.len() < count {
            match awaited(py, &self.arrivals) {
                Ok(Some((env, Ok(stepped)))) => arrived.push((env, stepped)),
                Ok(Some((env, Err(error)))) => {
                    self.core.arrived(env);
                    return Err(error.into());
                }
                Ok(None) => {
                    // Received environments still count as pending. Another thread may have cancelled the steps that this one awaits.
                    let away = self.core.away();
                    if away < count {
                        return Err(CoreError::from(EnvError::Cancelled { count, pending: away }).into());
                    }
                }
                Err(signal) => {
                    self.core.call_back();
                    return Err(signal);
                }
            }
        }
        Ok(())
    }

    fn actions(&self, actions: &FloatArray<'_>, rows: usize) -> Result<Vec<f32>, CoreError> {
        let shape = [Some(rows), Some(self.core.spec().action)];
        entries(actions, "actions", &shape).map(<[f32]>::to_vec)
    }

    fn rows<'py>(
        &self,
        py: Python<'py>,
        stepped: StepBatches,
        out: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Rows<'py>> {
        let spec = self.core.spec();
        let last = (!stepped.last.is_empty()).then(|| arrays(py, spec, stepped.last, None));
        Ok((arrays(py, spec, stepped.now, out)?, last.transpose()?))
    }
}

/// The tables of all inputs and outputs of the environments of a hand.
#[pyfunction]
#[pyo3(signature = (hand, arm=None))]
pub fn env_tables<'py>(py: Python<'py>, hand: &Hand, arm: Option<&Arm>) -> PyResult<Bound<'py, PyAny>> {
    let hand = carried(hand, arm)?;
    to_python(py, &Tables::new(&hand))
}

/// A hand as environments have it, on an arm if there is one.
pub(crate) fn carried(hand: &Hand, arm: Option<&Arm>) -> Result<Arc<graspbox_hand::Hand>, CoreError> {
    match arm {
        Some(arm) => Ok(RobotArm::new(Arc::clone(&arm.core), &hand.0, None)?.1),
        None => Ok(Arc::clone(&hand.0)),
    }
}

/// Reward terms (n, 2) of goals: 0 or -1, and minus the distance.
#[pyfunction]
pub fn goal_rewards<'py>(
    py: Python<'py>,
    achieved: FloatArray<'py>,
    desired: FloatArray<'py>,
    threshold: f64,
) -> PyResult<Array<'py, f32>> {
    let rows = achieved.shape().first().copied().unwrap_or(0);
    let shape = [Some(rows), Some(3)];
    let (achieved, desired) =
        (entries(&achieved, "achieved_goal", &shape)?, entries(&desired, "desired_goal", &shape)?);
    let pairs = achieved.as_chunks::<3>().0.iter().zip(desired.as_chunks::<3>().0);
    let terms = pairs.flat_map(|(a, b)| goal_terms(a, b, threshold).into_iter().take(GOAL_TERMS.len()));
    array(py, terms.collect(), &[rows, GOAL_TERMS.len()])
}

/// Indices of the objects, below `count`, that environments sample at a reset with each of the seeds.
#[pyfunction]
pub fn sampled_objects(seeds: Vec<u64>, count: usize) -> Vec<usize> {
    seeds.into_iter().map(|seed| InitialSamples::new(&mut RandomStream::new(seed), count).object).collect()
}
