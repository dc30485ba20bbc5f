//! Triangle meshes and what grasping needs of them.
//!
//! | module | what it does |
//! |---|---|
//! | [`trimesh`] | the mesh itself: vertices, faces, bounds, area, volume |
//! | [`error`] | every way an input can be wrong, one sentence each |
//!
//! Units are metres and kilograms; a mesh keeps the frame of its file.

pub mod error;
pub mod trimesh;

pub use error::MeshError;
pub use trimesh::{Aabb, TriMesh};
