//! Images of environments and objects, pictures, cameras.

use crate::arm::Arm;
use crate::convert::{Array, Floats, array, isometries, isometry, matrices, point, read_config, to_python};
use crate::environments::env_pool::{EnvPool, carried};
use crate::errors::CoreError;
use crate::gil::detached;
use crate::hand::Hand;
use crate::images::still_scene::{StillScene, fixed_boxes};
use crate::mesh::Mesh;
use graspbox_gym::observations::tables::image_tables as image_tables_of;
use graspbox_mesh::VoxelFrame;
use graspbox_render::{
    Camera, CamerasConfig, Channels, DepthView, Detail, Frame, ImageKind, Intrinsics, Light, PictureConfig, ViewPlan,
    render_views,
};
use nalgebra::{Isometry3, Point3};
use numpy::{PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Deserialize;
use std::sync::Arc;

/// Kinds of images, by the name that begins an image's name.
#[pyfunction]
pub fn image_kinds() -> Vec<&'static str> {
    ImageKind::ALL.map(ImageKind::name).to_vec()
}

/// Names, shapes, dtypes, bounds, frames, cameras, units and missing values of the images of a config.
#[pyfunction]
#[pyo3(signature = (hand, cameras, objects=1, arm=None))]
pub fn image_tables<'py>(
    hand: &Hand,
    cameras: &Bound<'py, PyAny>,
    objects: usize,
    arm: Option<&Arm>,
) -> PyResult<Bound<'py, PyAny>> {
    let config: CamerasConfig = read_config(cameras, "CamerasConfig")?;
    to_python(cameras.py(), &image_tables_of(&carried(hand, arm)?, config, objects).map_err(CoreError::from)?)
}

/// Pictures (n, H, W, 3) uint8 of the present state of environments `envs`.
#[pyfunction]
#[pyo3(signature = (pool, envs, picture))]
pub fn pictures<'py>(
    py: Python<'py>,
    pool: &EnvPool,
    envs: Vec<usize>,
    picture: &Bound<'_, PyAny>,
) -> PyResult<Array<'py, u8>> {
    let picture: PictureConfig = read_config(picture, "PictureConfig")?;
    let [height, width] = picture.image_size.map(|n| n as usize);
    let (core, count) = (Arc::clone(&pool.core), envs.len());
    let pixels = detached(py, pool.num_threads, move || core.pictures(&envs, &picture))?;
    array(py, pixels, &[count, height, width, 3])
}

/// By the camera's name: its intrinsics (3, 3), and its present pose in every environment, `world_from_camera` (num_envs, 4, 4).
#[pyfunction]
pub fn poses_of_cameras<'py>(py: Python<'py>, pool: &EnvPool) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for camera in pool.core.cameras().map_err(CoreError::from)? {
        let intrinsics = array(py, camera.intrinsics.to_vec(), &[3, 3])?;
        dict.set_item(&camera.name, (intrinsics, matrices(py, camera.world_from_camera.into_iter())?))?;
    }
    Ok(dict)
}

/// The lens of a matrix (3, 3).
///
/// # Errors
/// Another shape.
pub(crate) fn lens(matrix: &Floats, height: u32, width: u32) -> Result<Intrinsics, CoreError> {
    let k = crate::convert::entries(matrix, "intrinsics", &[Some(3), Some(3)])?;
    Ok(Intrinsics { width, height, fx: k[0], fy: k[4], cx: k[2], cy: k[5] })
}

/// Settings of images of objects at rest.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ImagesConfig {
    /// Rows and columns.
    pub image_size: [u32; 2],
    /// Vertical field of view, radians.
    pub fov: f64,
    /// Clipping depths, metres.
    pub near: f64,
    pub far: f64,
    pub rgb: bool,
    pub segmentation: bool,
    /// Whether table and ground are rendered.
    pub table: bool,
}

/// Viewpoints of [`views`].
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ViewsConfig {
    plan: ViewPlan,
    count: usize,
    seed: u64,
    /// Whether levels of detail are rendered.
    levels: bool,
}

