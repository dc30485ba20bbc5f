//! A software renderer: what pinhole cameras see of triangle meshes, on the processor alone.
//!
//! | module | what it does |
//! |---|---|
//! | [`camera`] | pinhole cameras: intrinsics, pose, range; project and unproject |
//! | [`model`] | geometry to render, with levels of detail whose errors are known |
//! | [`shapes`] | meshes of boxes, cylinders and balls |
//! | [`scene`] | instances of models, and the light |
//! | [`renderer`] | [`Renderer`]: a scene and a camera to a [`Frame`]; many of them on rayon |
//! | [`frame`](mod@frame) | depth, rgb, segmentation; millimetres and points made of them |
//! | [`views`](mod@views) | cameras around an object by a plan |
//! | [`occupancy`](mod@occupancy) | depth images to voxels: occupied, free, unseen |
//! | `rasterize`, `raster` | transform, cull, clip; then scanlines into a buffer of inverse depths |
//! | `shade`, `shadow` | colour of each pixel, and the map of what the light sees |
//! | [`error`] | every way an input can be wrong, one sentence each |
//!
//! Camera frame: +z forward, +x right, +y down (OpenCV's). Pixel (u, v) has its centre at (u + 0.5, v + 0.5); row 0 is the upper one.
//! Metres; world +z is up. At [`Detail::Full`] depth is what casting a ray through each pixel's centre would give.
//! Images have the same bits on any number of threads.

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
