//! The only crate that uses Python: arrays, paths and configs cross, nothing else.
//!
//! `python/graspbox/_core.pyi` is the contract of this module.

pub mod arm;
pub mod convert;
pub mod description;
pub mod environments;
pub mod episode;
pub mod errors;
pub mod gil;
pub mod hand;
pub mod images;
pub mod layout;
pub mod log;
pub mod mesh;
pub mod plan;

use pyo3::prelude::*;

#[pymodule]
mod _core {
    use pyo3::prelude::*;
    use pyo3::types::PyTuple;

    #[pymodule_export]
    use crate::arm::Arm;
    #[pymodule_export]
    use crate::arm::paths::arm_path;
    #[pymodule_export]
    use crate::convert::is_rigid;
    #[pymodule_export]
    use crate::description::{describe_urdf, urdf_meshes};
    #[pymodule_export]
    use crate::environments::client::{Client, PolicyClient};
    #[pymodule_export]
    use crate::environments::env_pool::{EnvPool, Objects, env_tables, goal_rewards, sampled_objects};
    #[pymodule_export]
    use crate::environments::listener::Listener;
    #[pymodule_export]
    use crate::environments::objects::{procedural, procedural_families};
    #[pymodule_export]
    use crate::environments::policy_server::{PolicyJob, PolicyListener};
    #[pymodule_export]
    use crate::environments::server::{EnvironmentListener, Job};
    #[pymodule_export]
    use crate::episode::SettledScene;
    #[pymodule_export]
    use crate::gil::num_threads;
    #[pymodule_export]
    use crate::hand::Hand;
    #[pymodule_export]
    use crate::images::perception::{
        HandVolumes, add_depth_noise, channel_names, crops, pixel_groups, pixel_heights, solids,
    };
    #[pymodule_export]
    use crate::images::render::render;
    #[pymodule_export]
    use crate::images::scene_images::{camera_poses, occupancies, render_scenes};
    #[pymodule_export]
    use crate::images::vision::{image_kinds, image_tables, occupancy, pictures, poses_of_cameras, views};
    #[pymodule_export]
    use crate::images::voxel::{load_binvox, save_binvox, voxelize};
    #[pymodule_export]
    use crate::layout::{arrange, bin_walls};
    #[pymodule_export]
    use crate::mesh::Mesh;
    #[pymodule_export]
    use crate::plan::{decompose, plan, rank_weights};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        crate::log::install();
        module.add("MESH_SUFFIXES", PyTuple::new(module.py(), graspbox_mesh::MeshFormat::endings())?)?;
        module.add("REACH_REASONS", PyTuple::new(module.py(), crate::arm::REASONS)?)?;
        module.add("PACKED_ATTEMPTS", graspbox_episode::layout::PACKED_ATTEMPTS)?;
        module.add("CLEAR_OF_TABLE", graspbox_episode::judge::CLEAR_OF_TABLE)?;
        module.add("REST_TIME", graspbox_episode::judge::REST_TIME)?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
