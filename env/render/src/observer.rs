//! Images and pictures of many environments, with reused render buffers.

pub mod config;
pub mod image_spec;
pub mod viewpoint;

use crate::hand_model::HandModel;
use crate::labels::{FIRST_LINK, object_index};
use crate::observer::config::{CameraConfig, CamerasConfig, world_from_camera};
use crate::observer::image_spec::{ImageKind, ImageSpec, ImageTable, Pixels};
use crate::observer::viewpoint::Viewpoint;
use crate::occupancy::occupancy_into;
use crate::scene::is_near;
use crate::{Camera, Channels, DepthView, Detail, Frame, Instance, Light, Occupancy, RenderError, Renderer, ScenePose};
use graspbox_hand::Hand;
use graspbox_mesh::{VoxelFrame, in_range};
use nalgebra::{Isometry3, Point3};
use serde::{Deserialize, Serialize};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Settings of a picture for people: size, smoothness, camera.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PictureConfig {
    /// Rows and columns.
    pub image_size: [u32; 2],
    /// Samples along each side of a pixel, 1 to 8.
    pub samples: u32,
    /// The camera that takes it.
    pub camera: CameraConfig,
}

impl Default for PictureConfig {
    fn default() -> Self {
        Self { image_size: [480, 640], samples: 3, camera: CameraConfig::viewer() }
    }
}

/// Reused memory for images; previous contents have no influence.
struct RenderBuffers {
    renderer: Renderer,
    frames: Vec<Frame>,
    cells: Vec<Occupancy>,
}

/// The cameras, images and models that all environments share.
pub struct Observer {
    config: CamerasConfig,
    hand: Arc<Hand>,
    specs: Vec<ImageSpec>,
    tables: Vec<ImageTable>,
    mounted: Vec<Camera>,
    /// Channels that each camera renders; `None` for a camera that no image needs.
    channels: Vec<Option<Channels>>,
    grid: VoxelFrame,
    hand_model: Arc<OnceLock<HandModel>>,
    buffers: Mutex<Vec<RenderBuffers>>,
}

impl Observer {
    /// Checks a config; `hand_model` holds the model of `hand` and may be shared by observers of that hand.
    ///
    /// * `objects`: most objects of a scene.
    ///
    /// # Errors
    /// [`RenderError`] for an image that is unknown or named twice, an invalid camera, or invalid voxel settings.
    pub fn new(
        hand: Arc<Hand>,
        config: CamerasConfig,
        hand_model: Arc<OnceLock<HandModel>>,
        objects: usize,
    ) -> Result<Self, RenderError> {
        let mounted = config.mounted_cameras()?;
        let specs = config.images.iter().map(|name| ImageSpec::parse(name, &config, objects.max(1)));
        let specs = specs.collect::<Result<Vec<_>, _>>()?;
        for (i, spec) in specs.iter().enumerate() {
            if specs[..i].iter().any(|s| s.name == spec.name) {
                return Err(RenderError::Twice { name: spec.name.clone() });
            }
        }
        // Hand, the objects but the first, and the arm.
        let labels = hand.links.len() + objects.max(1) - 1 + usize::from(hand.carrier.is_some());
        in_range("number of links and objects", labels as f64, 1.0..=f64::from(u8::MAX - FIRST_LINK), "")?;
        let mut channels = vec![None; mounted.len()];
        for spec in specs.iter().filter(|spec| spec.kind != ImageKind::Amodal) {
            for needed in &mut channels[spec.cameras.clone()] {
                let needed: &mut Channels = needed.get_or_insert_default();
                needed.rgb |= matches!(spec.kind, ImageKind::Rgb | ImageKind::Rgbd);
                needed.segmentation |= spec.kind == ImageKind::Segmentation;
            }
        }
        Ok(Self {
            grid: grid(&config)?,
            tables: specs.iter().map(|s| s.table(&config, &mounted, labels)).collect(),
            specs,
            mounted,
            channels,
            config,
            hand,
            hand_model,
            buffers: Mutex::default(),
        })
    }

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

    /// The cameras, posed in the frame of their mount.
    pub fn mounted_cameras(&self) -> &[Camera] {
        &self.mounted
    }

    /// The voxel grid, world frame.
    pub fn grid(&self) -> &VoxelFrame {
        &self.grid
    }

    /// The light before it is varied.
    pub fn light(&self) -> Light {
        Light { shadows: self.config.shadows, ..Light::default() }
    }

    /// The model of the hand, built at its first use.
    ///
    /// # Errors
    /// As [`HandModel::new`].
    pub fn hand_model(&self) -> Result<&HandModel, RenderError> {
        if let Some(model) = self.hand_model.get() {
            return Ok(model);
        }
        // Concurrent threads may each build it; the first result is kept.
        let made = HandModel::new(&self.hand)?;
        Ok(self.hand_model.get_or_init(|| made))
    }

    /// Empty images with capacity for `rows` of each.
    pub fn blank(&self, rows: usize) -> Vec<Pixels> {
        let room = |s: &ImageSpec| Pixels::with_capacity(s.kind, rows * s.size(&self.config));
        self.specs.iter().map(room).collect()
    }

