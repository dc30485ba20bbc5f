//! Reward terms of environments with goals: they depend on the achieved and the desired goal alone.

use crate::rewards::reward::{TERM_COUNT, TermRow, TermValues};
use crate::state::goal::{GOAL_BOUND, distance};

/// Names of the terms, in order: the first entries of [`TermValues`], whose others are 0.
pub const GOAL_TERMS: [&str; 2] = ["goal", "distance"];

/// The terms after a step: -1 or 0, and minus the distance in metres.
///
/// * `threshold`: greatest distance from the goal at success, metres.
pub fn goal_terms(achieved: &[f32; 3], desired: &[f32; 3], threshold: f64) -> TermValues {
    let apart = distance(achieved, desired);
    let mut terms = [0.0; TERM_COUNT];
    terms[0] = if apart <= threshold { 0.0 } else { -1.0 };
    terms[1] = -apart as f32;
    terms
}

/// The table of the terms.
pub fn goal_term_table() -> Vec<TermRow> {
    let farthest = 2.0 * GOAL_BOUND * 3.0_f64.sqrt();
    let row =
        |(name, low, meaning): (&'static str, f64, &str)| TermRow { name, low, high: 0.0, meaning: meaning.into() };
    [
        (GOAL_TERMS[0], -1.0, "0 within the threshold of the goal, else -1"),
        (GOAL_TERMS[1], -farthest, "minus the distance from the goal, metres"),
    ]
    .map(row)
    .into()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At the threshold the goal is reached.
    #[test]
    fn terms_follow_from_the_distance() {
        let desired = [0.1, -0.2, 0.3];
        let first = |achieved: [f32; 3], threshold| {
            let terms = goal_terms(&achieved, &desired, threshold);
            assert!(terms[2..].iter().all(|term| *term == 0.0));
            [terms[0], terms[1]]
        };
        assert_eq!(first(desired, 0.0), [0.0, -0.0]);
        let achieved = [0.1, -0.2, 0.55];
        let apart = distance(&achieved, &desired);
        assert!((apart - 0.25).abs() < 1e-7);
        assert_eq!(first(achieved, apart), [0.0, -apart as f32]);
        assert_eq!(first(achieved, apart.next_down()), [-1.0, -apart as f32]);
    }
}
