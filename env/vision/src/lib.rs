//! What cameras see of a scene: cameras in the world and on the hand, images by name, pictures to look at.
//!
//! | module | what it does |
//! |---|---|
//! | [`config`] | the cameras, and which images are taken |
//! | [`image_spec`] | one image by name: its table row, and how a frame becomes its numbers |
//! | [`viewpoint`] | camera poses and light of one episode, sampled or given |
//! | [`visual_models`] | models and colours of hand, table and ground; the scene at one moment |
//! | [`views`] | an object from many sides, without a hand |
//! | [`observer`] | [`Observer`]: images and pictures of many environments, with render buffers that are reused |
//! | `error` | every way an input can be wrong, one sentence each |
//!
//! Labels of a segmentation: [`visual_models::BACKGROUND`], [`visual_models::TABLE`] (ground included), [`visual_models::OBJECT`],
//! then [`visual_models::FIRST_LINK`] + i for link i of the hand. No image contains the pose of the object.

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
pub use visual_models::{ScenePose, VisualModels};
