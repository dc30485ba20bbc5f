//! Actions, and the limits of the hand's motion.
//!
//! | module | purpose |
//! |---|---|
//! | [`control`] | control modes, fingers, and the timing of control |
//! | [`action`] | the meaning of an action's entries |
//! | [`workspace`] | boxes and distances of the workspace |
//! | [`arm_controller`] | motion of the hand within limits |
//! | [`joint_drive`] | the same by the joints of an arm |
//! | [`guard`] | distance from the table, and the protective stop |
//! | [`decision`] | one decision per episode: the trial at a pose |

pub mod action;
pub mod arm_controller;
pub mod control;
pub mod decision;
pub mod guard;
pub mod joint_drive;
pub mod workspace;
