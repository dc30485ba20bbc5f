//! Perception: noise of depth images, crops around the object, candidate grasps, voxels around the hand.

use crate::convert::{self, Array, Floats, array, entries, isometries, matrices, read_config};
use crate::errors::CoreError;
use crate::gil::detached;
use crate::hand::Hand;
use crate::images::vision::lens;
use crate::mesh::Mesh;
use graspbox_perception::{
    CHANNEL_NAMES, CHANNELS, CropConfig, CropVolume, DepthNoise, HAND_CHANNEL_NAMES, HAND_CHANNELS, HandGrid,
    HandGridConfig, ProposalConfig, add_depth_noise as add_noise, fill_channels, groups, hand_crops, heights, levers,
    observe, obstacle_points, propose, solid,
};
use graspbox_render::Camera;
use nalgebra::{Isometry3, Point3};
use numpy::{PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use std::sync::Arc;

/// An input array of flags, of any shape.
type Flags<'py> = PyReadonlyArrayDyn<'py, bool>;
/// An input array of bytes, of any shape.
type Bytes<'py> = PyReadonlyArrayDyn<'py, u8>;

/// Names of the channels of crops, and of those around the hand.
#[pyfunction]
pub fn channel_names() -> (Vec<&'static str>, Vec<&'static str>) {
    (CHANNEL_NAMES.to_vec(), HAND_CHANNEL_NAMES.to_vec())
}

/// Checks that the length of `what` is `wanted`.
fn same(what: &str, length: usize, wanted: usize) -> Result<(), CoreError> {
    if length == wanted {
        return Ok(());
    }
    Err(CoreError::Config(format!("{what} has length {length}; give {wanted}, one for each")))
}

/// Adds the noise of a camera to rendered depth images (n, H, W): uint16 millimetres, 0 for no depth.
#[pyfunction]
#[pyo3(signature = (depth, intrinsics, seeds, noise, num_threads))]
pub fn add_depth_noise<'py>(
    py: Python<'py>,
    depth: PyReadonlyArrayDyn<'py, f32>,
    intrinsics: Floats<'py>,
    seeds: Vec<u64>,
    noise: &Bound<'_, PyAny>,
    #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
) -> PyResult<Array<'py, u16>> {
    let noise: DepthNoise = read_config(noise, "DepthNoise")?;
    let values = entries(&depth, "depth", &[None, None, None])?.to_vec();
    let shape = depth.shape().to_vec();
    same("seeds", seeds.len(), shape[0])?;
    let lens = lens(&intrinsics, shape[1] as u32, shape[2] as u32)?;
    let images = detached(py, num_threads, move || add_noise(&values, &lens, &seeds, &noise))?;
    array(py, images, &shape)
}

