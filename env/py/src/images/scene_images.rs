//! Images of many objects at rest, and voxels from many depth images: one call on all threads.

use crate::convert::{Array, Floats, array, entries, isometries, matrices, read_config};
use crate::errors::CoreError;
use crate::gil::detached;
use crate::images::still_scene::{StillScene, fixed_boxes};
use crate::images::vision::{ImagesConfig, image_arrays, lens};
use crate::mesh::{Mesh, MeshData};
use graspbox_mesh::VoxelFrame;
use graspbox_render::{Camera, Channels, DepthView, Detail, Frame, Intrinsics, Light, Renderer, ViewPlan, occupancy};
use nalgebra::{Isometry3, Point3};
use numpy::{PyReadonlyArrayDyn, PyUntypedArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use std::sync::Arc;

/// One image for each of n scenes: objects of `meshes` by their indices (the first is "the object" of the labels), and walls, seen from
/// `world_from_camera` (n, 4, 4).
///
/// `world_from_objects` (m, 4, 4) are the poses of the objects of all scenes, one scene after the other.
/// `depth` (n, H, W) float32, and `rgb` (n, H, W, 3) and `segmentation` (n, H, W) uint8 if requested.
#[pyfunction]
#[pyo3(signature = (meshes, meshes_of, world_from_objects, walls, world_from_camera, config, num_threads))]
#[expect(clippy::too_many_arguments, reason = "what is rendered crosses by itself")]
pub fn render_scenes<'py>(
    py: Python<'py>,
    meshes: Vec<PyRef<'py, Mesh>>,
    meshes_of: Vec<Vec<usize>>,
    world_from_objects: Floats<'py>,
    walls: Vec<Vec<(Floats<'py>, [f64; 3])>>,
    world_from_camera: Floats<'py>,
    config: &Bound<'_, PyAny>,
    #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
) -> PyResult<Bound<'py, PyDict>> {
    let settings: ImagesConfig = read_config(config, "the images")?;
    let cameras = isometries(&world_from_camera, "world_from_camera")?;
    let meshes: Vec<_> = meshes.iter().map(|mesh| Arc::clone(&mesh.0)).collect();
    let poses = isometries(&world_from_objects, "world_from_objects")?;
    let scenes = still_scenes(&meshes, &meshes_of, &poses, &walls, settings.table)?;
    if cameras.len() != scenes.len() {
        let (cameras, scenes) = (cameras.len(), scenes.len());
        return Err(CoreError::Config(format!("there are {cameras} cameras for {scenes} scenes; give one each")).into());
    }
    let [height, width] = settings.image_size;
    let lens = Intrinsics::from_fov(width, height, settings.fov).map_err(CoreError::from)?;
    let channels = Channels { rgb: settings.rgb, segmentation: settings.segmentation };
    let frames = detached(py, num_threads, move || {
        let one = |renderer: &mut Renderer, index: usize| -> Result<Frame, CoreError> {
            let scene = scenes[index].pose(true)?;
            let camera = Camera::new(lens, cameras[index])?.with_range(settings.near, settings.far)?;
            Ok(renderer.render(&scene.instances(None), &camera, &Light::default(), channels)?)
        };
        let frames: Vec<_> = (0..scenes.len()).into_par_iter().map_init(|| Renderer::new(Detail::Auto), one).collect();
        frames.into_iter().collect::<Result<Vec<Frame>, CoreError>>()
    })?;
    image_arrays(py, &frames, channels, height, width)
}

