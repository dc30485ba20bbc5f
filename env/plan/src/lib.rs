//! Planning is purely geometric: boxes, candidate poses, collision filter, ranking. No dynamics here.
//!
//! | module | what it does |
//! |---|---|
//! | [`boxes`] | minimum-volume box decomposition of a surface |
//! | [`error`] | every way an input can be wrong, one sentence each |
//!
//! Units are metres and radians; boxes and poses are in the object's frame (the mesh's own).

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::panic))]

pub mod boxes;
pub mod error;
mod sample;

pub use boxes::{
    BoxNode, BoxTree, BoxTreeFault, DecomposeParams, Fit, OrientedBox, Split, SplitCost, best_split, check_box_tree,
    decompose, decompose_points, fit_box,
};
pub use error::PlanError;
