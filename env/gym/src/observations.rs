//! Observations: tables of columns, observations and infos.
//!
//! | module | purpose |
//! |---|---|
//! | [`mod@column`] | one row of a table of columns |
//! | [`view`] | the state of an episode, from which observations and infos are read |
//! | [`observation`], [`observation_row`] | observations, from rows of quantities |
//! | [`sensed`], [`simulated`] | quantities that a real arm and hand measure, and those known only to the simulation |
//! | [`info`] | the info of a step, from one row per entry |
//! | [`tables`] | the tables of all inputs and outputs of environments |
//! | `row_check` | a check of every observation when environments are made |

pub mod column;
pub mod info;
pub mod observation;
pub mod observation_row;
pub(crate) mod row_check;
pub mod sensed;
pub mod simulated;
pub mod tables;
pub mod view;
