//! Images of a scene: cameras in the world and on the hand, images by name, pictures for people.
//!
//! | module | purpose |
//! |---|---|
//! | [`config`] | the cameras and their images |
//! | [`image_spec`] | one image by name: its table row, and its values from a frame |
//! | [`viewpoint`] | camera poses and light of one episode, sampled or set |
//! | [`visual_models`] | models and colours of hand, table and ground; the render scene of the current state |
//! | [`views`] | an object from many sides, without a hand |
//! | [`observer`] | [`Observer`]: images and pictures of many environments, with reused render buffers |
//! | `error` | errors, one sentence each |
//!
//! Labels of a segmentation: [`visual_models::BACKGROUND`], [`visual_models::TABLE`] (ground included), [`visual_models::OBJECT`],
//! then [`visual_models::FIRST_LINK`] + i for link i of the hand. No image contains the pose of the object.
//!
//! A cube on the table in an image of the default camera `front`:
//!
//! ```
//! use graspbox_camera::{Channels, Detail, Light, Model, shapes};
//! use graspbox_vision::visual_models::{OBJECT, TABLE, object_color};
//! use graspbox_vision::{CameraConfig, ObjectPose, ScenePose, VisualModels, render_views};
//! use nalgebra::{Isometry3, Vector3};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let cube = Model::new(&shapes::cuboid(Vector3::repeat(0.03), 0.0)?)?;
//! let scene = ScenePose {
//!     objects: vec![ObjectPose {
//!         model: &cube,
//!         color: object_color("cube"),
//!         label: OBJECT,
//!         world_from_object: Isometry3::translation(0.0, 0.0, 0.03),
//!     }],
//!     walls: &[],
//!     world_from_hand: Isometry3::identity(),
//!     world_from_links: Vec::new(), // no hand
//! };
//! let camera = CameraConfig::front().camera(64, 64)?;
//! let channels = Channels { segmentation: true, ..Channels::default() };
//! let frames = render_views(&VisualModels::bare(true)?, &scene, &[camera], &Light::default(), channels, Detail::Auto)?;
//! let at = |row: usize, column: usize| frames[0].segmentation[64 * row + column];
//! assert_eq!((at(38, 32), at(60, 4)), (OBJECT, TABLE));
//! # Ok(())
//! # }
//! ```

pub mod config;
mod error;
pub mod image_spec;
pub mod observer;
pub mod viewpoint;
pub mod views;
pub mod visual_models;

pub use config::{CameraConfig, CamerasConfig, Mount};
pub use error::VisionError;
pub use image_spec::{ImageKind, ImageSpec, ImageTable, Pixels};
pub use observer::{Observer, PictureConfig};
pub use viewpoint::Viewpoint;
pub use views::render_views;
pub use visual_models::{ObjectPose, ScenePose, VisualModels, WallModel};
