//! The score: log-odds of a grasp, up to a constant, as a fixed weighted sum of what its geometry says.
//!
//! The weights were fitted once by logistic regression (ridge, one intercept an object, so that they rank poses within an object) to simulated
//! grasps of procedural objects of the training split: 1343 poses of 44 objects (seeds 2000 to 2003 of eleven families),
//! the best eight of each by an earlier guess and others at random. Nothing is simulated when
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

/// One row: what it is worth, and how it is read.
type Term = (f64, fn(&Prediction, f64) -> f64);

/// Preshape angles beyond these are a tripod and a pinch, radians.
const TRIPOD: f64 = 0.5;
const PINCH: f64 = 1.3;

const TERMS: [Term; 16] = [
    (0.51, |p, _| p.fingers),
    (0.13, |p, _| p.pads),
    (0.18, |p, _| indicator(p.epsilon > CLOSURE)),
    (0.64, |p, _| p.balance),
    (-0.03, |p, _| p.lever.min(2.0 * UNIT) / UNIT),
    (0.54, |p, _| p.depth / UNIT),
    (-1.49, |p, _| ((p.depth - BEST_DEPTH) / UNIT).powi(2)),
    (-1.38, |p, _| p.offset.min(2.0 * UNIT) / UNIT),
    (0.01, |p, _| p.least_wrap.min(3.0)),
    (-0.77, |p, _| (p.wrap - OVER_CLOSED).max(0.0)),
    (-0.09, |p, _| p.uneven),
    (-0.02, |p, _| p.on_table),
    (-0.45, |p, _| p.span / UNIT),
    (0.36, |_, preshape| indicator(preshape > TRIPOD && preshape < PINCH)),
    (0.74, |_, preshape| indicator(preshape >= PINCH)),
    (-0.18, |p, _| p.down),
];

fn indicator(yes: bool) -> f64 {
    if yes { 1.0 } else { 0.0 }
}

/// The score of a grasp at `preshape` radians; higher is better, comparable within an object.
pub(crate) fn score(prediction: &Prediction, preshape: f64) -> f64 {
    TERMS
        .iter()
        .map(|(weight, term)| weight * term(prediction, preshape))
        .sum()
}