/// Crops around the object of depth images (n, H, W), whose pixels, and those of the crop's middle, may be `marked`: `world_from_crop`
/// (n, 4, 4), `found` (n,), `object` (n, H, W), and `channels` (n, 3, N, N, N) uint8. Where no object is found, the pose is the identity and the channels are 0.
#[pyfunction]
#[pyo3(signature = (depth, intrinsics, world_from_camera, marked, crop, num_threads))]
pub fn crops<'py>(
    py: Python<'py>,
    depth: PyReadonlyArrayDyn<'py, f32>,
    intrinsics: Floats<'py>,
    world_from_camera: Floats<'py>,
    marked: (Option<Flags<'py>>, Option<Flags<'py>>),
    crop: &Bound<'_, PyAny>,
    #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
) -> PyResult<Bound<'py, PyDict>> {
    let crop: CropConfig = read_config(crop, "CropConfig")?;
    let values = entries(&depth, "depth", &[None, None, None])?.to_vec();
    let shape = depth.shape().to_vec();
    let [count, height, width] = [shape[0], shape[1], shape[2]];
    let sides = [Some(count), Some(height), Some(width)];
    let flags = |flags: Option<Flags<'_>>, name: &str| {
        flags.map(|flags| entries(&flags, name, &sides).map(<[bool]>::to_vec)).transpose()
    };
    let (labels, middle) = (flags(marked.0, "labels")?, flags(marked.1, "middle")?);
    let cameras = isometries(&world_from_camera, "world_from_camera")?;
    same("world_from_camera", cameras.len(), count)?;
    let lens = lens(&intrinsics, height as u32, width as u32)?;
    let (poses, found, object, channels) = detached(py, num_threads, move || {
        let grid = crop.grid()?;
        let (pixels, size) = (height * width, CHANNELS * grid.len());
        let mut channels = vec![0_u8; size * count];
        let one = |(index, out): (usize, &mut [u8])| -> Result<_, CoreError> {
            let camera = Camera::new(lens, cameras[index])?;
            let depth = &values[index * pixels..(index + 1) * pixels];
            let [labels, middle] =
                [&labels, &middle].map(|all| all.as_ref().map(|all| &all[index * pixels..(index + 1) * pixels]));
            let observed = observe(&camera, depth, labels, middle, &crop)?;
            if let Some(pose) = &observed.world_from_crop {
                fill_channels(&grid, pose, &camera, depth, &observed, out);
            }
            Ok(observed)
        };
        let observed: Vec<_> = channels.par_chunks_mut(size).enumerate().map(one).collect();
        let observed = observed.into_iter().collect::<Result<Vec<_>, CoreError>>()?;
        let found: Vec<bool> = observed.iter().map(|o| o.world_from_crop.is_some()).collect();
        let poses: Vec<_> = observed.iter().map(|o| o.world_from_crop.unwrap_or_else(Isometry3::identity)).collect();
        let object = observed.into_iter().flat_map(|o| o.object).collect::<Vec<bool>>();
        Ok::<_, CoreError>((poses, found, object, channels))
    })?;
    let n = crop.resolution;
    let dict = PyDict::new(py);
    dict.set_item("world_from_crop", matrices(py, poses.into_iter())?)?;
    dict.set_item("found", array(py, found, &[count])?)?;
    dict.set_item("object", array(py, object, &shape)?)?;
    dict.set_item("channels", array(py, channels, &[count, CHANNELS, n, n, n])?)?;
    Ok(dict)
}

/// Height of each pixel of a depth image (H, W) above the table, metres: the median of it and its neighbours; NaN without depth.
#[pyfunction]
#[pyo3(signature = (depth, intrinsics, world_from_camera))]
pub fn pixel_heights<'py>(
    py: Python<'py>,
    depth: PyReadonlyArrayDyn<'py, f32>,
    intrinsics: Floats<'py>,
    world_from_camera: Floats<'py>,
) -> PyResult<Array<'py, f32>> {
    let values = entries(&depth, "depth", &[None, None])?.to_vec();
    let camera = camera_of(depth.shape(), &intrinsics, &world_from_camera)?;
    let found = detached(py, None, move || heights(&camera, &values))?;
    array(py, found, depth.shape())
}

/// Groups of the chosen pixels (H, W) of a depth image that lie at most `gap` apart in plan view: 1 for the largest, 0 for other pixels.
#[pyfunction]
#[pyo3(signature = (depth, intrinsics, world_from_camera, chosen, gap))]
pub fn pixel_groups<'py>(
    py: Python<'py>,
    depth: PyReadonlyArrayDyn<'py, f32>,
    intrinsics: Floats<'py>,
    world_from_camera: Floats<'py>,
    chosen: PyReadonlyArrayDyn<'py, bool>,
    gap: f64,
) -> PyResult<Array<'py, u32>> {
    let values = entries(&depth, "depth", &[None, None])?.to_vec();
    let sides = [Some(depth.shape()[0]), Some(depth.shape()[1])];
    let chosen = entries(&chosen, "chosen", &sides)?.to_vec();
    let camera = camera_of(depth.shape(), &intrinsics, &world_from_camera)?;
    let found = detached(py, None, move || groups(&camera, &values, &chosen, gap))?;
    array(py, found, depth.shape())
}

