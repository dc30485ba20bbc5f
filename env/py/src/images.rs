//! Pictures, images of scenes, and their evaluation by policies.

pub mod perception;
pub mod render;
pub mod scene_images;
mod still_scene;
pub mod vision;
pub mod voxel;
