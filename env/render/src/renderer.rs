//! Renders a scene from a camera.

pub(crate) mod raster;
pub(crate) mod rasterize;
pub(crate) mod shade;
pub(crate) mod shadow;

use crate::error::RenderError;
use crate::renderer::raster::Raster;
use crate::renderer::rasterize::{Cull, Piece, Scratch, View, rasterize};
use crate::renderer::shade::{Facet, Shader, shown};
use crate::renderer::shadow::ShadowMap;
use crate::scene::check_instances;
use crate::{Camera, Detail, Frame, Instance, Light};
use graspbox_mesh::in_range;
use nalgebra::Vector3;
use rayon::prelude::*;

/// Channels to render in addition to depth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Channels {
    /// Colours.
    pub rgb: bool,
    /// Labels of instances.
    pub segmentation: bool,
}

/// One image to render.
#[derive(Clone, Debug)]
pub struct Job<'a> {
    /// The scene.
    pub instances: &'a [Instance<'a>],
    pub camera: Camera,
    /// The light; it affects colours only.
    pub light: Light,
    /// Channels to render in addition to depth.
    pub channels: Channels,
}

/// Renders many jobs on the current rayon pool; frames in the order of the jobs, the same bits on any number of threads.
///
/// # Errors
/// Those of [`Renderer::render_into`], for the first job with an error.
pub fn render_batch(jobs: &[Job], detail: Detail) -> Result<Vec<Frame>, RenderError> {
    let results: Vec<_> = jobs
        .par_iter()
        .map_init(
            || Renderer::new(detail),
            |renderer, job| renderer.render(job.instances, &job.camera, &job.light, job.channels),
        )
        .collect();
    results.into_iter().collect()
}

/// Buffers for rendering images one after the other. Earlier images have no influence.
pub struct Renderer {
    detail: Detail,
    raster: Raster,
    scratch: Scratch,
    facets: Vec<Facet>,
    /// The label of each id.
    labels: Vec<u8>,
    /// Of the current instance, in the world.
    normals: Vec<Vector3<f32>>,
    shadow: ShadowMap,
}

impl Renderer {
    /// A renderer that chooses levels of detail by this rule.
    #[must_use]
    pub fn new(detail: Detail) -> Self {
        Self {
            detail,
            raster: Raster::new(),
            scratch: Scratch::default(),
            facets: Vec::new(),
            labels: Vec::new(),
            normals: Vec::new(),
            shadow: ShadowMap::new(),
        }
    }

    /// As [`Renderer::render_into`], with a new frame.
    ///
    /// # Errors
    /// Those of [`Renderer::render_into`].
    pub fn render(
        &mut self,
        instances: &[Instance],
        camera: &Camera,
        light: &Light,
        channels: Channels,
    ) -> Result<Frame, RenderError> {
        let mut frame = Frame::default();
        self.render_into(instances, camera, light, channels, &mut frame)?;
        Ok(frame)
    }

    /// Renders `instances` from `camera` into `frame`, whose memory is reused.
    ///
    /// A camera inside a closed model sees its inner side.
    ///
    /// # Errors
    /// [`RenderError::BadPose`] or [`RenderError::OutOfRange`] for an instance or the light;
    /// [`RenderError::TooManyInstances`] above 65,536.
    pub fn render_into(
        &mut self,
        instances: &[Instance],
        camera: &Camera,
        light: &Light,
        channels: Channels,
        frame: &mut Frame,
    ) -> Result<(), RenderError> {
        check_instances(instances)?;
        frame.rgb.clear();
        if channels.rgb {
            light.check()?;
            self.shadow.rasterize(instances, light, self.detail);
            self.rasterize_colored(instances, camera);
            frame.rgb.resize(3 * camera.intrinsics().pixels(), 0);
            let mut pixels = frame.rgb.chunks_exact_mut(3);
            self.shader(instances, camera, light).rows(|[red, green, blue]| {
                for (((r, g), b), pixel) in red.iter().zip(green).zip(blue).zip(&mut pixels) {
                    pixel.copy_from_slice(&[shown(*r), shown(*g), shown(*b)]);
                }
            });
        } else {
            self.rasterize_plain(instances, camera, channels.segmentation);
        }
        frame.camera = Some(*camera);
        let nothing = nothing(camera);
        let depth = self.raster.nearness.iter().map(|w| if *w > nothing { 1.0 / w } else { 0.0 });
        frame.depth.clear();
        frame.depth.extend(depth);
        frame.segmentation.clear();
        if channels.segmentation {
            let labels = self.raster.ids.iter().map(|id| self.labels[*id as usize]);
            frame.segmentation.extend(labels);
        }
        Ok(())
    }