/// The camera of one image.
fn camera_of(shape: &[usize], intrinsics: &Floats<'_>, world_from_camera: &Floats<'_>) -> PyResult<Camera> {
    let lens = lens(intrinsics, shape[0] as u32, shape[1] as u32)?;
    Ok(Camera::new(lens, convert::isometry(world_from_camera, "world_from_camera")?).map_err(CoreError::from)?)
}

/// Share of each voxel of n crops that an object fills: (n, N, N, N) uint8. Crop i contains mesh `mesh_of[i]` at `crop_from_object[i]`.
#[pyfunction]
#[pyo3(signature = (meshes, mesh_of, crop_from_object, crop, num_threads))]
pub fn solids<'py>(
    py: Python<'py>,
    meshes: Vec<PyRef<'py, Mesh>>,
    mesh_of: Vec<usize>,
    crop_from_object: Floats<'py>,
    crop: &Bound<'_, PyAny>,
    #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
) -> PyResult<Array<'py, u8>> {
    let crop: CropConfig = read_config(crop, "CropConfig")?;
    let poses = isometries(&crop_from_object, "crop_from_object")?;
    same("mesh_of", mesh_of.len(), poses.len())?;
    if let Some(index) = mesh_of.iter().find(|index| **index >= meshes.len()) {
        return Err(CoreError::Config(format!("mesh_of holds {index}; there are {} meshes", meshes.len())).into());
    }
    let meshes: Vec<_> = meshes.iter().map(|mesh| Arc::clone(&mesh.0)).collect();
    let (count, n) = (poses.len(), crop.resolution);
    let filled = detached(py, num_threads, move || {
        let grid = crop.grid()?;
        let one = |(mesh, pose): (&usize, &Isometry3<f64>)| solid(&meshes[*mesh].spec.mesh, pose, &grid);
        let filled: Vec<_> = mesh_of.par_iter().zip(&poses).map(one).collect();
        Ok::<_, CoreError>(filled.into_iter().collect::<Result<Vec<_>, _>>()?.concat())
    })?;
    array(py, filled, &[count, n, n, n])
}

/// The volumes that a hand sweeps in a grid around it, prepared for perception.
#[pyclass(frozen, module = "graspbox._core")]
pub struct HandVolumes {
    core: Arc<HandGrid>,
}

impl HandVolumes {
    /// Poses in a crop with the preshape nearest to each number.
    fn grasps(&self, poses: &Floats<'_>, preshape: &Floats<'_>) -> Result<Vec<(Isometry3<f64>, usize)>, CoreError> {
        let poses = isometries(poses, "poses")?;
        let preshape = crate::convert::vector(preshape, "preshape")?;
        same("preshape", preshape.len(), poses.len())?;
        Ok(poses.into_iter().zip(preshape).map(|(pose, number)| (pose, self.core.nearest(number))).collect())
    }
}

/// The occupancy (N, N, N) of a crop.
fn occupancy_of(occupancy: &Bytes<'_>, name: &str, crop: &CropConfig) -> Result<Vec<u8>, CoreError> {
    Ok(entries(occupancy, name, &[Some(crop.resolution); 3])?.to_vec())
}

/// Points (k, 3) that the open hand must not touch.
fn obstacles_of(obstacles: &Floats<'_>) -> PyResult<Vec<Point3<f32>>> {
    Ok(convert::points(obstacles, "obstacles")?.iter().map(|point| point.cast::<f32>()).collect())
}

#[pymethods]
impl HandVolumes {
    /// Prepares `hand`.
    #[new]
    fn new(py: Python<'_>, hand: &Hand, config: &Bound<'_, PyAny>) -> PyResult<Self> {
        let settings: HandGridConfig = read_config(config, "HandGridConfig")?;
        let hand = Arc::clone(&hand.0);
        let core = detached(py, None, move || HandGrid::new(&hand, &settings))?;
        Ok(Self { core: Arc::new(core) })
    }

    /// Cells along the axes of the hand frame.
    #[getter]
    fn shape(&self) -> [usize; 3] {
        self.core.cells.shape
    }

