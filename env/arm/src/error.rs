//! Errors of arms, one sentence each.

/// Why it cannot be said what an arm reaches.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ArmError {
    /// The base is where the table is.
    #[error(
        "the base of the arm is at z = {z:.3} m, under the table (the plane z = 0); give world_from_base with the base on the table or over it"
    )]
    UnderTable {
        /// Height of the base's origin, metres.
        z: f64,
    },
    /// The hand is heavier than the arm may carry.
    #[error(
        "hand \"{hand}\" weighs {mass:.2} kg, but arm \"{arm}\" carries {payload:.2} kg; choose another arm or hand"
    )]
    TooHeavy { hand: String, arm: String, mass: f64, payload: f64 },
    /// The mounted hand touches the arm where nothing moves.
    #[error(
        "hand \"{hand}\" touches link \"{link}\" of arm \"{arm}\" at home; give its mount as [mounts.{hand}] in the arm.toml, or as `mount`"
    )]
    MountedInArm { hand: String, arm: String, link: String },
    /// A preshape that the hand cannot take.
    #[error("hand \"{hand}\" cannot take the preshape {preshape}")]
    Preshape { hand: String, preshape: f64 },
    /// A number of a config that is out of range.
    #[error("{name} is {value}; it must be {must}")]
    OutOfRange { name: &'static str, value: f64, must: &'static str },
    /// More of something than is accepted.
    #[error("there are {count} {what}; give at most {limit}")]
    TooMany { what: &'static str, count: usize, limit: usize },
}
