//! State of an episode besides its world, judge and arm: plain values, part of every saved state.
//!
//! | module | purpose |
//! |---|---|
//! | `bounds` | bounds of the numbers of a saved state |
//! | [`goal`] | a position that the hand or the object is to reach |
//! | [`record`] | what every episode has |
//! | [`mode`] | the mode of an episode, with the state that only this mode needs |
//! | [`placed`] | objects of a scene at rest; a target among others |

pub(crate) mod bounds;
pub mod goal;
pub mod mode;
pub mod placed;
pub mod record;

pub use goal::{Goal, GoalConfig, GoalTask};
pub use mode::{ClearState, DecisionResult, GraspPoseState, GraspState, LastAttempt, Mode, SceneKind};
pub use placed::{Placed, TargetScene};
pub use record::Record;
