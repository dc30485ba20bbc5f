//! Ranking: geometry alone.

use crate::PlanError;
use crate::collision::CollisionScene;
use crate::planner::{Candidate, PlanObject};
use graspbox_hand::Hand;
use nalgebra::Vector3;

/// Scores feasible candidates and sorts them, best first.
pub(crate) fn rank(
    object: &PlanObject<'_>,
    _hand: &Hand,
    _scene: &CollisionScene,
    candidates: &mut [Candidate],
) -> Result<(), PlanError> {
    for candidate in candidates.iter_mut() {
        let hand_from_object = candidate.grasp.object_from_hand.inverse();
        let com = hand_from_object * object.center_of_mass;
        candidate.score = 1.0 / (1.0 + (com - Vector3::new(0.0, 0.0, 0.06)).coords.norm());
    }
    candidates.sort_by(|a, b| b.score.total_cmp(&a.score));
    Ok(())
}
