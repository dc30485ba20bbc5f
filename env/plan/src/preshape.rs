//! The preshapes that suit a face of a box, and the point at which the hand then closes.
//!
//! The rules belong to the hand ([`graspbox_hand::FaceRule`]) and use the face's sides relative to the hand: `length` along hand y, `width`
//! along hand x. With the hand rotated by 90 degrees, its y is along the short side. A face without a suitable preshape gets the first one,
//! and ranks low.

use graspbox_hand::{Hand, Preshape, QuarterTurn};
use nalgebra::{Matrix2, Vector2, Vector3};

use crate::PlanError;
use crate::chain::ChainModel;

/// Sides of a face relative to the hand, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FaceSize {
    /// Along hand x, on which opposing fingers close.
    pub width: f64,
    /// Along hand y.
    pub length: f64,
}

/// Preshapes for a face, each as its number; `quarter` for a hand rotated by 90 degrees, on faces at least as square as `square`.
pub(crate) fn preshapes(hand: &Hand, size: FaceSize, quarter: bool, square: f64) -> Vec<f64> {
    let ratio = size.width / size.length;
    let squarish = ratio.min(1.0 / ratio) >= square;
    let suits = |preshape: &&Preshape| {
        let rule = &preshape.face;
        let turned = match rule.quarter {
            QuarterTurn::Always => true,
            QuarterTurn::Square => !quarter || squarish,
            QuarterTurn::Never => !quarter,
        };
        let ratios = (1.0 / rule.max_ratio..=rule.max_ratio).contains(&ratio) || size.length < rule.any_ratio_below;
        let within = |[least, most]: [f64; 2], side: f64| (least..=most).contains(&side);
        turned && ratios && within(rule.length, size.length) && within(rule.width, size.width)
    };
    let found: Vec<f64> = hand.preshapes().iter().filter(suits).map(|preshape| preshape.value).collect();
    match hand.preshapes().first() {
        Some(first) if found.is_empty() && !quarter => vec![first.value],
        _ => found,
    }
}

/// The closing centre, hand frame: the point of the palm's plane nearest to the planes in which the chains close, by least squares with a
/// weak pull to the hand's grasp centre, which decides if the planes are parallel. Chains whose plane rotates as they close do not count. If
/// the others are side by side and do not oppose each other, it is the grasp centre.
///
/// # Errors
/// [`PlanError::UnsupportedHand`] for a preshape beyond the hand's limits.
pub fn closing_center(hand: &Hand, preshape: f64) -> Result<Vector3<f64>, PlanError> {
    /// Weight of the grasp centre relative to one plane, dimensionless.
    const PULL: f64 = 0.05;
    /// Least eigenvalue of the sum of the planes' projectors below which they are nearly parallel: the fingers are side by side.
    const FANNED: f64 = 0.3;
    let mut normal = Matrix2::zeros();
    let mut right = Vector2::zeros();
    for chain in ChainModel::all(hand, preshape)?.iter().filter(|chain| !chain.turns) {
        let across = chain.axes()[1].xy();
        let outer = across * across.transpose() / across.norm_squared().max(1e-12);
        normal += outer;
        right += outer * chain.hand_from_plane.translation.vector.xy();
    }
    if (1e-6..FANNED).contains(&normal.symmetric_eigenvalues().min()) {
        let center = hand.grasp.center;
        return Ok(Vector3::new(center.x, center.y, 0.0));
    }
    normal += Matrix2::identity() * PULL;
    right += hand.grasp.center.coords.xy() * PULL;
    let center = normal.try_inverse().map_or_else(Vector2::zeros, |inverse| inverse * right);
    Ok(Vector3::new(center.x, center.y, 0.0))
}
