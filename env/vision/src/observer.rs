//! Images and pictures of many environments, with memory that is used again.

use crate::VisionError;
use crate::config::{CameraConfig, CamerasConfig, world_from_camera};
use crate::image_spec::{ImageKind, ImageSpec, ImageTable, Pixels};
use crate::viewpoint::Viewpoint;
use crate::visual_models::{ScenePose, VisualModels};
use graspbox_camera::occupancy::occupancy_into;
use graspbox_camera::{Camera, CameraError, Channels, DepthView, Detail, Frame, Light, Occupancy, Renderer};
use graspbox_hand::Hand;
use graspbox_mesh::VoxelFrame;
use nalgebra::{Isometry3, Point3};
use serde::{Deserialize, Serialize};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// A picture to viewpoint at.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PictureConfig {
    /// Rows and columns.
    pub image_size: [u32; 2],
    /// Samples along each side of a pixel, 1 to 8.
    pub samples: u32,
    /// Who looks.
    pub camera: CameraConfig,
}

impl Default for PictureConfig {
    fn default() -> Self {
        Self { image_size: [480, 640], samples: 3, camera: CameraConfig::viewer() }
    }
}

/// Memory for one image after the other; what it held before has no influence.
struct RenderBuffers {
    renderer: Renderer,
    frames: Vec<Frame>,
    cells: Vec<Occupancy>,
}

/// What all environments see with.
pub struct Observer {
    config: CamerasConfig,
    hand: Arc<Hand>,
    specs: Vec<ImageSpec>,
    tables: Vec<ImageTable>,
    lenses: Vec<Camera>,
    /// What each camera has to make; none where nobody needs it.
    channels: Vec<Option<Channels>>,
    grid: VoxelFrame,
    models: Arc<OnceLock<VisualModels>>,
    buffers: Mutex<Vec<RenderBuffers>>,
}

impl Observer {
    /// Checks a config; `models` is where the models of `hand` are kept, for all who see that hand.
    ///
    /// # Errors
    /// An image that is unknown or named twice, a camera that cannot be, or voxels that cannot be.
    pub fn new(
        hand: Arc<Hand>,
        config: CamerasConfig,
        models: Arc<OnceLock<VisualModels>>,
    ) -> Result<Self, VisionError> {
        let lenses = config.lenses()?;
        let specs = config.images.iter().map(|name| ImageSpec::read(name, &config));
        let specs = specs.collect::<Result<Vec<_>, _>>()?;
        for (i, spec) in specs.iter().enumerate() {
            if specs[..i].iter().any(|s| s.name == spec.name) {
                return Err(VisionError::Twice { name: spec.name.clone() });
            }
        }
        let links = hand.links.len();
        let mut channels = vec![None; lenses.len()];
        for spec in &specs {
            for needed in &mut channels[spec.cameras.clone()] {
                let needed: &mut Channels = needed.get_or_insert_default();
                needed.rgb |= matches!(spec.kind, ImageKind::Rgb | ImageKind::Rgbd);
                needed.segmentation |= spec.kind == ImageKind::Segmentation;
            }
        }
        Ok(Self {
            grid: grid(&config)?,
            tables: specs.iter().map(|s| s.table(&config, &lenses, links)).collect(),
            specs,
            lenses,
            channels,
            config,
            hand,
            models,
            buffers: Mutex::default(),
        })
    }

    /// The config.
    pub fn config(&self) -> &CamerasConfig {
        &self.config
    }

    /// The images, in the order of the config.
    pub fn specs(&self) -> &[ImageSpec] {
        &self.specs
    }

    /// The rows of the images, in the order of the config.
    pub fn tables(&self) -> &[ImageTable] {
        &self.tables
    }

    /// The cameras, posed in the frame of what carries them.
    pub fn lenses(&self) -> &[Camera] {
        &self.lenses
    }

    /// The cube of the voxels, world frame.
    pub fn grid(&self) -> &VoxelFrame {
        &self.grid
    }

    /// The light before it is varied.
    pub fn light(&self) -> Light {
        Light { shadows: self.config.shadows, ..Light::default() }
    }

    /// The models, made at their first use.
    ///
    /// # Errors
    /// As [`VisualModels::new`].
    pub fn models(&self) -> Result<&VisualModels, VisionError> {
        if let Some(models) = self.models.get() {
            return Ok(models);
        }
        // Threads that come at the same time do the work twice and keep the first.
        let made = VisualModels::new(&self.hand)?;
        Ok(self.models.get_or_init(|| made))
    }

    /// No images yet, with room for `rows` of each.
    pub fn blank(&self, rows: usize) -> Vec<Pixels> {
        let room = |s: &ImageSpec| Pixels::with_capacity(s.kind, rows * s.size(&self.config));
        self.specs.iter().map(room).collect()
    }

