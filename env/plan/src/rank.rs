//! Ranking: geometry alone. Each feasible pose is closed on the surface, described in numbers (`predict`), and
//! scored by a fixed sum of these (`score`).

mod predict;
mod score;

pub use predict::Prediction;
pub use score::{rank_features, rank_weights};

use crate::PlanError;
use crate::collision::CollisionScene;
use crate::poses::Proposal;
use graspbox_hand::Hand;
use graspbox_mesh::{SurfaceSample, TriMesh, sample_surface};
use nalgebra::Point3;
use predict::{ClosingHand, Target, closing_hand, predict};
use rayon::prelude::*;
use score::{REPEAT, check_terms, score};
use std::collections::BTreeMap;

/// Distance of the surface points that chains close on, metres: a third of a finger's width.
const SPACING: f64 = 0.0045;
/// Least and greatest number of these points.
const SAMPLES: [usize; 2] = [400, 4000];

/// What ranking makes of one proposal.
pub(crate) struct Ranked {
    /// Index of the proposal.
    pub index: usize,
    /// Higher is better.
    pub score: f64,
    /// What closing the hand would look like.
    pub prediction: Prediction,
}

/// The surface points of an object that ranking looks at.
pub(crate) fn samples(mesh: &TriMesh) -> Vec<SurfaceSample> {
    let wanted = (mesh.area() / (SPACING * SPACING)) as usize;
    sample_surface(mesh, wanted.clamp(SAMPLES[0], SAMPLES[1]), 0)
}

/// Scores feasible proposals and sorts them, best first; equal scores keep their order.
///
/// # Errors
/// [`PlanError::UnsupportedHand`] where the kinematics refuse a preshape, [`PlanError::UnknownTerm`] for a weight of the hand of no term.
pub(crate) fn rank(
    samples: &[SurfaceSample],
    center_of_mass: Point3<f64>,
    hand: &Hand,
    scene: &CollisionScene,
    proposals: &[Proposal],
) -> Result<Vec<Ranked>, PlanError> {
    check_terms(hand)?;
    let target = Target { samples, center_of_mass, scene };
    let mut hands: Vec<ClosingHand> = Vec::new();
    // The hand of each proposal.
    let mut chosen = Vec::with_capacity(proposals.len());
    for Proposal { grasp, .. } in proposals {
        let known = hands.iter().position(|hand| hand.preshape == grasp.preshape);
        chosen.push(known.unwrap_or(hands.len()));
        if known.is_none() {
            hands.push(closing_hand(hand, grasp.preshape)?);
        }
    }
    let describe = |(index, proposal): (usize, &Proposal)| {
        let prediction = predict(&target, &hands[chosen[index]], &proposal.grasp.object_from_hand);
        Ranked { index, score: score(hand, &prediction, proposal.grasp.preshape), prediction }
    };
    let mut ranked: Vec<Ranked> = proposals.par_iter().enumerate().map(describe).collect();
    sort_with_variety(&mut ranked, proposals);
    Ok(ranked)
}

/// Lowers each pose by [`REPEAT`] for every better one of the same box, face and preshape, and sorts by what is left.
fn sort_with_variety(ranked: &mut [Ranked], proposals: &[Proposal]) {
    ranked.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut seen: BTreeMap<(usize, usize, u64), u32> = BTreeMap::new();
    for row in ranked.iter_mut() {
        let proposal = &proposals[row.index];
        let kind = (proposal.box_index, proposal.face, proposal.grasp.preshape.to_bits());
        let better = seen.entry(kind).or_default();
        row.score -= REPEAT * f64::from(*better);
        *better += 1;
    }
    ranked.sort_by(|a, b| b.score.total_cmp(&a.score));
}
