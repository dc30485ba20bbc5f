//! What is to be seen of an episode: cameras in the world and on the hand, images by name, pictures to look at.
//!
//! | module | what it does |
//! |---|---|
//! | [`config`] | the cameras, and which images are taken |
//! | [`sight`] | one image by name: its table row, and how a frame becomes its numbers |
//! | [`look`] | where the cameras stand and how it is lit in one episode, drawn or given |
//! | [`stage`] | models and colours of hand, table and ground; the scene at one moment |
//! | [`around`] | an object from many sides, without a hand |
//! | [`seer`] | [`Eyes`]: images and pictures of many environments, with memory that is used again |
//!
//! Labels of a segmentation: [`stage::BACKGROUND`], [`stage::TABLE`] (ground included), [`stage::OBJECT`], then
//! [`stage::FIRST_LINK`] + i for link i of the hand. No image holds a pose of the object.

pub mod around;
pub mod config;
pub mod look;
pub mod seer;
pub mod sight;
pub mod stage;

pub use around::look_around;
pub use config::{CameraConfig, EyesConfig, Mount};
pub use look::Look;
pub use seer::{Eyes, PictureConfig};
pub use sight::{ImageTable, Kind, Pixels, Sight};
pub use stage::{Moment, Stage};
