//! Ranking by geometry: the hand is closed on the surface at each feasible pose (`predict`), and a weighted sum of features of the closed hand
//! is the score (`score`).

mod neighbors;
mod predict;
mod score;

pub use predict::Prediction;
pub use score::{rank_features, rank_weights};

use crate::PlanError;
use crate::chain::Workspace;
use crate::collision::CollisionScene;
use crate::poses::Proposal;
use graspbox_hand::Hand;
use graspbox_mesh::{SurfaceSample, TriMesh, sample_surface};
use nalgebra::Point3;
use neighbors::Groups;
use predict::{ClosingHand, Target, closing_hand, predict};
use rayon::prelude::*;
use score::{REPEAT, check_terms, score};
use std::collections::BTreeMap;

/// Distance between the surface samples on which chains close, metres: a third of a finger's width.
const SPACING: f64 = 0.0045;
/// Least and greatest number of these samples.
const SAMPLES: [usize; 2] = [400, 4000];

/// A ranked proposal.
pub(crate) struct Ranked {
    /// Index of the proposal.
    pub index: usize,
    /// Higher is better.
    pub score: f64,
    /// Prediction of the closed hand.
    pub prediction: Prediction,
}

/// The surface samples of an object for the ranking.
pub(crate) fn samples(mesh: &TriMesh) -> Vec<SurfaceSample> {
    let wanted = (mesh.area() / (SPACING * SPACING)) as usize;
    sample_surface(mesh, wanted.clamp(SAMPLES[0], SAMPLES[1]), 0)
}

/// Scores feasible proposals and sorts them, best first; equal scores keep their order.
///
/// * `penalties`: score that each proposal loses.
///
/// # Errors
/// [`PlanError::UnsupportedHand`] for a preshape beyond the hand's limits, [`PlanError::UnknownTerm`] for a weight of an unknown term.
pub(crate) fn rank(
    samples: &[SurfaceSample],
    center_of_mass: Point3<f64>,
    hand: &Hand,
    scene: &CollisionScene,
    proposals: &[Proposal],
    penalties: &[f64],
) -> Result<Vec<Ranked>, PlanError> {
    check_terms(hand)?;
    let groups = Groups::new(samples);
    let target = Target { samples, groups: &groups, center_of_mass, scene };
    let mut hands: Vec<ClosingHand> = Vec::new();
    // Index of the closing hand of each proposal.
    let mut chosen = Vec::with_capacity(proposals.len());
    for Proposal { grasp, .. } in proposals {
        let known = hands.iter().position(|hand| hand.preshape == grasp.preshape);
        chosen.push(known.unwrap_or(hands.len()));
        if known.is_none() {
            hands.push(closing_hand(hand, grasp.preshape)?);
        }
    }
    let describe = |work: &mut Workspace, (index, proposal): (usize, &Proposal)| {
        let prediction = predict(&target, &hands[chosen[index]], &proposal.grasp.object_from_hand, work);
        Ranked { index, score: score(hand, &prediction, proposal.grasp.preshape) - penalties[index], prediction }
    };
    let mut ranked: Vec<Ranked> = proposals.par_iter().enumerate().map_init(Workspace::default, describe).collect();
    sort_with_variety(&mut ranked, proposals);
    Ok(ranked)
}

/// Lowers the score of each pose by [`REPEAT`] for every better one of the same box, face and preshape, and sorts.
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
