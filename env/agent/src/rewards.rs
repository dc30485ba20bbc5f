//! Rewards: named terms, from bounded potentials.
//!
//! | module | purpose |
//! |---|---|
//! | [`reward`] | the named terms |
//! | [`potentials`] | bounded potentials |
//! | [`grasp_quality`] | epsilon of the present contacts |

pub mod grasp_quality;
pub mod potentials;
pub mod reward;
