//! Images and pictures of many environments, with memory that is used again.

use crate::EpisodeError;
use crate::eyes::config::{CameraConfig, EyesConfig, world_from_camera};
use crate::eyes::look::Look;
use crate::eyes::sight::{ImageTable, Kind, Pixels, Sight};
use crate::eyes::stage::{Moment, Stage};
use graspbox_camera::occupancy::occupancy_into;
use graspbox_camera::{Camera, CameraError, Channels, DepthView, Detail, Frame, Light, Occupancy, Renderer};
use graspbox_hand::Hand;
use graspbox_mesh::VoxelFrame;
use nalgebra::{Isometry3, Point3};
use serde::{Deserialize, Serialize};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// A picture to look at.
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
struct Retina {
    renderer: Renderer,
    frames: Vec<Frame>,
    cells: Vec<Occupancy>,
}

/// What all environments see with.
pub struct Eyes {
    config: EyesConfig,
    hand: Arc<Hand>,
    sights: Vec<Sight>,
    tables: Vec<ImageTable>,
    lenses: Vec<Camera>,
    /// What each camera has to make; none where nobody needs it.
    channels: Vec<Option<Channels>>,
    grid: VoxelFrame,
    stage: Arc<OnceLock<Stage>>,
    retinas: Mutex<Vec<Retina>>,
}

impl Eyes {
    /// Checks a config; `stage` is where the models of `hand` are kept, for all who see that hand.
    ///
    /// # Errors
    /// An image that is unknown or named twice, a camera that cannot be, or voxels that cannot be.
    pub fn new(hand: Arc<Hand>, config: EyesConfig, stage: Arc<OnceLock<Stage>>) -> Result<Self, EpisodeError> {
        let lenses = config.lenses()?;
        let sights = config.images.iter().map(|name| Sight::read(name, &config));
        let sights = sights.collect::<Result<Vec<_>, _>>()?;
        for (i, sight) in sights.iter().enumerate() {
            if sights[..i].iter().any(|s| s.name == sight.name) {
                return Err(EpisodeError::Twice { name: sight.name.clone() });
            }
        }
        let links = hand.links.len();
        let mut channels = vec![None; lenses.len()];
        for sight in &sights {
            for needed in &mut channels[sight.cameras.clone()] {
                let needed: &mut Channels = needed.get_or_insert_default();
                needed.rgb |= matches!(sight.kind, Kind::Rgb | Kind::Rgbd);
                needed.segmentation |= sight.kind == Kind::Segmentation;
            }
        }
        Ok(Self {
            grid: grid(&config)?,
            tables: sights.iter().map(|s| s.table(&config, &lenses, links)).collect(),
            sights,
            lenses,
            channels,
            config,
            hand,
            stage,
            retinas: Mutex::default(),
        })
    }

    /// The config.
    pub fn config(&self) -> &EyesConfig {
        &self.config
    }

