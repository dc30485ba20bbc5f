//! Planning is purely geometric: boxes, candidate poses, collision filter, ranking. No dynamics here.
//!
//! | module | purpose |
//! |---|---|
//! | [`boxes`] | minimum-volume box decomposition of a surface |
//! | [`collision`] | the filter: open hand against object, table and neighbours, at the pose and on the approach; what it pushes aside |
//! | [`planner`] | [`plan`]: all steps, in order |
//! | `poses`, `preshape` | candidate poses from boxes, and suitable preshapes for a face |
//! | `chain` | closing of a chain of the hand until it is blocked |
//! | `pairs` | candidate poses across walls and rims, for hands with a bounded opening |
//! | `open_hand` | the open hand as swept shapes |
//! | `rank` | the score that orders feasible poses |
//! | [`wrench`] | the epsilon quality of predicted or present contacts |
//! | [`error`] | errors, one sentence each |
//!
//! Units are metres and radians; boxes and poses are in the object's frame (the mesh's own).
//!
//! The decomposition of a brick is one box of the same volume:
//!
//! ```
//! use graspbox_mesh::convex_hull;
//! use graspbox_plan::{DecomposeParams, decompose};
//! use nalgebra::Point3;
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let corner = |i: usize| Point3::new([-0.1, 0.1][i & 1], [-0.03, 0.03][i >> 1 & 1], [0.0, 0.05][i >> 2]);
//! let brick = convex_hull(&(0..8).map(corner).collect::<Vec<_>>())?;
//! let tree = decompose(&brick, &DecomposeParams::default())?;
//! assert_eq!(tree.boxes().len(), 1);
//! assert!((tree.volume() / (0.2 * 0.06 * 0.05) - 1.0).abs() < 1e-6);
//! # Ok(())
//! # }
//! ```

#![cfg_attr(test, allow(clippy::unwrap_used, clippy::panic))]

pub mod boxes;
mod chain;
pub mod collision;
pub mod error;
mod open_hand;
mod pairs;
pub mod planner;
mod poses;
mod preshape;
mod rank;
pub mod wrench;

/// Four numbers that are computed at once.
type Lanes = parry3d_f64::glamx::glam::Vec4;

pub use boxes::{
    BoxNode, BoxTree, BoxTreeFault, DecomposeParams, Fit, OrientedBox, Split, SplitCost, best_split, check_box_tree,
    decompose, decompose_points, fit_box,
};
pub use collision::{CollisionScene, Feasibility, Neighbour, Obstacle, Touch};
pub use error::PlanError;
pub use open_hand::OpenHand;
pub use planner::{Candidate, Plan, PlanObject, PlanParams, box_grasps, check_grasps, plan};
pub use poses::{PoseParams, Variation};
pub use preshape::closing_center;
pub use rank::{Prediction, rank_features, rank_weights};
pub use wrench::{Directions, WrenchSpace};
