//! The tables of `arm.toml`: every number with unit and source.

use serde::Deserialize;
use toml::Spanned;

use crate::table::{MountTable, Named, Number};

/// Declares tables of the file; unknown fields are errors.
macro_rules! tables {
    ($($table:item)*) => { $(#[derive(Debug, Clone, Deserialize)] #[serde(deny_unknown_fields)] $table)* };
}

tables! {
    /// The whole file.
    pub(crate) struct ArmTable {
        pub name: Spanned<String>,
        /// Link of the URDF that does not move.
        pub base: Spanned<String>,
        /// Link of the URDF whose frame is the flange.
        pub flange: Spanned<String>,
        pub payload: Number<f64>,
        /// Position of every axis at home, by the name of its joint.
        pub home: Named<Number<f64>>,
        #[serde(default)]
        pub limits: Named<LimitTable>,
        /// What lowers the speeds of joints near the ends of their ranges, by the name of the joint.
        #[serde(default)]
        pub slowing: Named<SlowingTable>,
        /// Mounting frames of hands in the flange frame, by the name of the hand.
        #[serde(default)]
        pub mounts: Named<MountTable>,
    }

    /// Limits of joints; without `names`, of the joint of the table's own name.
    pub(crate) struct LimitTable {
        pub names: Option<Vec<Spanned<String>>>,
        /// Instead of the range in the URDF.
        pub position: Option<Number<[f64; 2]>>,
        /// Instead of the velocity in the URDF.
        pub speed: Option<Number<f64>>,
        pub acceleration: Option<Number<f64>>,
        pub jerk: Option<Number<f64>>,
    }

    /// Speeds near the ends of a range: see [`Slowing`](super::Slowing).
    pub(crate) struct SlowingTable {
        pub ends: Number<[f64; 2]>,
        pub rate: Number<f64>,
        pub offset: Number<f64>,
    }
}
