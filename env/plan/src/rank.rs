//! Ranking: geometry alone. Each feasible pose is closed on the surface (`finger`), described in numbers (`predict`, `wrench`), and
//! scored by a fixed sum of these (`score`).

mod finger;
mod predict;
mod score;
mod wrench;

pub use predict::Prediction;
pub use score::{RANK_TERMS, rank_features, rank_weights};

use crate::PlanError;
use crate::collision::CollisionScene;
use crate::planner::Candidate;
use graspbox_hand::Hand;
use graspbox_mesh::{TriMesh, sample_surface};
use nalgebra::Point3;
use predict::{ClosingHand, Target, closing_hand, predict};
use rayon::prelude::*;
use score::{REPEAT, score};
use std::collections::BTreeMap;

/// Distance of the surface points that fingers close on, metres: a third of a finger's width.
const SPACING: f64 = 0.0045;
/// Least and greatest number of these points.
const SAMPLES: [usize; 2] = [400, 4000];

/// Scores feasible candidates and sorts them, best first; equal scores keep their order.
///
/// # Errors
/// [`PlanError::UnsupportedHand`] where the kinematics refuse a preshape.
pub(crate) fn rank(
    mesh: &TriMesh,
    center_of_mass: Point3<f64>,
    hand: &Hand,
    scene: &CollisionScene,
    candidates: &mut [Candidate],
) -> Result<(), PlanError> {
    let wanted = (mesh.area() / (SPACING * SPACING)) as usize;
    let samples = sample_surface(mesh, wanted.clamp(SAMPLES[0], SAMPLES[1]), 0);
    let target = Target { samples: &samples, center_of_mass, scene };
    let mut hands: Vec<ClosingHand> = Vec::new();
    for candidate in candidates.iter() {
        if !hands.iter().any(|known| known.preshape == candidate.grasp.preshape) {
            hands.push(closing_hand(hand, candidate.grasp.preshape)?);
        }
    }
    candidates.par_iter_mut().for_each(|candidate| {
        if let Some(hand) = hands.iter().find(|known| known.preshape == candidate.grasp.preshape) {
            let prediction = predict(&target, hand, &candidate.grasp.object_from_hand);
            candidate.score = score(&prediction, candidate.grasp.preshape);
            candidate.prediction = Some(prediction);
        }
    });
    sort_with_variety(candidates);
    Ok(())
}

/// Lowers each candidate by [`REPEAT`] for every better one of the same box, face and preshape, and sorts by what is left.
fn sort_with_variety(candidates: &mut [Candidate]) {
    candidates.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut seen: BTreeMap<(usize, usize, u64), u32> = BTreeMap::new();
    for candidate in candidates.iter_mut() {
        let kind = (candidate.box_index, candidate.face, candidate.grasp.preshape.to_bits());
        let better = seen.entry(kind).or_default();
        candidate.score -= REPEAT * f64::from(*better);
        *better += 1;
    }
    candidates.sort_by(|a, b| b.score.total_cmp(&a.score));
}
