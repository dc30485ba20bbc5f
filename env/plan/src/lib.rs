//! Planning is purely geometric: boxes, candidate poses, collision filter, ranking. No dynamics here.
//!
//! | module | what it does |
//! |---|---|
//! | [`boxes`] | minimum-volume box decomposition of a surface |
//! | [`collision`] | the filter: open hand against object and table, at the pose and on the approach |
//! | [`planner`] | [`plan`]: all of it, in order |
//! | `poses`, `preshape` | candidate poses from boxes, and how the fingers are set for them |
//! | `open_hand` | the open hand as swept shapes |
//! | `rank` | the score that orders feasible poses |
//! | [`wrench`] | the epsilon quality of contacts, predicted or present |
//! | [`error`] | every way an input can be wrong, one sentence each |
//!
//! Units are metres and radians; boxes and poses are in the object's frame (the mesh's own).

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::panic))]

pub mod boxes;
pub mod collision;
pub mod error;
mod open_hand;
pub mod planner;
mod poses;
mod preshape;
mod rank;
pub mod wrench;

pub use boxes::{
    BoxNode, BoxTree, BoxTreeFault, DecomposeParams, Fit, OrientedBox, Split, SplitCost, best_split, check_box_tree,
    decompose, decompose_points, fit_box,
};
pub use collision::{CollisionScene, Feasibility, Obstacle};
pub use error::PlanError;
pub use open_hand::OpenHand;
pub use planner::{Candidate, Plan, PlanObject, PlanParams, plan};
pub use poses::{HandFrame, PoseParams, Variation};
pub use rank::{Prediction, RANK_TERMS, rank_features, rank_weights};
pub use wrench::{Directions, WrenchSpace};