    /// The images, in the order of the config.
    pub fn sights(&self) -> &[Sight] {
        &self.sights
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
    /// As [`Stage::new`].
    pub fn stage(&self) -> Result<&Stage, EpisodeError> {
        if let Some(stage) = self.stage.get() {
            return Ok(stage);
        }
        // Threads that come at the same time do the work twice and keep the first.
        let made = Stage::new(&self.hand)?;
        Ok(self.stage.get_or_init(|| made))
    }

    /// No images yet, with room for `rows` of each.
    pub fn blank(&self, rows: usize) -> Vec<Pixels> {
        let room = |s: &Sight| Pixels::with_capacity(s.kind, rows * s.size(&self.config));
        self.sights.iter().map(room).collect()
    }

    /// The cameras of `look` at a moment, in the world.
    pub fn cameras(&self, look: &Look, world_from_hand: &Isometry3<f64>) -> Result<Vec<Camera>, EpisodeError> {
        let all = self.lenses.iter().zip(&self.config.cameras).zip(&look.parent_from_camera);
        all.map(|((lens, config), pose)| {
            let pose = world_from_camera(config.mount, pose, world_from_hand);
            lens.with_pose(pose).map_err(|source| EpisodeError::Camera { name: config.name.clone(), source })
        })
        .collect()
    }

    /// Takes every image of the config into `images`, whose memory is used again.
    ///
    /// # Errors
    /// None for cameras of [`Eyes::cameras`] and a stage that could be made.
    pub fn see(&self, moment: &Moment, look: &Look, images: &mut Vec<Pixels>) -> Result<(), EpisodeError> {
        if self.sights.is_empty() {
            images.clear();
            return Ok(());
        }
        if images.len() != self.sights.len() {
            *images = self.blank(1);
        }
        let cameras = self.cameras(look, &moment.world_from_hand)?;
        let instances = self.stage()?.instances(moment);
        let mut retina = self.retina();
        let result = self.take(&mut retina, &instances, &cameras, &look.light, images);
        self.retinas().push(retina);
        result.map_err(|source| EpisodeError::Camera { name: "an image".into(), source })
    }

    fn take(
        &self,
        retina: &mut Retina,
        instances: &[graspbox_camera::Instance],
        cameras: &[Camera],
        light: &Light,
        images: &mut [Pixels],
    ) -> Result<(), CameraError> {
        let Retina { renderer, frames, cells } = retina;
        frames.resize_with(cameras.len(), Frame::default);
        for ((camera, channels), frame) in cameras.iter().zip(&self.channels).zip(&mut *frames) {
            if let Some(channels) = channels {
                renderer.render_into(instances, camera, light, *channels, frame)?;
            }
        }
        for (sight, image) in self.sights.iter().zip(images) {
            if sight.kind != Kind::Voxels {
                sight.fill(&frames[sight.cameras.start], image);
                continue;
            }
            let views: Vec<DepthView> = frames[sight.cameras.clone()].iter().filter_map(DepthView::of).collect();
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
    pub fn picture(&self, moment: &Moment, light: &Light, config: &PictureConfig) -> Result<Vec<u8>, EpisodeError> {
        let [height, width] = config.image_size;
        let camera = config.camera.camera(height, width)?;
        let pose = world_from_camera(config.camera.mount, camera.world_from_camera(), &moment.world_from_hand);
        let instances = self.stage()?.instances(moment);
        let mut retina = self.retina();
        let made = camera
            .with_pose(pose)
            .and_then(|camera| retina.renderer.picture(&instances, &camera, light, config.samples));
        self.retinas().push(retina);
        made.map_err(|source| EpisodeError::Camera { name: config.camera.name.clone(), source })
    }

    /// Memory that nobody uses now, or new memory: as many as there are threads come to be.
    fn retina(&self) -> Retina {
        let free = self.retinas().pop();
        free.unwrap_or_else(|| Retina { renderer: Renderer::new(Detail::Auto), frames: Vec::new(), cells: Vec::new() })
    }

    fn retinas(&self) -> std::sync::MutexGuard<'_, Vec<Retina>> {
        self.retinas.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The cube of the voxels: over the table's middle, the table's top in the middle of the lowest layer.
fn grid(config: &EyesConfig) -> Result<VoxelFrame, EpisodeError> {
    let (n, side) = (config.voxels, config.voxel_side);
    let rows = [
        ("eyes.voxels", n as f64, 1.0, 256.0, "1 to 256 voxels a side"),
        ("eyes.voxel_side", side, 0.01, 10.0, "between 0.01 and 10 m"),
    ];
    for (field, value, low, high, expected) in rows {
        if !(low..=high).contains(&value) {
            return Err(EpisodeError::BadConfig { field, value, expected });
        }
    }
    let origin = Point3::new(-0.5 * side, -0.5 * side, -0.5 * side / n as f64);
    VoxelFrame::new(n, origin, side)
        .map_err(|source| EpisodeError::Mesh { object: "the cube of voxels".into(), source })
}
