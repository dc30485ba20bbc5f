//! Box decomposition: fits an oriented box, splits it, and builds a tree of boxes.
//!
//! Own code: the only library function for an oriented box, `obb` of `parry3d`, uses principal axes and does not minimize the volume.
//! `tests/boxes.rs` compares this one with exhaustive searches.
//!
//! | module | purpose |
//! |---|---|
//! | `obb` | [`OrientedBox`] |
//! | `fit` | [`fit_box`]: principal axes or least volume |
//! | `minimum` | the search for the least volume, with `calipers` (plane), `core_set` (extreme points) and `coarse` (in f32), `contacts` (bounds), `cone` (points near an axis), `moments` (frame, signs) |
//! | `split` | [`best_split`]: the best cut, by sorting and sweeping |
//! | `decompose` | [`decompose`], [`decompose_points`]: the tree, with `surface` (clipped triangles) |
//! | `tree` | [`BoxTree`] and [`check_box_tree`] |

mod calipers;
mod coarse;
mod cone;
mod contacts;
mod core_set;
mod decompose;
mod fit;
mod minimum;
mod moments;
mod obb;
mod split;
mod surface;
mod tree;

pub(crate) use core_set::half_sphere;
pub use decompose::{DecomposeParams, decompose, decompose_points};
pub use fit::{Fit, fit_box};
pub use obb::OrientedBox;
pub use split::{Split, SplitCost, best_split};
pub use tree::{BoxNode, BoxTree, BoxTreeFault, check_box_tree};
