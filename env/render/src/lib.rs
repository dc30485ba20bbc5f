//! A software renderer: images of triangle meshes and hands from pinhole cameras, on CPUs.
//!
//! Own code: GPU renderers need a GPU or a display, and their images differ between drivers; experiments must be reproducible on machines
//! without a GPU.
//!
//! | module | purpose |
//! |---|---|
//! | [`camera`] | pinhole cameras: intrinsics, pose, range; project and unproject |
//! | [`model`] | geometry to render, with levels of detail of known error |
//! | [`shapes`] | meshes of boxes, cylinders and balls |
//! | [`scene`] | instances of models, and the light |
//! | [`renderer`] | [`Renderer`]: from a scene and a camera to a [`Frame`]; batches on rayon |
//! | [`frame`](mod@frame) | depth, rgb, segmentation; points |
//! | [`views`](mod@views) | cameras around an object |
//! | [`occupancy`](mod@occupancy) | fusion of depth images into voxels: occupied, free, unseen |
//! | [`hand_model`], [`labels`] | models and colours of a hand; labels of a segmentation, colours of objects |
//! | [`scene_pose`] | objects, fixed boxes and hand of a scene at one instant; an object from many sides |
//! | [`mod@observer`] | [`Observer`]: images by name and pictures of many environments; camera poses and light of an episode |
//! | `renderer/rasterize`, `renderer/raster` | transform, cull, clip; then scanlines into an inverse-depth buffer |
//! | `renderer/shade`, `renderer/shadow` | colour of each pixel, and the shadow map |
//! | [`error`] | errors, one sentence each |
//!
//! Camera frame: +z forward, +x right, +y down (OpenCV's). Pixel (u, v) has its centre at (u + 0.5, v + 0.5); row 0 is the upper one.
//! Metres; world +z is up. At [`Detail::Full`] depth equals that of a ray cast through each pixel's centre.
//! Images have the same bits on any number of threads.
//!
//! A ball seen from 1 m away: the middle pixel shows its nearest point.
//!
//! ```
//! use graspbox_render::{Camera, Channels, Detail, Instance, Intrinsics, Light, Model, Renderer, shapes};
//! use nalgebra::{Isometry3, Point3, Vector3};
//!
//! let ball = Model::new(&shapes::sphere(0.1, 64)?)?;
//! let instance = Instance {
//!     model: &ball,
//!     world_from_model: Isometry3::identity(),
//!     color: [0.9, 0.3, 0.2],
//!     label: 7,
//!     casts_shadow: true,
//! };
//! let lens = Intrinsics::from_fov(65, 65, 0.5)?;
//! let camera = Camera::look_at(lens, Point3::new(1.0, 0.0, 0.0), Point3::origin(), Vector3::z())?;
//! let channels = Channels { rgb: true, segmentation: true };
//! let frame = Renderer::new(Detail::Full).render(&[instance], &camera, &Light::default(), channels)?;
//! assert!((frame.depth[65 * 32 + 32] - 0.9).abs() < 1e-4);
//! assert_eq!((frame.segmentation[65 * 32 + 32], frame.segmentation[0]), (7, 0));
//! # Ok::<(), graspbox_render::RenderError>(())
//! ```
//!
//! Labels of a segmentation: [`labels::BACKGROUND`], [`labels::TABLE`] (ground and walls included), [`labels::OBJECT`], then
//! [`labels::FIRST_LINK`] + i for link i of the hand. No image contains the pose of the object.
//!
//! A cube on the table in an image of the default camera `front`:
//!
//! ```
//! use graspbox_render::labels::{OBJECT, TABLE, object_color};
//! use graspbox_render::{
//!     BoxKind, CameraConfig, Channels, Detail, FixedBox, Light, Model, ObjectPose, ScenePose, render_views, shapes,
//! };
//! use nalgebra::{Isometry3, Vector3};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let cube = Model::new(&shapes::cuboid(Vector3::repeat(0.03), 0.0)?)?;
//! let table = FixedBox::new(BoxKind::Table, Vector3::new(0.6, 0.6, 0.05), Isometry3::translation(0.0, 0.0, -0.05))?;
//! let scene = ScenePose {
//!     objects: vec![ObjectPose {
//!         model: &cube,
//!         color: object_color("cube"),
//!         label: OBJECT,
//!         world_from_object: Isometry3::translation(0.0, 0.0, 0.03),
//!     }],
//!     fixed: &[table],
//!     world_from_hand: Isometry3::identity(),
//!     world_from_links: Vec::new(), // no hand
//! };
//! let camera = CameraConfig::front().camera(64, 64)?;
//! let channels = Channels { segmentation: true, ..Channels::default() };
//! let frames = render_views(&scene, &[camera], &Light::default(), channels, Detail::Auto)?;
//! let at = |row: usize, column: usize| frames[0].segmentation[64 * row + column];
//! assert_eq!((at(38, 32), at(60, 4)), (OBJECT, TABLE));
//! # Ok(())
//! # }
//! ```

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::panic))]

pub mod camera;
pub mod error;
pub mod frame;
pub mod hand_model;
pub mod labels;
pub mod model;
mod normals;
pub mod observer;
pub mod occupancy;
pub mod renderer;
pub mod scene;
pub mod scene_pose;
pub mod shapes;
pub mod views;

pub use camera::{Camera, Intrinsics, Pixel};
pub use error::RenderError;
pub use frame::Frame;
pub use hand_model::HandModel;
pub use model::{Detail, Model};
pub use observer::config::{CameraConfig, CamerasConfig, Mount};
pub use observer::image_spec::{ImageKind, ImageSpec, ImageTable, Pixels};
pub use observer::viewpoint::Viewpoint;
pub use observer::{Observer, PictureConfig};
pub use occupancy::{DepthView, Occupancy, occupancy};
pub use renderer::{Channels, Job, Renderer, render_batch};
pub use scene::{Instance, Light};
pub use scene_pose::{BoxKind, FixedBox, ObjectPose, ScenePose, render_views};
pub use views::{Pattern, ViewPlan, views};
