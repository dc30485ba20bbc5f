//! One image by name: its table row, and its values from a frame.

use crate::labels::FIRST_LINK;
use crate::observer::config::CamerasConfig;
use crate::{Camera, Frame, Intrinsics, RenderError};
use serde::Serialize;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageKind {
    /// (H, W, 3) uint8.
    Rgb,
    /// (H, W, 1) float32: metres along the optical axis.
    Depth,
    /// (H, W, 4) float32: red, green, blue in [0, 1], then depth.
    Rgbd,
    /// (H, W, 1) uint8: labels.
    Segmentation,
    /// (H, W, K) uint8: for each of K objects, whether its pixel would show it if nothing else were there.
    Amodal,
    /// (H, W, 3) float32: the visible point at each pixel, in the camera's frame.
    Points,
    /// (N, N, N) uint8: unseen, free or occupied space.
    Voxels,
}

impl ImageKind {
    /// Every kind.
    pub const ALL: [Self; 7] =
        [Self::Rgb, Self::Depth, Self::Rgbd, Self::Segmentation, Self::Amodal, Self::Points, Self::Voxels];

    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Rgb => "rgb",
            Self::Depth => "depth",
            Self::Rgbd => "rgbd",
            Self::Segmentation => "segmentation",
            Self::Amodal => "amodal",
            Self::Points => "points",
            Self::Voxels => "voxels",
        }
    }

    /// Values per pixel, or per voxel, in scenes of at most `objects`.
    fn channels(self, objects: usize) -> usize {
        match self {
            Self::Rgb | Self::Points => 3,
            Self::Rgbd => 4,
            Self::Amodal => objects,
            Self::Depth | Self::Segmentation | Self::Voxels => 1,
        }
    }

    fn is_bytes(self) -> bool {
        matches!(self, Self::Rgb | Self::Segmentation | Self::Amodal | Self::Voxels)
    }
}

/// One image: its kind and its cameras.
///
/// `depth` is taken by the first camera, `depth_palm` by the camera `palm`, and likewise for every kind. `voxels` fuses the depth
/// images of all cameras; `voxels_palm` uses that of `palm`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ImageSpec {
    pub name: String,
    pub kind: ImageKind,
    /// The cameras that take it; several for voxels only.
    pub cameras: std::ops::Range<usize>,
    /// Most objects of a scene.
    pub objects: usize,
}

/// Pixel values of one type.
#[derive(Clone, Debug, PartialEq)]
pub enum Pixels {
    /// uint8.
    Bytes(Vec<u8>),
    /// float32.
    Floats(Vec<f32>),
}

impl Pixels {
    /// Empty, with capacity for `size` values.
    #[must_use]
    pub fn with_capacity(kind: ImageKind, size: usize) -> Self {
        if kind.is_bytes() { Self::Bytes(Vec::with_capacity(size)) } else { Self::Floats(Vec::with_capacity(size)) }
    }

    /// Appends values of the same type; values of the other type are ignored.
    pub fn extend(&mut self, more: &Self) {
        match (self, more) {
            (Self::Bytes(own), Self::Bytes(more)) => own.extend_from_slice(more),
            (Self::Floats(own), Self::Floats(more)) => own.extend_from_slice(more),
            (Self::Bytes(_), Self::Floats(_)) | (Self::Floats(_), Self::Bytes(_)) => {}
        }
    }
}

/// A row of the table of images.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ImageTable {
    pub name: String,
    pub kind: &'static str,
    /// (H, W, C), or (N, N, N) for voxels.
    pub shape: [usize; 3],
    /// `uint8` or `float32`.
    pub dtype: &'static str,
    /// Least value of each channel, or one for all.
    pub low: Vec<f64>,
    /// Greatest value of each channel, or one for all.
    pub high: Vec<f64>,
    /// Names of the cameras.
    pub cameras: Vec<String>,
    /// Frame of its values.
    pub frame: &'static str,
    pub unit: &'static str,
    /// The value of background pixels.
    pub missing: &'static str,
    pub meaning: &'static str,
    /// True if a real robot has no sensor for it: labels and masks come from the simulation, although they contain no pose.
    pub privileged: bool,
}