    /// The cameras of `viewpoint` at a scene_pose, in the world.
    pub fn cameras(&self, viewpoint: &Viewpoint, world_from_hand: &Isometry3<f64>) -> Result<Vec<Camera>, VisionError> {
        let all = self.lenses.iter().zip(&self.config.cameras).zip(&viewpoint.parent_from_camera);
        all.map(|((lens, config), pose)| {
            let pose = world_from_camera(config.mount, pose, world_from_hand);
            lens.with_pose(pose).map_err(|source| VisionError::Camera { name: config.name.clone(), source })
        })
        .collect()
    }

    /// Takes every image of the config into `images`, whose memory is used again.
    ///
    /// # Errors
    /// None for cameras of [`Observer::cameras`] and a models that could be made.
    pub fn see(
        &self,
        scene_pose: &ScenePose,
        viewpoint: &Viewpoint,
        images: &mut Vec<Pixels>,
    ) -> Result<(), VisionError> {
        if self.specs.is_empty() {
            images.clear();
            return Ok(());
        }
        if images.len() != self.specs.len() {
            *images = self.blank(1);
        }
        let cameras = self.cameras(viewpoint, &scene_pose.world_from_hand)?;
        let instances = self.models()?.instances(scene_pose);
        let mut buffer = self.buffer();
        let result = self.take(&mut buffer, &instances, &cameras, &viewpoint.light, images);
        self.buffers().push(buffer);
        result.map_err(|source| VisionError::Camera { name: "an image".into(), source })
    }

    fn take(
        &self,
        buffer: &mut RenderBuffers,
        instances: &[graspbox_camera::Instance],
        cameras: &[Camera],
        light: &Light,
        images: &mut [Pixels],
    ) -> Result<(), CameraError> {
        let RenderBuffers { renderer, frames, cells } = buffer;
        frames.resize_with(cameras.len(), Frame::default);
        for ((camera, channels), frame) in cameras.iter().zip(&self.channels).zip(&mut *frames) {
            if let Some(channels) = channels {
                renderer.render_into(instances, camera, light, *channels, frame)?;
            }
        }
        for (spec, image) in self.specs.iter().zip(images) {
            if spec.kind != ImageKind::Voxels {
                spec.fill(&frames[spec.cameras.start], image);
                continue;
            }
            let views: Vec<DepthView> = frames[spec.cameras.clone()].iter().filter_map(DepthView::of).collect();
            occupancy_into(&self.grid, &Isometry3::identity(), &views, true, cells)?;
            if let Pixels::Bytes(image) = image {
                image.clear();
                image.extend(cells.iter().map(|cell| *cell as u8));
            }
        }
        Ok(())
    }

    /// A smooth picture, (H, W, 3).
    ///
    /// # Errors
    /// A camera that cannot be, or samples out of range.
    pub fn picture(
        &self,
        scene_pose: &ScenePose,
        light: &Light,
        config: &PictureConfig,
    ) -> Result<Vec<u8>, VisionError> {
        let [height, width] = config.image_size;
        let camera = config.camera.camera(height, width)?;
        let pose = world_from_camera(config.camera.mount, camera.world_from_camera(), &scene_pose.world_from_hand);
        let instances = self.models()?.instances(scene_pose);
        let mut buffer = self.buffer();
        let made = camera
            .with_pose(pose)
            .and_then(|camera| buffer.renderer.picture(&instances, &camera, light, config.samples));
        self.buffers().push(buffer);
        made.map_err(|source| VisionError::Camera { name: config.camera.name.clone(), source })
    }

    /// Memory that nobody uses now, or new memory: as many as there are threads come to be.
    fn buffer(&self) -> RenderBuffers {
        let free = self.buffers().pop();
        free.unwrap_or_else(|| RenderBuffers {
            renderer: Renderer::new(Detail::Auto),
            frames: Vec::new(),
            cells: Vec::new(),
        })
    }

    fn buffers(&self) -> std::sync::MutexGuard<'_, Vec<RenderBuffers>> {
        self.buffers.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The cube of the voxels: over the table's middle, the table's top in the middle of the lowest layer.
fn grid(config: &CamerasConfig) -> Result<VoxelFrame, VisionError> {
    let (n, side) = (config.voxels, config.voxel_side);
    let rows = [
        ("cameras.voxels", n as f64, 1.0, 256.0, "1 to 256 voxels a side"),
        ("cameras.voxel_side", side, 0.01, 10.0, "between 0.01 and 10 m"),
    ];
    for (field, value, low, high, expected) in rows {
        if !(low..=high).contains(&value) {
            return Err(VisionError::BadConfig { field, value, expected });
        }
    }
    let origin = Point3::new(-0.5 * side, -0.5 * side, -0.5 * side / n as f64);
    VoxelFrame::new(n, origin, side).map_err(|source| VisionError::Mesh { object: "the cube of voxels".into(), source })
}
