//! The score: the log-odds of success, up to a constant, as a weighted sum of geometric features.
//!
//! The weights were fitted by logistic regression (ridge, one intercept per object, so they rank poses within an object) to simulated grasps of
//! procedural objects of the training split with the ReFlex hand: 1343 poses of 44 objects (seeds 2000 to 2003 of eleven families), the
//! eight best of each by an earlier score, and random ones. `scripts/fit_ranking.py` fits them again. No object of an evaluation took part.
//! The signs are plausible: many fingers, opposed and near the centre of mass, at the depth of the finger pads, and not closed past the object.
//! Weights in a hand's file (`[grasp.ranking]`) replace these; terms of weight 0 exist for such hands.

use super::predict::Prediction;
use crate::PlanError;
use graspbox_hand::{Hand, Preshape};

/// Unit of lengths in the terms, metres.
const UNIT: f64 = 0.05;
/// Rotation of the last link beyond which a finger has closed past the object, radians.
const OVER_CLOSED: f64 = 3.2;
/// Epsilon above which a grasp counts as force closure, dimensionless; above 0, since sampled directions give an upper bound.
const CLOSURE: f64 = 0.3;
/// Amount by which each better pose of the same box, face and preshape lowers a score: the first twenty poses should differ.
pub(crate) const REPEAT: f64 = 0.03;

/// Inputs of a term.
struct Reading<'a> {
    prediction: &'a Prediction,
    /// Depth of the hand's grasp centre, metres from the palm: grasps hold best there.
    best_depth: f64,
}

impl Reading<'_> {
    /// Distance of the centre of mass ahead of the closing centre, bounded.
    fn ahead(&self) -> f64 {
        self.prediction.ahead.clamp(-2.0 * UNIT, 2.0 * UNIT) / UNIT
    }
}

/// A term: its name, weight and value.
type Term = (&'static str, f64, fn(&Reading<'_>) -> f64);

/// Terms before those of the preshapes.
const TERMS: [Term; 25] = [
    ("fingers", 0.51, |r| r.prediction.fingers),
    ("pads", 0.13, |r| r.prediction.pads),
    ("closure", 0.18, |r| indicator(r.prediction.epsilon > CLOSURE)),
    ("balance", 0.64, |r| r.prediction.balance),
    ("lever", -0.03, |r| r.prediction.lever.min(2.0 * UNIT) / UNIT),
    ("depth", 0.54, |r| r.prediction.depth / UNIT),
    ("off_depth", -1.49, |r| ((r.prediction.depth - r.best_depth) / UNIT).powi(2)),
    ("offset", -1.38, |r| r.prediction.offset.min(2.0 * UNIT) / UNIT),
    ("least_wrap", 0.01, |r| r.prediction.least_wrap.min(3.0)),
    ("over_closed", -0.77, |r| (r.prediction.wrap - OVER_CLOSED).max(0.0)),
    ("uneven", -0.09, |r| r.prediction.uneven),
    ("on_table", -0.02, |r| r.prediction.on_table),
    ("span", -0.45, |r| r.prediction.span / UNIT),
    ("ahead", 0.0, |r| r.ahead()),
    ("off_ahead", 0.0, |r| r.ahead().powi(2)),
    ("aside", 0.0, |r| r.prediction.aside.min(2.0 * UNIT) / UNIT),
    ("nose_down", 0.0, |r| r.prediction.nose_down),
    ("nose_tilt", 0.0, |r| r.prediction.nose_down.powi(2)),
    ("epsilon", 0.0, |r| r.prediction.epsilon.min(1.0)),
    ("contact_depth", 0.0, |r| r.prediction.contact_depth / UNIT),
    ("off_contact_depth", 0.0, |r| (r.prediction.contact_depth / UNIT).powi(2)),
    ("width", 0.0, |r| r.prediction.width / UNIT),
    ("off_width", 0.0, |r| (r.prediction.width / UNIT).powi(2)),
    ("wrap", 0.0, |r| r.prediction.wrap.min(4.0)),
    ("opposed", 0.0, |r| r.prediction.opposed),
];
/// The term after them.
const DOWN: Term = ("down", -0.18, |r| r.prediction.down);