/// The scenes of [`render_scenes`].
///
/// # Errors
/// An index without a mesh, or not one pose for each object and one list of walls for each scene.
fn still_scenes(
    meshes: &[Arc<MeshData>],
    meshes_of: &[Vec<usize>],
    world_from_objects: &[Isometry3<f64>],
    walls: &[Vec<(Floats, [f64; 3])>],
    table: bool,
) -> Result<Vec<StillScene>, CoreError> {
    let (count, poses) = (meshes_of.iter().map(Vec::len).sum::<usize>(), world_from_objects.len());
    if count != poses {
        return Err(CoreError::Config(format!("there are {poses} poses for {count} objects; give one each")));
    }
    if walls.len() != meshes_of.len() {
        let (walls, scenes) = (walls.len(), meshes_of.len());
        return Err(CoreError::Config(format!("walls has {walls} entries for {scenes} scenes; give one each")));
    }
    let mut poses = world_from_objects.iter();
    let object = |(index, pose): (&usize, &Isometry3<f64>)| {
        let mesh = meshes
            .get(*index)
            .ok_or_else(|| CoreError::Config(format!("meshes_of holds {index}; there are {} meshes", meshes.len())))?;
        Ok::<_, CoreError>((Arc::clone(mesh), *pose))
    };
    let scene = |(objects, walls): (&Vec<usize>, &Vec<(Floats, [f64; 3])>)| {
        let objects = objects.iter().zip(poses.by_ref().take(objects.len())).map(object).collect::<Result<_, _>>()?;
        Ok(StillScene { objects, fixed: fixed_boxes(walls, table)? })
    };
    meshes_of.iter().zip(walls).map(scene).collect()
}

/// Poses of the cameras of a plan around `target`: `world_from_camera` (count, 4, 4).
#[pyfunction]
pub fn camera_poses<'py>(
    py: Python<'py>,
    plan: &Bound<'_, PyAny>,
    target: [f64; 3],
    count: usize,
    seed: u64,
) -> PyResult<Array<'py, f64>> {
    let plan: ViewPlan = read_config(plan, "ViewPlan")?;
    // Poses do not depend on the lens.
    let lens = Intrinsics::from_fov(1, 1, 1.0).map_err(CoreError::from)?;
    let cameras = graspbox_render::views(&plan, lens, Point3::from(target), count, seed).map_err(CoreError::from)?;
    matrices(py, cameras.iter().map(|camera| *camera.world_from_camera()))
}

/// Fuses the depth images (n, V, H, W) of n scenes into a cube of voxels each: (n, N, N, N) uint8, 0 unseen, 1 free, 2 occupied.
///
/// `frame_from_camera` (n V, 4, 4) poses the cameras in the frames of the cubes; `intrinsics` is (3, 3), `origin` (3,).
#[pyfunction]
#[pyo3(signature = (depth, intrinsics, frame_from_camera, resolution, origin, side, far, nothing_is_free, num_threads))]
#[expect(clippy::too_many_arguments, reason = "every array of the views crosses by itself")]
pub fn occupancies<'py>(
    py: Python<'py>,
    depth: PyReadonlyArrayDyn<'py, f32>,
    intrinsics: Floats<'py>,
    frame_from_camera: Floats<'py>,
    resolution: usize,
    origin: [f64; 3],
    side: f64,
    far: f64,
    nothing_is_free: bool,
    #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
) -> PyResult<Array<'py, u8>> {
    let values = entries(&depth, "depth", &[None, None, None, None])?.to_vec();
    let [count, views, height, width] = [0, 1, 2, 3].map(|axis| depth.shape()[axis]);
    let poses = isometries(&frame_from_camera, "frame_from_camera")?;
    if poses.len() != count * views {
        let text =
            format!("frame_from_camera has {} poses; give one for each of {} images", poses.len(), count * views);
        return Err(CoreError::Config(text).into());
    }
    let lens = lens(&intrinsics, height as u32, width as u32)?;
    let cells = detached(py, num_threads, move || {
        let grid = VoxelFrame::new(resolution, Point3::from(origin), side)?;
        let pixels = height * width;
        let one = |scene: usize| -> Result<Vec<u8>, CoreError> {
            let of_view = |view: usize| {
                let index = scene * views + view;
                let camera = Camera::new(lens, poses[index])?.with_range(1e-4, far)?;
                Ok(DepthView { camera, depth: &values[index * pixels..(index + 1) * pixels] })
            };
            let seen = (0..views).map(of_view).collect::<Result<Vec<_>, CoreError>>()?;
            let cells = occupancy(&grid, &Isometry3::identity(), &seen, nothing_is_free)?;
            Ok(cells.into_iter().map(|cell| cell as u8).collect())
        };
        let cells: Vec<_> = (0..count).into_par_iter().map(one).collect();
        cells.into_iter().collect::<Result<Vec<_>, CoreError>>()
    })?;
    array(py, cells.concat(), &[count, resolution, resolution, resolution])
}
