//! Settings of paths.

use crate::error::ArmError;
use crate::reach::ReachParams;
use serde::{Deserialize, Serialize};

/// Settings of [`path`](super::path).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PathParams {
    pub reach: ReachParams,
    /// Length of the straight approach and of the retreat, along the hand's z, metres.
    pub standoff: f64,
    /// Height of the lift, and of the lowering to a place, metres.
    pub lift: f64,
    /// Most samples of each search for a way.
    pub iterations: usize,
    pub seed: u64,
}

impl Default for PathParams {
    fn default() -> Self {
        Self { reach: ReachParams::default(), standoff: 0.1, lift: 0.1, iterations: 1000, seed: 0 }
    }
}

impl PathParams {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`ArmError::OutOfRange`], which names the field.
    pub fn check(&self) -> Result<(), ArmError> {
        self.reach.check()?;
        let distances = [("clearance", self.reach.clearance), ("point_radius", self.reach.point_radius)];
        let lengths = [("standoff", self.standoff), ("lift", self.lift)];
        // A motion is checked in steps of half the clearance.
        for (name, value) in distances.into_iter().chain(lengths) {
            if !(0.001..=1.0).contains(&value) {
                return Err(ArmError::OutOfRange { name, value, must: "0.001 to 1 m" });
            }
        }
        if self.iterations > 1_000_000 {
            let value = self.iterations as f64;
            return Err(ArmError::OutOfRange { name: "iterations", value, must: "at most 1000000" });
        }
        Ok(())
    }
}
