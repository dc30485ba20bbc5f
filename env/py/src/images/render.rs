//! Pictures of any meshes from any camera, and of a hand among them.

use crate::convert::{Array, Floats, array, isometries, isometry, points, read_config, vector};
use crate::errors::CoreError;
use crate::gil::detached;
use crate::hand::Hand;
use crate::mesh::{Mesh, MeshData};
use graspbox_render::{Camera, Channels, Detail, HandModel, Instance, Light, Renderer};
use nalgebra::Isometry3;
use pyo3::prelude::*;
use serde::Deserialize;
use std::sync::Arc;

/// Settings of [`render`] besides meshes, hand and camera.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RenderConfig {
    /// Rows and columns.
    image_size: [u32; 2],
    /// Samples along each side of a pixel, 1 to 8.
    samples: u32,
    /// Clipping depths, metres.
    near: f64,
    far: f64,
    light: Light,
}

/// A mesh of the picture.
struct Solid {
    data: Arc<MeshData>,
    world_from_mesh: Isometry3<f64>,
    color: [f32; 3],
    casts_shadow: bool,
}

/// A hand of the picture: `world_from_hand` (4, 4), and positions (c,) of its independent joints, rad or m.
type Posed<'py> = (PyRef<'py, Hand>, Floats<'py>, Floats<'py>);

/// A smooth picture (H, W, 3) uint8 of meshes and a hand, and the depth (H, W) float32 at the pixels' centres: metres
/// along the optical axis, 0 where nothing is.
///
/// `world_from_mesh` (n, 4, 4); `colors` (n, 3) in [0, 1]; `intrinsics` (3, 3); `world_from_camera` (4, 4), the
/// camera's frame with x right, y down, z forward. Meshes are rendered in full detail.
#[pyfunction]
#[pyo3(signature = (
    meshes, world_from_mesh, colors, casts_shadow, hand, intrinsics, world_from_camera, config, num_threads
))]
#[expect(clippy::too_many_arguments, reason = "every array of a scene crosses by itself")]
pub fn render<'py>(
    py: Python<'py>,
    meshes: Vec<PyRef<'py, Mesh>>,
    world_from_mesh: Floats<'py>,
    colors: Floats<'py>,
    casts_shadow: Vec<bool>,
    hand: Option<Posed<'py>>,
    intrinsics: Floats<'py>,
    world_from_camera: Floats<'py>,
    config: &Bound<'_, PyAny>,
    #[pyo3(from_py_with = crate::gil::threads)] num_threads: Option<usize>,
) -> PyResult<(Array<'py, u8>, Array<'py, f32>)> {
    let config: RenderConfig = read_config(config, "RenderConfig")?;
    let solids = solids(&meshes, &world_from_mesh, &colors, &casts_shadow)?;
    let hand = hand.map(posed).transpose()?;
    let [height, width] = config.image_size;
    let lens = crate::images::vision::lens(&intrinsics, height, width)?;
    let camera = Camera::new(lens, isometry(&world_from_camera, "world_from_camera")?)
        .and_then(|camera| camera.with_range(config.near, config.far))
        .map_err(CoreError::from)?;
    let (rgb, depth) = detached(py, num_threads, move || paint(&solids, hand, &camera, &config))?;
    let (height, width) = (height as usize, width as usize);
    Ok((array(py, rgb, &[height, width, 3])?, array(py, depth, &[height, width])?))
}

fn solids(
    meshes: &[PyRef<Mesh>],
    world_from_mesh: &Floats,
    colors: &Floats,
    casts_shadow: &[bool],
) -> Result<Vec<Solid>, CoreError> {
    let count = meshes.len();
    let poses = isometries(world_from_mesh, "world_from_mesh")?;
    let colors = points(colors, "colors")?;
    for (what, given) in
        [("world_from_mesh", poses.len()), ("colors", colors.len()), ("casts_shadow", casts_shadow.len())]
    {
        if given != count {
            return Err(CoreError::Config(format!("{what} has length {given}; give one for each of {count} meshes")));
        }
    }
    let rest = poses.into_iter().zip(colors).zip(casts_shadow);
    Ok(meshes
        .iter()
        .zip(rest)
        .map(|(mesh, ((world_from_mesh, color), &casts_shadow))| Solid {
            data: Arc::clone(&mesh.0),
            world_from_mesh,
            color: [color.x as f32, color.y as f32, color.z as f32],
            casts_shadow,
        })
        .collect())
}

/// The hand's model, and the poses of its links in the world.
fn posed((hand, world_from_hand, positions): Posed) -> Result<(HandModel, Vec<Isometry3<f64>>), CoreError> {
    let frame = isometry(&world_from_hand, "world_from_hand")?;
    let links = hand.0.hand_from_links(&vector(&positions, "positions")?)?;
    Ok((HandModel::new(&hand.0)?, links.into_iter().map(|link| frame * link).collect()))
}

fn paint(
    solids: &[Solid],
    hand: Option<(HandModel, Vec<Isometry3<f64>>)>,
    camera: &Camera,
    config: &RenderConfig,
) -> Result<(Vec<u8>, Vec<f32>), CoreError> {
    let mut instances = Vec::with_capacity(solids.len());
    if let Some((model, links)) = &hand {
        instances.extend(model.instances(links));
    }
    for solid in solids {
        instances.push(Instance {
            model: solid.data.surface()?,
            world_from_model: solid.world_from_mesh,
            color: solid.color,
            label: 1,
            casts_shadow: solid.casts_shadow,
        });
    }
    let mut renderer = Renderer::new(Detail::Full);
    let rgb = renderer.picture(&instances, camera, &config.light, config.samples)?;
    let depth = renderer.render(&instances, camera, &config.light, Channels::default())?.depth;
    Ok((rgb, depth))
}