    /// An antialiased picture, (H, W, 3) red, green, blue: the mean of `samples` x `samples` (1 to 8) images with subpixel shifts.
    ///
    /// # Errors
    /// Those of [`Renderer::render_into`]; [`RenderError::OutOfRange`] for `samples`.
    pub fn picture(
        &mut self,
        instances: &[Instance],
        camera: &Camera,
        light: &Light,
        samples: u32,
    ) -> Result<Vec<u8>, RenderError> {
        in_range("samples", f64::from(samples), 1.0..=8.0, "")?;
        check_instances(instances)?;
        light.check()?;
        self.shadow.rasterize(instances, light, self.detail);
        let mut sums = vec![Vector3::zeros(); camera.intrinsics().pixels()];
        for sample in 0..samples * samples {
            let shift = |k: u32| (f64::from(k) + 0.5) / f64::from(samples) - 0.5;
            let mut intrinsics = *camera.intrinsics();
            intrinsics.cx -= shift(sample % samples);
            intrinsics.cy -= shift(sample / samples);
            let moved = camera.with_intrinsics(intrinsics);
            self.rasterize_colored(instances, &moved);
            let mut pixels = sums.iter_mut();
            self.shader(instances, &moved, light).rows(|[red, green, blue]| {
                for (((r, g), b), sum) in red.iter().zip(green).zip(blue).zip(&mut pixels) {
                    *sum += Vector3::new(*r, *g, *b);
                }
            });
        }
        let share = 1.0 / (samples * samples) as f32;
        Ok(sums.iter().flat_map(|c| [c.x, c.y, c.z].map(|x| shown(x * share))).collect())
    }

    /// Depth, and the instance at each pixel if requested.
    fn rasterize_plain(&mut self, instances: &[Instance], camera: &Camera, keep_ids: bool) {
        let view = View::of_camera(camera, self.detail);
        self.clear(camera, keep_ids);
        for instance in instances {
            let id = self.labels.len() as u32;
            self.labels.push(instance.label);
            let (raster, scratch, sink) = (&mut self.raster, &mut self.scratch, &mut |_: &Piece| id);
            if keep_ids {
                rasterize::<true>(raster, scratch, &view, Cull::Back, instance, id, sink);
            } else {
                rasterize::<false>(raster, scratch, &view, Cull::Back, instance, id, sink);
            }
        }
    }

    /// Depth, and the facet at each pixel.
    fn rasterize_colored(&mut self, instances: &[Instance], camera: &Camera) {
        let view = View::of_camera(camera, self.detail);
        self.clear(camera, true);
        for (index, instance) in instances.iter().enumerate() {
            let id = self.labels.len() as u32;
            let rotation = instance.world_from_model.rotation.cast::<f32>().to_rotation_matrix();
            let (facets, labels, normals) = (&mut self.facets, &mut self.labels, &mut self.normals);
            let mut turned = false;
            let mut sink = |piece: &Piece| {
                if !std::mem::replace(&mut turned, true) {
                    normals.clear();
                    normals.extend(piece.level.normals.iter().map(|n| rotation * n));
                }
                facets.push(Facet::new(piece, normals, index as u32));
                labels.push(instance.label);
                labels.len() as u32
            };
            rasterize::<true>(&mut self.raster, &mut self.scratch, &view, Cull::Back, instance, id, &mut sink);
        }
    }

    fn clear(&mut self, camera: &Camera, keep_ids: bool) {
        let k = camera.intrinsics();
        self.raster.clear(k.width as usize, k.height as usize, nothing(camera), keep_ids);
        self.facets.clear();
        self.labels.clear();
        self.labels.push(0);
    }

    fn shader<'a>(&'a self, instances: &'a [Instance], camera: &'a Camera, light: &'a Light) -> Shader<'a> {
        Shader { raster: &self.raster, facets: &self.facets, instances, shadow: &self.shadow, light, camera }
    }
}

/// Nearness at the far clipping depth.
fn nothing(camera: &Camera) -> f32 {
    (1.0 / camera.far()) as f32
}
