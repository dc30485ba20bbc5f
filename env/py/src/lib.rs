//! The only crate that uses Python: arrays, paths and configs cross, nothing else.
//!
//! | module | purpose |
//! |---|---|
//! | [`mod@bench`] | timings of operations that are too short to be timed through Python |
//! | [`config`] | the configs that cross |
//! | [`convert`] | arrays, with all checks of shapes and numbers |
//! | [`environments`] | environments, their objects and results; servers and clients |
//! | [`episode`] | an object at rest, and trials on it |
//! | [`errors`] | one error type, and the Python exception of each error |
//! | [`gil`] | releases the GIL, catches panics, checks for Ctrl-C, owns the thread pools |
//! | [`hand`] | the handle on a hand |
//! | [`images`] | pictures, images of scenes, candidates of grasps in them, voxels |
//! | [`layout`] | several objects at rest |
//! | [`log`] | log events of the core, for Python's `logging` |
//! | [`mesh`] | the handle on a mesh |
//! | [`plan`] | box trees and plans |
//!
//! `python/graspbox/_core.pyi` is this module's contract.

pub mod bench;
pub mod config;
pub mod convert;
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

    #[pymodule_export]
    use crate::bench::{time_best_split, time_reset};
    #[pymodule_export]
    use crate::config::config_again;
    #[pymodule_export]
    use crate::convert::is_rigid;
    #[pymodule_export]
    use crate::environments::client::{Client, PolicyClient};
    #[pymodule_export]
    use crate::environments::env_pool::{EnvPool, Objects, agent_tables, sampled_objects};
    #[pymodule_export]
    use crate::environments::objects::{procedural, procedural_families};
    #[pymodule_export]
    use crate::environments::policy_server::{PolicyJob, PolicyServer};
    #[pymodule_export]
    use crate::environments::server::{Job, Server};
    #[pymodule_export]
    use crate::episode::Scene;
    #[pymodule_export]
    use crate::gil::{num_threads, spin};
    #[pymodule_export]
    use crate::hand::Hand;
    #[pymodule_export]
    use crate::images::perception::{HandGrid, add_depth_noise, channel_names, crops, solids};
    #[pymodule_export]
    use crate::images::render::render;
    #[pymodule_export]
    use crate::images::scene_images::{camera_poses, occupancies, render_scenes};
    #[pymodule_export]
    use crate::images::vision::{image_kinds, image_tables, occupancy, pictures, poses_of_cameras, time_images, views};
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
        module.add("PACKED_ATTEMPTS", graspbox_episode::layout::PACKED_ATTEMPTS)?;
        module.add("CLEAR_OF_TABLE", graspbox_episode::judge::CLEAR_OF_TABLE)?;
        module.add("REST_TIME", graspbox_episode::judge::REST_TIME)?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