    /// The cameras of `viewpoint` in the world, for a hand at `world_from_hand`.
    ///
    /// # Errors
    /// [`RenderError::Named`] for a pose that is not a finite rigid motion.
    pub fn cameras(&self, viewpoint: &Viewpoint, world_from_hand: &Isometry3<f64>) -> Result<Vec<Camera>, RenderError> {
        let all = self.mounted.iter().zip(&self.config.cameras).zip(&viewpoint.parent_from_camera);
        all.map(|((camera, config), pose)| {
            let pose = world_from_camera(config.mount, pose, world_from_hand);
            camera.with_pose(pose).map_err(|error| error.of(config.name.as_str()))
        })
        .collect()
    }

    /// Renders every image of the config into `images`, whose memory is reused.
    ///
    /// # Errors
    /// None for finite camera poses and a hand whose models can be built.
    pub fn render(
        &self,
        scene_pose: &ScenePose,
        viewpoint: &Viewpoint,
        images: &mut Vec<Pixels>,
    ) -> Result<(), RenderError> {
        if self.specs.is_empty() {
            images.clear();
            return Ok(());
        }
        if images.len() != self.specs.len() {
            *images = self.blank(1);
        }
        let cameras = self.cameras(viewpoint, &scene_pose.world_from_hand)?;
        let instances = scene_pose.instances(Some(self.hand_model()?));
        let mut buffer = self.buffer();
        let result = self.take(&mut buffer, &instances, &cameras, &viewpoint.light, images);
        let result = result.and_then(|()| self.mask(&mut buffer, scene_pose, &cameras, images));
        self.buffers().push(buffer);
        result.map_err(|error| error.of("an image"))
    }

    fn take(
        &self,
        buffer: &mut RenderBuffers,
        instances: &[Instance],
        cameras: &[Camera],
        light: &Light,
        images: &mut [Pixels],
    ) -> Result<(), RenderError> {
        let RenderBuffers { renderer, frames, cells } = buffer;
        frames.resize_with(cameras.len(), Frame::default);
        for ((camera, channels), frame) in cameras.iter().zip(&self.channels).zip(&mut *frames) {
            if let Some(channels) = channels {
                renderer.render_into(instances, camera, light, *channels, frame)?;
            }
        }
        for (spec, image) in self.specs.iter().zip(images) {
            match spec.kind {
                ImageKind::Amodal => continue,
                ImageKind::Voxels => {}
                _ => {
                    spec.fill(&frames[spec.cameras.start], image);
                    continue;
                }
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

    /// Writes the amodal masks: each object is rendered by itself.
    fn mask(
        &self,
        buffer: &mut RenderBuffers,
        scene_pose: &ScenePose,
        cameras: &[Camera],
        images: &mut [Pixels],
    ) -> Result<(), RenderError> {
        let channels = Channels { rgb: false, segmentation: true };
        let RenderBuffers { renderer, frames, .. } = buffer;
        let kinds = self.specs.iter().zip(images).filter(|(spec, _)| spec.kind == ImageKind::Amodal);
        for (spec, image) in kinds {
            let Pixels::Bytes(image) = image else { continue };
            image.clear();
            image.resize(spec.size(&self.config), 0);
            let frame = &mut frames[spec.cameras.start];
            for object in scene_pose.objects.iter().filter(|object| is_near(&object.world_from_object)) {
                let place = object_index(object.label, self.hand.links.len());
                if place >= spec.objects {
                    continue;
                }
                renderer.render_into(
                    &[object.instance()],
                    &cameras[spec.cameras.start],
                    &Light::default(),
                    channels,
                    frame,
                )?;
                for (pixel, label) in image.chunks_exact_mut(spec.objects).zip(&frame.segmentation) {
                    pixel[place] = u8::from(*label == object.label);
                }
            }
        }
        Ok(())
    }

    /// A smooth picture, (H, W, 3).
    ///
    /// # Errors
    /// [`RenderError`] for an invalid camera, or samples out of range.
    pub fn picture(
        &self,
        scene_pose: &ScenePose,
        light: &Light,
        config: &PictureConfig,
    ) -> Result<Vec<u8>, RenderError> {
        let [height, width] = config.image_size;
        let camera = config.camera.camera(height, width)?;
        let pose = world_from_camera(config.camera.mount, camera.world_from_camera(), &scene_pose.world_from_hand);
        let instances = scene_pose.instances(Some(self.hand_model()?));
        let mut buffer = self.buffer();
        let made = camera
            .with_pose(pose)
            .and_then(|camera| buffer.renderer.picture(&instances, &camera, light, config.samples));
        self.buffers().push(buffer);
        made.map_err(|error| error.of(config.camera.name.as_str()))
    }

    /// A free buffer, or a new one: at most one per thread.
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

/// The voxel grid: a cube over the middle of the table, whose top bisects the lowest layer.
fn grid(config: &CamerasConfig) -> Result<VoxelFrame, RenderError> {
    let (n, side) = (config.voxels, config.voxel_side);
    in_range("cameras.voxels", n as f64, 1.0..=256.0, "voxels per side")?;
    in_range("cameras.voxel_side", side, 0.01..=10.0, "m")?;
    let origin = Point3::new(-0.5 * side, -0.5 * side, -0.5 * side / n as f64);
    VoxelFrame::new(n, origin, side).map_err(|error| RenderError::from(error).of("the voxel grid"))
}
