//! Rewards: named terms, from bounded potentials.
//!
//! | module | purpose |
//! |---|---|
//! | [`goal_terms`] | those of environments with goals |
//! | [`reward`] | the named terms |
//! | [`potentials`] | bounded potentials |
//! | [`grasp_quality`] | epsilon of the present contacts |

pub mod goal_terms;
pub mod grasp_quality;
pub mod potentials;
pub mod reward;
