//! Measured points that show the arm itself, or the hand that it carries: no obstacles, and no things.

use crate::bodies::{ArmBodies, Body, Solid, frame, is_near};
use crate::error::ArmError;
use crate::inverse::Inverse;
use graspbox_hand::Hand;
use nalgebra::{Isometry3, Point3};
use rayon::prelude::*;

/// Preshapes between the least and the greatest, and shares of closing, at which a hand is placed: nobody measured its fingers.
const PRESHAPES: usize = 3;
const CLOSINGS: [f64; 4] = [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0];

/// A hand on a flange.
#[derive(Clone, Copy, Debug)]
pub struct Mounted<'a> {
    pub hand: &'a Hand,
    /// Pose of its base on the flange.
    pub flange_from_base: Isometry3<f64>,
}

/// Shapes that are fixed to one another, from the world.
struct Placed<'a> {
    body: &'a Body,
    body_from_world: Isometry3<f64>,
}

/// Which points are on an arm or its hand.
///
/// * `positions`: those of the arm's axes.
/// * `points`: world frame, metres; `distances`: how far from a link each one may be, metres.
///
/// # Errors
/// [`ArmError::Preshape`] for a hand whose files give no such posture.
pub fn on_arm(
    (inverse, bodies): (&Inverse, &ArmBodies),
    positions: &[f64],
    world_from_base: &Isometry3<f64>,
    hand: Option<Mounted<'_>>,
    points: &[Point3<f64>],
    distances: &[f64],
) -> Result<Vec<bool>, ArmError> {
    let frames = inverse.chain().frames(&inverse.positions_of(positions));
    let held = hand.map(|mounted| swept(&mounted, inverse)).transpose()?;
    let of = |index: usize, body| Placed { body, body_from_world: (world_from_base * frame(&frames, index)).inverse() };
    let mut placed: Vec<Placed<'_>> = bodies.bodies.iter().enumerate().map(|(index, body)| of(index, body)).collect();
    placed.extend(held.iter().map(|body| of(bodies.count() - 1, body)));
    Ok(points
        .par_iter()
        .zip(distances)
        .map(|(point, distance)| placed.iter().any(|p| p.is_near(point, *distance)))
        .collect())
}

impl Placed<'_> {
    fn is_near(&self, point: &Point3<f64>, distance: f64) -> bool {
        let at = self.body_from_world * point;
        let within = self.body.radius + distance * 3.0_f64.sqrt();
        (at - self.body.center).norm_squared() <= within * within
            && self
                .body
                .solids
                .iter()
                .any(|s| is_near(&s.shape, &s.body_from_shape.inverse_transform_point(&at).coords, distance))
    }
}

/// The shapes of a hand in all the postures that it may have, in the frame of the last axis.
fn swept(mounted: &Mounted<'_>, inverse: &Inverse) -> Result<Body, ArmError> {
    let Mounted { hand, flange_from_base } = mounted;
    let body_from_hand = inverse.chain().axis_from_flange() * flange_from_base * hand.base_from_hand;
    let [low, high] = hand.preshape_limits();
    let mut solids = Vec::new();
    for step in 0..PRESHAPES {
        let preshape = low + (high - low) * step as f64 / (PRESHAPES - 1) as f64;
        for share in CLOSINGS {
            let shapes = hand
                .shapes_at(&hand.closed_configuration(preshape, share))
                .map_err(|_| ArmError::Preshape { hand: hand.name.clone(), preshape })?;
            solids.extend(shapes.iter().map(|s| Solid::new(&s.collider.shape, body_from_hand * s.hand_from_shape)));
        }
        if low >= high {
            break;
        }
    }
    Ok(Body::new(solids))
}
