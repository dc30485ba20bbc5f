//! The only crate that knows Python: arrays, paths and configs cross, nothing else.
//!
//! | module | purpose |
//! |---|---|
//! | [`mod@bench`] | timings of operations that are too short to be timed through Python |
//! | [`config`] | the configs that cross |
//! | [`mod@client`] | a session on a server |
//! | [`convert`] | arrays, with all checks of shapes and numbers |
//! | [`mod@render`] | pictures of any meshes and a hand, from any camera |
//! | [`errors`] | one error type, and the Python exception of each error |
//! | [`log`] | log events of the core, for Python's `logging` |
//! | [`vision`] | images of environments and objects, pictures, cameras |
//! | [`frames`] | values of frames as Python objects, and back |
//! | [`gil`] | releases the GIL, catches panics, checks for Ctrl-C, owns the thread pools |
//! | [`episode`] | an object at rest, and trials on it |
//! | [`hand`] | the handle on a hand |
//! | [`mesh`] | the handle on a mesh |
//! | [`mod@perception`] | from depth images to candidate grasps, and voxels around the hand |
//! | [`mod@policy_server`] | a server of a policy |
//! | [`plan`] | box trees and plans |
//! | [`objects`] | objects by family and seed |
//! | [`env_arrays`] | results of environments as arrays by name |
//! | [`env_pool`] | many environments in one call |
//! | [`mod@server`] | a server of environments |
//! | [`mod@scene_images`] | images of many resting objects, and voxels from many depth images |
//! | [`voxel`] | voxels, and their files |
//!
//! `python/graspbox/_core.pyi` is this module's contract.

pub mod bench;
pub mod client;
pub mod config;
pub mod convert;
pub mod env_arrays;
pub mod env_pool;
pub mod episode;
pub mod errors;
pub mod frames;
pub mod gil;
pub mod hand;
pub mod log;
pub mod mesh;
pub mod objects;
pub mod perception;
pub mod plan;
pub mod policy_server;
pub mod render;
pub mod scene_images;
pub mod server;
pub mod vision;
pub mod voxel;

use pyo3::prelude::*;

#[pymodule]
mod _core {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::bench::{time_best_split, time_reset};
    #[pymodule_export]
    use crate::client::{Client, PolicyClient};
    #[pymodule_export]
    use crate::config::config_again;
    #[pymodule_export]
    use crate::convert::is_rigid;
    #[pymodule_export]
    use crate::env_pool::{EnvPool, Objects, agent_tables, sampled_objects};
    #[pymodule_export]
    use crate::episode::Scene;
    #[pymodule_export]
    use crate::gil::{num_threads, spin};
    #[pymodule_export]
    use crate::hand::Hand;
    #[pymodule_export]
    use crate::mesh::Mesh;
    #[pymodule_export]
    use crate::objects::{procedural, procedural_families};
    #[pymodule_export]
    use crate::perception::{HandGrid, add_depth_noise, channel_names, crops, solids};
    #[pymodule_export]
    use crate::plan::{decompose, plan, rank_weights};
    #[pymodule_export]
    use crate::policy_server::{PolicyJob, PolicyServer};
    #[pymodule_export]
    use crate::render::render;
    #[pymodule_export]
    use crate::scene_images::{camera_poses, occupancies, render_scenes};
    #[pymodule_export]
    use crate::server::{Job, Server};
    #[pymodule_export]
    use crate::vision::{image_kinds, image_tables, occupancy, pictures, poses_of_cameras, time_images, views};
    #[pymodule_export]
    use crate::voxel::{load_binvox, save_binvox, voxelize};

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        crate::log::install();
        module.add("CLEAR_OF_TABLE", graspbox_episode::judge::CLEAR_OF_TABLE)?;
        module.add("REST_TIME", graspbox_episode::judge::REST_TIME)?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
