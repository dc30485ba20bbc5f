//! Which preshapes suit a face of a box, and where the fingers then meet.
//!
//! The rule reads the face as the hand sees it: `length` along hand y, `width` along hand x.
//!
//! | preshape | when | why |
//! |---|---|---|
//! | 0, power | length >= 45 mm | fingers 1 and 2 stand 52 mm apart in y: on less they pass beside the object |
//! | pi/3, tripod | 1/2 <= width/length <= 2, or length < 66 mm | three fingers 120 degrees apart suit round and small faces |
//! | pi/2, pinch | length <= 90 mm | fingers 1 and 2 oppose each other along y |
//!
//! With the hand turned by a quarter (its y along the short side) power and tripod are tried on nearly square faces only; pinch always,
//! as it then closes across a long, thin object. A face that no row admits gets power: it is proposed, and ranked low.

use graspbox_hand::Hand;
use nalgebra::{Matrix2, Vector2, Vector3};

const POWER: f64 = 0.0;
const TRIPOD: f64 = std::f64::consts::FRAC_PI_3;
const PINCH: f64 = std::f64::consts::FRAC_PI_2;
/// Shortest face for a power grasp, metres.
const POWER_LENGTH: f64 = 0.045;
/// Below this length a tripod is tried whatever the width: a finger's width more than the fingers' distance, metres.
const SMALL: f64 = 0.066;
/// Most unequal sides that a tripod suits.
const ROUND: f64 = 2.0;
/// Longest face for a pinch, metres: the fingers reach about 0.1 m.
const PINCH_LENGTH: f64 = 0.09;

/// Sides of a face as the hand sees them, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct FaceSize {
    /// Across the hand (its x): what fingers 1, 2 and 3 close on.
    pub width: f64,
    /// Along the hand (its y).
    pub length: f64,
}

/// Preshapes for a face; `quarter` for a hand turned by a quarter, on faces at least as square as `square`.
pub(crate) fn preshapes(hand: &Hand, size: FaceSize, quarter: bool, square: f64) -> Vec<f64> {
    if hand.fingers.iter().all(|finger| finger.swivel.is_none()) {
        return if quarter { Vec::new() } else { vec![POWER] };
    }
    let ratio = size.width / size.length;
    let squarish = ratio.min(1.0 / ratio) >= square;
    let round = (1.0 / ROUND..=ROUND).contains(&ratio) || size.length < SMALL;
    let pinch = size.length <= PINCH_LENGTH;
    let turned = !quarter || squarish;
    let rows = [(POWER, turned && size.length >= POWER_LENGTH), (TRIPOD, turned && round), (PINCH, pinch)];
    let found: Vec<f64> = rows.into_iter().filter(|row| row.1).map(|row| row.0).collect();
    if found.is_empty() && !quarter { vec![POWER] } else { found }
}

/// Where the fingers meet, hand frame: the point of the palm's plane nearest to the lines that the fingers close along (least squares,
/// pulled weakly to the hand's origin, which decides where the lines are parallel).
pub(crate) fn closing_center(hand: &Hand, preshape: f64) -> Vector3<f64> {
    /// Pull of the origin against one line.
    const PULL: f64 = 0.05;
    let Ok(links) = hand.hand_from_links(&hand.open_configuration(preshape)) else {
        return Vector3::zeros();
    };
    let mut normal = Matrix2::identity() * PULL;
    let mut right = Vector2::zeros();
    for finger in &hand.fingers {
        let joint = &hand.joints[finger.proximal];
        let root = links[joint.child];
        let along = root.rotation * Vector3::x();
        let across = Vector2::new(-along.y, along.x);
        let outer = across * across.transpose() / across.norm_squared().max(1e-12);
        normal += outer;
        right += outer * root.translation.vector.xy();
    }
    let center = normal.try_inverse().map_or_else(Vector2::zeros, |inverse| inverse * right);
    Vector3::new(center.x, center.y, 0.0)
}
