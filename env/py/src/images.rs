//! Pictures, images of scenes, and their evaluation by policies.
//!
//! | module | purpose |
//! |---|---|
//! | [`mod@render`] | pictures of any meshes and a hand, from any camera |
//! | [`vision`] | images of environments and objects, pictures, cameras |
//! | [`mod@perception`] | from depth images to candidate grasps, and voxels around the hand |
//! | [`mod@scene_images`] | images of many resting objects, and voxels from many depth images |
//! | `still_scene` | objects and walls at rest, ready to be rendered |
//! | [`voxel`] | voxels, and their files |

pub mod perception;
pub mod render;
pub mod scene_images;
mod still_scene;
pub mod vision;
pub mod voxel;