impl ImageSpec {
    /// Parses a name.
    ///
    /// * `objects`: most objects of a scene.
    ///
    /// # Errors
    /// [`RenderError::UnknownImage`].
    pub fn parse(name: &str, config: &CamerasConfig, objects: usize) -> Result<Self, RenderError> {
        let unknown = || RenderError::UnknownImage {
            name: name.to_owned(),
            cameras: config.cameras.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", "),
        };
        let (kind, camera) = name.split_once('_').map_or((name, None), |(k, c)| (k, Some(c)));
        let kind = ImageKind::ALL.into_iter().find(|k| k.name() == kind).ok_or_else(unknown)?;
        let cameras = match camera {
            None if kind == ImageKind::Voxels => 0..config.cameras.len(),
            None => 0..1,
            Some(camera) => {
                let at = config.cameras.iter().position(|c| c.name == camera).ok_or_else(unknown)?;
                at..at + 1
            }
        };
        Ok(Self { name: name.to_owned(), kind, cameras, objects })
    }

    /// Rows, columns, channels; or voxels along each axis.
    #[must_use]
    pub fn shape(&self, config: &CamerasConfig) -> [usize; 3] {
        let [height, width] = config.image_size.map(|n| n as usize);
        match self.kind {
            ImageKind::Voxels => [config.voxels; 3],
            kind => [height, width, kind.channels(self.objects)],
        }
    }

    /// Number of values.
    #[must_use]
    pub fn size(&self, config: &CamerasConfig) -> usize {
        self.shape(config).iter().product()
    }

    /// Its row of the table of images.
    ///
    /// * `mounted`: the cameras of `config`, posed in the frame of their mount.
    /// * `labels`: number of links of the hand, and of the objects after the first.
    #[must_use]
    pub fn table(&self, config: &CamerasConfig, mounted: &[Camera], labels: usize) -> ImageTable {
        let camera = &mounted[self.cameras.start];
        let (low, high) = bounds(self.kind, camera, labels);
        let (frame, unit, missing, meaning) = match self.kind {
            ImageKind::Rgb => ("camera", "1", "the background's colour", "red, green, blue"),
            ImageKind::Depth => ("camera", "m", "0", "distance along the optical axis (not along the ray)"),
            ImageKind::Rgbd => {
                ("camera", "1; m", "the background's colour; 0", "red, green, blue in [0, 1], then depth")
            }
            ImageKind::Segmentation => {
                let labels = "0 background, 1 table, ground and walls, 2 object (among others the target), \
                              3 + i link i of the hand, then the other objects";
                ("camera", "1", "0", labels)
            }
            ImageKind::Amodal => {
                let masks = "1 where an object would be seen if nothing else were there; channels in the order of its \
                             labels in `segmentation`, 0 for objects that are gone";
                ("camera", "1", "0", masks)
            }
            ImageKind::Points => {
                ("camera", "m", "0, 0, 0", "the point seen: x right, y down, z forward from the camera")
            }
            ImageKind::Voxels => {
                ("world", "1", "0", "0 unseen, 1 free, 2 occupied (by table, object or hand); axes x, y, z")
            }
        };
        ImageTable {
            name: self.name.clone(),
            kind: self.kind.name(),
            shape: self.shape(config),
            dtype: if self.kind.is_bytes() { "uint8" } else { "float32" },
            low,
            high,
            cameras: config.cameras[self.cameras.clone()].iter().map(|c| c.name.clone()).collect(),
            frame,
            unit,
            missing,
            meaning,
            privileged: matches!(self.kind, ImageKind::Segmentation | ImageKind::Amodal),
        }
    }

    /// Writes the pixels of `frame`; voxels and amodal masks are computed by [`Observer`](crate::Observer).
    pub(crate) fn fill(&self, frame: &Frame, out: &mut Pixels) {
        match out {
            Pixels::Bytes(out) => {
                out.clear();
                out.extend_from_slice(if self.kind == ImageKind::Rgb { &frame.rgb } else { &frame.segmentation });
            }
            Pixels::Floats(out) => {
                out.clear();
                match self.kind {
                    ImageKind::Points => out.extend(frame.points().flatten()),
                    ImageKind::Rgbd => {
                        let colors = frame.rgb.as_chunks::<3>().0.iter();
                        let pixel = |([r, g, b], z): (&[u8; 3], &f32)| {
                            let share = |c: &u8| f32::from(*c) / 255.0;
                            [share(r), share(g), share(b), *z]
                        };
                        out.extend(colors.zip(&frame.depth).flat_map(pixel));
                    }
                    _ => out.extend_from_slice(&frame.depth),
                }
            }
        }
    }
}

/// Least and greatest value of each channel.
fn bounds(kind: ImageKind, camera: &Camera, labels: usize) -> (Vec<f64>, Vec<f64>) {
    let far = camera.far();
    match kind {
        ImageKind::Rgb => (vec![0.0], vec![255.0]),
        ImageKind::Depth => (vec![0.0], vec![far]),
        ImageKind::Rgbd => (vec![0.0; 4], vec![1.0, 1.0, 1.0, far]),
        ImageKind::Segmentation => (vec![0.0], vec![(usize::from(FIRST_LINK) + labels - 1) as f64]),
        ImageKind::Points => {
            let Intrinsics { width, height, fx, fy, cx, cy } = *camera.intrinsics();
            let reach = |size: u32, center: f64, focal: f64| center.max(f64::from(size) - center) / focal * far;
            let (x, y) = (reach(width, cx, fx), reach(height, cy, fy));
            (vec![-x, -y, 0.0], vec![x, y, far])
        }
        ImageKind::Amodal => (vec![0.0], vec![1.0]),
        ImageKind::Voxels => (vec![0.0], vec![2.0]),
    }
}
