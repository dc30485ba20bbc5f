//! A software renderer: images of triangle meshes from pinhole cameras, on CPUs.
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
//! | `rasterize`, `raster` | transform, cull, clip; then scanlines into an inverse-depth buffer |
//! | `shade`, `shadow` | colour of each pixel, and the shadow map |
//! | [`error`] | errors, one sentence each |
//!
//! Camera frame: +z forward, +x right, +y down (OpenCV's). Pixel (u, v) has its centre at (u + 0.5, v + 0.5); row 0 is the upper one.
//! Metres; world +z is up. At [`Detail::Full`] depth equals that of a ray cast through each pixel's centre.
//! Images have the same bits on any number of threads.
//!
//! A ball seen from 1 m away: the middle pixel shows its nearest point.
//!
//! ```
//! use graspbox_camera::{Camera, Channels, Detail, Instance, Intrinsics, Light, Model, Renderer, shapes};
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
//! # Ok::<(), graspbox_camera::CameraError>(())
//! ```

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::panic))]

pub mod camera;
pub mod error;
pub mod frame;
pub mod model;
mod normals;
pub mod occupancy;
mod raster;
mod rasterize;
pub mod renderer;
pub mod scene;
mod shade;
mod shadow;
pub mod shapes;
pub mod views;

pub use camera::{Camera, Intrinsics, Pixel};
pub use error::CameraError;
pub use frame::Frame;
pub use model::{Detail, Model};
pub use occupancy::{DepthView, Occupancy, occupancy};
pub use renderer::{Channels, Job, Renderer, render_batch};
pub use scene::{Instance, Light};
pub use views::{Pattern, ViewPlan, views};