fn indicator(yes: bool) -> f64 {
    if yes { 1.0 } else { 0.0 }
}

/// Weight of a term for `hand`: the hand's own, or that of the table.
fn weight(hand: &Hand, (name, weight, _): &Term) -> f64 {
    hand.grasp.ranking.get(*name).copied().unwrap_or(*weight)
}

/// Checks that the hand's own weights are for known terms.
///
/// # Errors
/// [`PlanError::UnknownTerm`] for the first unknown one.
pub(crate) fn check_terms(hand: &Hand) -> Result<(), PlanError> {
    let known = || TERMS.iter().chain([&DOWN]).map(|term| term.0);
    match hand.grasp.ranking.keys().find(|name| !known().any(|term| term == *name)) {
        None => Ok(()),
        Some(name) => Err(PlanError::UnknownTerm {
            hand: hand.name.clone(),
            name: name.clone(),
            known: known().collect::<Vec<_>>().join(", "),
        }),
    }
}

/// Preshapes with their own term: all but the first, to which they are compared.
fn others(hand: &Hand) -> &[Preshape] {
    hand.preshapes().get(1..).unwrap_or_default()
}

/// Name and weight of each term of the score, in the order of [`rank_features`]. All preshapes of the hand but the first have a term, with their
/// preference as its weight.
pub fn rank_weights(hand: &Hand) -> Vec<(String, f64)> {
    let fixed = |term: &Term| (term.0.to_owned(), weight(hand, term));
    let preshapes = others(hand).iter().map(|preshape| (preshape.name.clone(), preshape.preference));
    TERMS.iter().map(fixed).chain(preshapes).chain([fixed(&DOWN)]).collect()
}

/// Values of the terms for a grasp with `preshape`; the score is their sum weighted by [`rank_weights`].
pub fn rank_features(hand: &Hand, prediction: &Prediction, preshape: f64) -> Vec<f64> {
    let reading = Reading { prediction, best_depth: hand.grasp.center.z };
    let fixed = |(_, _, read): &Term| read(&reading);
    let taken = hand.nearest_preshape(preshape).map(|named| &named.name);
    let preshapes = others(hand).iter().map(|named| indicator(taken == Some(&named.name)));
    TERMS.iter().map(fixed).chain(preshapes).chain([fixed(&DOWN)]).collect()
}

/// Score of a grasp with `preshape`; higher is better, comparable within an object.
pub(crate) fn score(hand: &Hand, prediction: &Prediction, preshape: f64) -> f64 {
    let reading = Reading { prediction, best_depth: hand.grasp.center.z };
    let worth = |term: &Term| weight(hand, term) * (term.2)(&reading);
    let first = hand.preshapes().first().map(|named| &named.name);
    let taken = hand.nearest_preshape(preshape).filter(|named| first != Some(&named.name));
    let preference = taken.map_or(0.0, |named| named.preference);
    TERMS.iter().map(worth).chain([preference, worth(&DOWN)]).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn weights(changes: &[(&str, f64)]) -> Hand {
        let mut hand = Hand::reflex().unwrap().clone();
        hand.grasp.ranking = changes.iter().map(|(name, weight)| ((*name).to_owned(), *weight)).collect();
        hand
    }

    #[test]
    fn a_hand_may_weigh_terms_by_itself() {
        let prediction = Prediction { fingers: 2.0, width: 0.1, ..Prediction::default() };
        let [plain, own] = [&[][..], &[("fingers", 1.5), ("width", -0.25)][..]].map(weights);
        assert!(check_terms(&own).is_ok());
        let change = score(&own, &prediction, 0.0) - score(&plain, &prediction, 0.0);
        assert!((change - ((1.5 - 0.51) * 2.0 - 0.25 * 2.0)).abs() < 1e-12, "{change}");
        assert!(rank_weights(&own).contains(&("fingers".to_owned(), 1.5)));
    }

    #[test]
    fn a_weight_of_no_term_is_refused_by_name() {
        let said = check_terms(&weights(&[("finger", 1.0)])).unwrap_err().to_string();
        assert!(said.contains("\"finger\"") && said.contains("fingers, pads") && said.contains("down"), "{said}");
    }
}
