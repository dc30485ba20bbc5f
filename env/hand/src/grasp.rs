//! How a hand grasps: the grasp centre, the actuators that close it, and the preshapes that it can take before it closes.
//!
//! The grasp (hand) frame has its origin on the palm, its z axis along the approach, out of the palm, and its x axis along the direction
//! in which opposing fingers close; the long side of the object lies along y.
//!
//! A preshape is one number for every hand:
//!
//! | hand | preshape |
//! |---|---|
//! | with a preshape coordinate | position of its actuator, rad or m |
//! | with named preshapes only | number of the name, from 0, in the order of the file |
//! | without preshapes | 0 |

use nalgebra::Point3;
use std::collections::BTreeMap;

/// Grasp frame, closing actuators and preshapes of a hand.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Grasp {
    /// Grasp centre, where closed fingers meet: hand frame, metres.
    pub center: Point3<f64>,
    /// Actuators that close the hand; the others stay where the preshape puts them.
    pub closing: Vec<usize>,
    /// Where an object may lie along hand x, from the grasp centre, metres; [0, 0] for a hand whose fingers meet at one place. A hand that
    /// curls to one side holds thin things further out than thick ones.
    pub closing_range: [f64; 2],
    /// The same along hand y; [0, 0] for a hand that holds things in one place.
    pub side_range: [f64; 2],
    /// Greatest turn about hand z that is tried, radians; 0 for a hand that closes only along x.
    pub max_roll: f64,
    /// Greatest turn about hand x that is tried, radians; 0 for a hand that has to face the object.
    pub max_lean: f64,
    /// The actuator whose position is the preshape, if there is one.
    pub coordinate: Option<PreshapeCoordinate>,
    /// The preshapes that the planner tries; never empty. The first is taken where none suits.
    pub preshapes: Vec<Preshape>,
    /// Weights of the planner's ranking that differ from its own, by the name of the term.
    pub ranking: BTreeMap<String, f64>,
}

/// An actuator whose position is the preshape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PreshapeCoordinate {
    pub actuator: usize,
    /// Least and greatest preshape, rad or m.
    pub limits: [f64; 2],
}

/// A preshape by name.
#[derive(Clone, Debug, PartialEq)]
pub struct Preshape {
    pub name: String,
    /// The preshape as one number; see [`crate::grasp`].
    pub value: f64,
    /// Positions of actuators in it; the others are open.
    pub positions: Vec<(usize, f64)>,
    /// The faces that it suits.
    pub face: FaceRule,
    /// Its contribution to the planner's score, in log-odds, relative to the first preshape.
    pub preference: f64,
}

/// Which faces of a box a preshape suits. `length` is the side along hand y, `width` the one along hand x.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaceRule {
    /// Least and greatest length, metres.
    pub length: [f64; 2],
    /// Least and greatest width, metres.
    pub width: [f64; 2],
    /// Greatest ratio of the longer to the shorter side.
    pub max_ratio: f64,
    /// Below this length any ratio suits, metres.
    pub any_ratio_below: f64,
    /// When the hand may be turned by a quarter, its y along the short side.
    pub quarter: QuarterTurn,
}

/// When a hand may be turned by a quarter, its y along the short side of a face.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum QuarterTurn {
    /// On any face.
    Always,
    /// On nearly square faces.
    #[default]
    Square,
    Never,
}

impl Default for FaceRule {
    /// Every face; turned by a quarter where it is nearly square.
    fn default() -> Self {
        Self {
            length: [0.0, f64::INFINITY],
            width: [0.0, f64::INFINITY],
            max_ratio: f64::INFINITY,
            any_ratio_below: 0.0,
            quarter: QuarterTurn::Square,
        }
    }
}
