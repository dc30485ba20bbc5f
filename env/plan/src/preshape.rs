//! Which preshapes suit a face of a box, and where the hand then closes.
//!
//! The rules are the hand's own ([`graspbox_hand::FaceRule`]); they read the face as the hand sees it: `length` along hand y, `width` along
//! hand x. With the hand turned by a quarter its y lies along the short side. A face that no preshape suits gets the first one: it is
//! proposed, and ranked low.

use graspbox_hand::{Hand, Preshape, Quarter};
use nalgebra::{Matrix2, Vector2, Vector3};

use crate::PlanError;
use crate::chain::ChainModel;

/// Sides of a face as the hand sees them, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FaceSize {
    /// Across the hand (its x): what opposing fingers close on.
    pub width: f64,
    /// Along the hand (its y).
    pub length: f64,
}

/// Preshapes for a face, each as its number; `quarter` for a hand turned by a quarter, on faces at least as square as `square`.
pub(crate) fn preshapes(hand: &Hand, size: FaceSize, quarter: bool, square: f64) -> Vec<f64> {
    let ratio = size.width / size.length;
    let squarish = ratio.min(1.0 / ratio) >= square;
    let suits = |preshape: &&Preshape| {
        let rule = &preshape.face;
        let turned = match rule.quarter {
            Quarter::Always => true,
            Quarter::Square => !quarter || squarish,
            Quarter::Never => !quarter,
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

/// Where the chains meet, hand frame: the point of the palm's plane nearest to the planes in which they close (least squares, pulled
/// weakly to the hand's grasp centre, which decides where these are parallel). Chains whose plane turns as they close do not count; where the
/// others stand side by side, it is the grasp centre: they do not oppose each other.
///
/// # Errors
/// [`PlanError::UnsupportedHand`] where the kinematics refuse the preshape.
pub fn closing_center(hand: &Hand, preshape: f64) -> Result<Vector3<f64>, PlanError> {
    /// Pull of the grasp centre against one plane.
    const PULL: f64 = 0.05;
    /// Planes that are this nearly parallel (least eigenvalue of their sum) meet at no place that means anything: fingers side by side.
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
