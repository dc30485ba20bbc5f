//! The score: log-odds of a grasp, up to a constant, as a fixed weighted sum of what its geometry says.
//!
//! The weights were fitted once by logistic regression (ridge, one intercept per object, so that they rank poses within an object) to simulated
//! grasps of procedural objects of the training split: 1343 poses of 44 objects (seeds 2000 to 2003 of eleven families),
//! the best eight of each by an earlier guess and others at random. `scripts/fit_ranking.py` fits them again. Nothing is simulated when
//! planning, and no object that is counted took part. Signs are as one would expect: more fingers, opposed and near the centre of mass,
//! at the depth where the finger pads are; not over-closed on nothing.

use super::predict::Prediction;

/// Lengths enter in units of this, metres.
const UNIT: f64 = 0.05;
/// Depth of the centre of mass at which grasps hold best, metres from the palm: about the height of the pads of a half-closed finger.
const BEST_DEPTH: f64 = 0.06;
/// Turn of the distal link beyond which a finger has closed past the object, radians.
const OVER_CLOSED: f64 = 3.2;
/// Epsilon above which a grasp counts as force closure: sampled directions alone are an upper bound.
const CLOSURE: f64 = 0.3;
/// Each better pose of the same box, face and preshape lowers a pose by this: among the first twenty there should be different ideas.
pub(crate) const REPEAT: f64 = 0.03;

/// One row: its name, what it is worth, and how it is read.
type Term = (&'static str, f64, fn(&Prediction, f64) -> f64);

/// Preshape angles beyond these are a tripod and a pinch, radians.
const TRIPOD: f64 = 0.5;
const PINCH: f64 = 1.3;

/// How many terms the score has.
pub const RANK_TERMS: usize = 16;

const TERMS: [Term; RANK_TERMS] = [
    ("fingers", 0.51, |p, _| p.fingers),
    ("pads", 0.13, |p, _| p.pads),
    ("closure", 0.18, |p, _| indicator(p.epsilon > CLOSURE)),
    ("balance", 0.64, |p, _| p.balance),
    ("lever", -0.03, |p, _| p.lever.min(2.0 * UNIT) / UNIT),
    ("depth", 0.54, |p, _| p.depth / UNIT),
    ("off_depth", -1.49, |p, _| ((p.depth - BEST_DEPTH) / UNIT).powi(2)),
    ("offset", -1.38, |p, _| p.offset.min(2.0 * UNIT) / UNIT),
    ("least_wrap", 0.01, |p, _| p.least_wrap.min(3.0)),
    ("over_closed", -0.77, |p, _| (p.wrap - OVER_CLOSED).max(0.0)),
    ("uneven", -0.09, |p, _| p.uneven),
    ("on_table", -0.02, |p, _| p.on_table),
    ("span", -0.45, |p, _| p.span / UNIT),
    ("tripod", 0.36, |_, preshape| indicator(preshape > TRIPOD && preshape < PINCH)),
    ("pinch", 0.74, |_, preshape| indicator(preshape >= PINCH)),
    ("down", -0.18, |p, _| p.down),
];

fn indicator(yes: bool) -> f64 {
    if yes { 1.0 } else { 0.0 }
}

/// Name and weight of each term of the score, in the order of [`rank_features`].
pub fn rank_weights() -> [(&'static str, f64); RANK_TERMS] {
    TERMS.map(|(name, weight, _)| (name, weight))
}

/// What the terms of the score read off a grasp at `preshape` radians; the score is their sum, weighted by [`rank_weights`].
pub fn rank_features(prediction: &Prediction, preshape: f64) -> [f64; RANK_TERMS] {
    TERMS.map(|(_, _, read)| read(prediction, preshape))
}

/// The score of a grasp at `preshape` radians; higher is better, comparable within an object.
pub(crate) fn score(prediction: &Prediction, preshape: f64) -> f64 {
    TERMS.iter().map(|(_, weight, read)| weight * read(prediction, preshape)).sum()
}