/// Renders an object, beside others with their poses and walls, from many sides.
///
/// `depth` (n, H, W) float32, `rgb` (n, H, W, 3) and `segmentation` (n, H, W) uint8 if requested, `intrinsics` (3, 3),
/// `world_from_camera` and `camera_from_object` (n, 4, 4).
#[pyfunction]
#[pyo3(signature = (mesh, viewpoints, config, world_from_object, target, num_threads, neighbours, walls))]
#[expect(clippy::too_many_arguments, reason = "what is rendered crosses by itself")]
pub fn views<'py>(
    py: Python<'py>,
    mesh: &Mesh,
    viewpoints: &Bound<'_, PyAny>,
    config: &Bound<'_, PyAny>,
    world_from_object: Option<Floats<'py>>,
    target: Option<Floats<'py>>,
    #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
    neighbours: Vec<(PyRef<'py, Mesh>, Floats<'py>)>,
    walls: Vec<(Floats<'py>, [f64; 3])>,
) -> PyResult<Bound<'py, PyDict>> {
    let placed = |(mesh, pose): &(PyRef<'_, Mesh>, Floats<'_>)| {
        Ok::<_, CoreError>((Arc::clone(&mesh.0), isometry(pose, "neighbours")?))
    };
    let neighbours = neighbours.iter().map(placed).collect::<Result<Vec<_>, _>>()?;
    let around: ViewsConfig = read_config(viewpoints, "views")?;
    let config: ImagesConfig = read_config(config, "views")?;
    let fixed = fixed_boxes(&walls, config.table)?;
    let pose = world_from_object.map(|m| isometry(&m, "world_from_object")).transpose()?;
    let pose = pose.unwrap_or_else(|| graspbox_mesh::default_pose(&mesh.0.spec.mesh));
    let bounds = mesh.0.spec.mesh.transformed(&pose).aabb();
    let target = target.map(|p| point(&p, "target")).transpose()?;
    let target = target.unwrap_or_else(|| nalgebra::center(&bounds.min, &bounds.max));
    let [height, width] = config.image_size;
    let lens = Intrinsics::from_fov(width, height, config.fov).map_err(CoreError::from)?;
    let data = Arc::clone(&mesh.0);
    let channels = Channels { rgb: config.rgb, segmentation: config.segmentation };
    let (cameras, frames) = detached(py, num_threads, move || {
        let cameras = graspbox_render::views(&around.plan, lens, target, around.count, around.seed)?;
        let ranged = cameras.into_iter().map(|c| c.with_range(config.near, config.far));
        let cameras = ranged.collect::<Result<Vec<_>, _>>()?;
        // Without levels of detail there is nothing to prepare, and existing ones are not used.
        let detail = if around.levels { Detail::Auto } else { Detail::Full };
        let scene = StillScene { objects: std::iter::once((data, pose)).chain(neighbours).collect(), fixed };
        let scene_pose = scene.pose(around.levels)?;
        let frames = render_views(&scene_pose, &cameras, &Light::default(), channels, detail)?;
        Ok::<_, CoreError>((cameras, frames))
    })?;
    let dict = image_arrays(py, &frames, channels, height, width)?;
    dict.set_item("intrinsics", array(py, lens.matrix().to_vec(), &[3, 3])?)?;
    let world_from_camera = cameras.iter().map(|c| *c.world_from_camera());
    dict.set_item("world_from_camera", matrices(py, world_from_camera)?)?;
    let camera_from_object = cameras.iter().map(|c| c.camera_from_object(&pose));
    dict.set_item("camera_from_object", matrices(py, camera_from_object)?)?;
    Ok(dict)
}

/// The arrays of images, by name: `depth`, and `rgb` and `segmentation` if they were requested.
pub(crate) fn image_arrays<'py>(
    py: Python<'py>,
    frames: &[Frame],
    channels: Channels,
    height: u32,
    width: u32,
) -> PyResult<Bound<'py, PyDict>> {
    let shape = [frames.len(), height as usize, width as usize];
    let joined = |get: fn(&Frame) -> &[u8]| frames.iter().map(get).collect::<Vec<_>>().concat();
    let depth = frames.iter().map(|f| f.depth.as_slice()).collect::<Vec<_>>().concat();
    let dict = PyDict::new(py);
    dict.set_item("depth", array(py, depth, &shape)?)?;
    if channels.rgb {
        dict.set_item("rgb", array(py, joined(|f| &f.rgb), &[shape[0], shape[1], shape[2], 3])?)?;
    }
    if channels.segmentation {
        dict.set_item("segmentation", array(py, joined(|f| &f.segmentation), &shape)?)?;
    }
    Ok(dict)
}

/// Fuses depth images (n, H, W) into a cube of voxels: (N, N, N) uint8, 0 unseen, 1 free, 2 occupied.
///
/// `frame_from_camera` (n, 4, 4) poses the cameras in the frame of the cube; `intrinsics` is (3, 3).
#[pyfunction]
#[pyo3(signature = (depth, intrinsics, frame_from_camera, resolution, origin, side, far, nothing_is_free))]
#[expect(clippy::too_many_arguments, reason = "every array of the views crosses by itself")]
pub fn occupancy<'py>(
    py: Python<'py>,
    depth: PyReadonlyArrayDyn<'py, f32>,
    intrinsics: Floats<'py>,
    frame_from_camera: Floats<'py>,
    resolution: usize,
    origin: Floats<'py>,
    side: f64,
    far: f64,
    nothing_is_free: bool,
) -> PyResult<Array<'py, u8>> {
    let poses = isometries(&frame_from_camera, "frame_from_camera")?;
    let values = crate::convert::entries(&depth, "depth", &[Some(poses.len()), None, None])?.to_vec();
    let [height, width] = [1, 2].map(|axis| depth.shape()[axis]);
    let lens = lens(&intrinsics, height as u32, width as u32)?;
    let origin: Point3<f64> = point(&origin, "origin")?;
    let cells = detached(py, None, move || {
        let grid = VoxelFrame::new(resolution, origin, side)?;
        let cameras = poses.iter().map(|pose| Camera::new(lens, *pose)?.with_range(1e-4, far));
        let cameras = cameras.collect::<Result<Vec<_>, _>>()?;
        let images = values.chunks_exact((height * width).max(1));
        let views: Vec<_> =
            cameras.into_iter().zip(images).map(|(camera, depth)| DepthView { camera, depth }).collect();
        Ok::<_, CoreError>(graspbox_render::occupancy(&grid, &Isometry3::identity(), &views, nothing_is_free)?)
    })?;
    let cells = cells.into_iter().map(|cell| cell as u8).collect();
    array(py, cells, &[resolution; 3])
}