    /// Least corner (3,), hand frame, metres.
    #[getter]
    fn origin<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        array(py, self.core.cells.origin.coords.as_slice().to_vec(), &[3])
    }

    /// Side of a cell, metres.
    #[getter]
    fn cell(&self) -> f64 {
        self.core.cells.cell
    }

    /// The hand's preshapes (p,), in the order of its file.
    #[getter]
    fn preshapes<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, f64>> {
        let all: Vec<f64> = self.core.preshapes().collect();
        let count = all.len();
        array(py, all, &[count])
    }

    /// Swept volume of the fingers with each preshape, (p, X, Y, Z) uint8: 255 at the open fingers, 64 at their last positions, 0 elsewhere.
    #[getter]
    fn swept<'py>(&self, py: Python<'py>) -> PyResult<Array<'py, u8>> {
        let count = self.core.preshapes().len();
        let [x, y, z] = self.shape();
        array(py, (0..count).flat_map(|index| self.core.swept(index).to_vec()).collect(), &[count, x, y, z])
    }

    /// Index of the preshape nearest to each number (n,).
    fn nearest<'py>(&self, py: Python<'py>, preshape: Floats<'_>) -> PyResult<Array<'py, i64>> {
        let numbers = crate::convert::vector(&preshape, "preshape")?;
        let count = numbers.len();
        array(py, numbers.into_iter().map(|number| self.core.nearest(number) as i64).collect(), &[count])
    }

    /// Candidate grasps of an occupancy (N, N, N): `poses` (m, 4, 4) crop_from_hand, `preshape` (m,), and `source`, a list of m names.
    /// The open hand touches neither it, nor the occupancy `whole` (N, N, N), nor the points `obstacles` (k, 3).
    #[pyo3(signature = (occupancy, crop, config, whole, obstacles, num_threads))]
    #[expect(clippy::too_many_arguments, reason = "every array crosses by itself")]
    fn propose<'py>(
        &self,
        py: Python<'py>,
        occupancy: Bytes<'_>,
        crop: &Bound<'_, PyAny>,
        config: &Bound<'_, PyAny>,
        whole: Option<Bytes<'_>>,
        obstacles: Floats<'_>,
        #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let crop: CropConfig = read_config(crop, "CropConfig")?;
        let settings: ProposalConfig = read_config(config, "ProposalConfig")?;
        let occupancy = occupancy_of(&occupancy, "occupancy", &crop)?;
        let whole = whole.map(|whole| occupancy_of(&whole, "whole", &crop)).transpose()?;
        let mut obstacles = obstacles_of(&obstacles)?;
        let core = Arc::clone(&self.core);
        let found = detached(py, num_threads, move || {
            let grid = crop.grid()?;
            if let Some(whole) = whole {
                obstacles.extend(obstacle_points(&grid, &whole, settings.points));
            }
            propose(&core, &grid, &occupancy, &obstacles, &settings)
        })?;
        let numbers: Vec<f64> = self.core.preshapes().collect();
        let count = found.len();
        let dict = PyDict::new(py);
        dict.set_item("poses", matrices(py, found.iter().map(|candidate| candidate.pose))?)?;
        let preshape = found.iter().map(|candidate| numbers[candidate.preshape]).collect();
        dict.set_item("preshape", array(py, preshape, &[count])?)?;
        dict.set_item("source", found.iter().map(|candidate| candidate.source.name()).collect::<Vec<_>>())?;
        Ok(dict)
    }

    /// Feasibility of each pose (n, 4, 4) for the open hand, and the number of chains that meet the object as they close: flags and counts (n,).
    /// `obstacles` (k, 3) are points that the open hand must not touch either.
    #[pyo3(signature = (occupancy, crop, points, obstacles, poses, preshape, num_threads))]
    #[expect(clippy::too_many_arguments, reason = "every array crosses by itself")]
    fn meets<'py>(
        &self,
        py: Python<'py>,
        occupancy: Bytes<'_>,
        crop: &Bound<'_, PyAny>,
        points: usize,
        obstacles: Floats<'_>,
        poses: Floats<'_>,
        preshape: Floats<'_>,
        #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
    ) -> PyResult<(Array<'py, bool>, Array<'py, i64>)> {
        let crop: CropConfig = read_config(crop, "CropConfig")?;
        let occupancy = occupancy_of(&occupancy, "occupancy", &crop)?;
        let grasps = self.grasps(&poses, &preshape)?;
        let obstacles = obstacles_of(&obstacles)?;
        let core = Arc::clone(&self.core);
        let met = detached(py, num_threads, move || {
            let points = obstacle_points(&crop.grid()?, &occupancy, points);
            let met = grasps.par_iter().map(|(pose, preshape)| core.meets(&points, &obstacles, pose, *preshape));
            Ok::<_, CoreError>(met.collect::<Vec<_>>())
        })?;
        let free = array(py, met.iter().map(|met| met.free).collect(), &[met.len()])?;
        Ok((free, array(py, met.iter().map(|met| i64::from(met.chains.count_ones())).collect(), &[met.len()])?))
    }

    /// Horizontal distance from the fingertips at each pose (m, 4, 4) to the middle of the surface near them: (m,) metres.
    #[pyo3(signature = (occupancy, crop, poses, preshape, num_threads))]
    fn levers<'py>(
        &self,
        py: Python<'py>,
        occupancy: Bytes<'_>,
        crop: &Bound<'_, PyAny>,
        poses: Floats<'_>,
        preshape: Floats<'_>,
        #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
    ) -> PyResult<Array<'py, f64>> {
        let crop: CropConfig = read_config(crop, "CropConfig")?;
        let occupancy = occupancy_of(&occupancy, "occupancy", &crop)?;
        let grasps = self.grasps(&poses, &preshape)?;
        let (core, count) = (Arc::clone(&self.core), grasps.len());
        let found =
            detached(py, num_threads, move || Ok::<_, CoreError>(levers(&core, &crop.grid()?, &occupancy, &grasps)))?;
        array(py, found, &[count])
    }

    /// Voxels around the hand at m poses: (m, 4, X, Y, Z) uint8.
    ///
    /// `channels` (s, 3, N, N, N) are completed, surface and unseen of s crops; pose i (m, 4, 4) is in crop `crop_of[i]`.
    #[pyo3(signature = (channels, crop, crop_of, poses, num_threads))]
    fn crops<'py>(
        &self,
        py: Python<'py>,
        channels: Bytes<'_>,
        crop: &Bound<'_, PyAny>,
        crop_of: Vec<usize>,
        poses: Floats<'_>,
        #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
    ) -> PyResult<Array<'py, u8>> {
        let crop: CropConfig = read_config(crop, "CropConfig")?;
        let n = Some(crop.resolution);
        let values = entries(&channels, "channels", &[None, Some(3), n, n, n])?.to_vec();
        let poses = isometries(&poses, "poses")?;
        same("crop_of", crop_of.len(), poses.len())?;
        let (crops, count) = (channels.shape()[0], poses.len());
        if let Some(index) = crop_of.iter().find(|index| **index >= crops) {
            return Err(CoreError::Config(format!("crop_of holds {index}; there are {crops} crops")).into());
        }
        let core = Arc::clone(&self.core);
        let made = detached(py, num_threads, move || {
            let grid = crop.grid()?;
            let volume = |values: &[u8]| {
                let (completed, rest) = values.split_at(grid.len());
                let (surface, unseen) = rest.split_at(grid.len());
                CropVolume::new(&grid, [completed, surface, unseen])
            };
            let volumes: Vec<_> = values.par_chunks(3 * grid.len()).map(volume).collect();
            let poses: Vec<_> = crop_of.into_iter().zip(poses).collect();
            Ok::<_, CoreError>(hand_crops(&core, &volumes, &poses))
        })?;
        let [x, y, z] = self.shape();
        array(py, made, &[count, HAND_CHANNELS, x, y, z])
    }
}
