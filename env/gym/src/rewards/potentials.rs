//! Bounded potentials, whose changes are the shaping terms of the reward.

use crate::objects::Prepared;
use crate::rewards::grasp_quality::epsilon;
use graspbox_episode::Episode;
use graspbox_episode::judge::{SECURE_SHIFT, SECURE_TURN};
use graspbox_hand::Hand;
use graspbox_sim::HandContact;
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Distance at which the reaching potential begins, metres.
pub(crate) const REACH: f64 = 0.4;
/// Scale of the object's core relative to its bounds.
const CORE: f64 = 0.5;
/// Sideways motion of the object beyond which the cost is constant, metres.
pub(crate) const PUSHED: f64 = 0.2;

/// Potentials of the shaping terms, each in [0, 1].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Potentials {
    /// Nearness of the grasp centre.
    pub reach: f64,
    /// Touching fingers, and their opposition.
    pub contact: f64,
    /// Epsilon quality.
    pub closure: f64,
    /// Share of the lift height.
    pub lift: f64,
    /// Share of the hold time.
    pub hold: f64,
    /// Sideways motion of the object, as a share of `PUSHED`.
    pub push: f64,
    /// Motion in the hand since the object left the table, as a share of the limit of a secure grasp.
    pub slip: f64,
}

impl Potentials {
    /// All of them.
    pub(crate) fn all(&self) -> [f64; 7] {
        let Self { reach, contact, closure, lift, hold, push, slip } = *self;
        [reach, contact, closure, lift, hold, push, slip]
    }

    /// The present potentials of an episode.
    ///
    /// * `first_center`: the object's centre of mass when the episode began, world.
    pub fn of(episode: &Episode, prepared: &Prepared, first_center: &Point3<f64>) -> Self {
        let (world, judge) = (episode.world(), episode.judge());
        let hand = world.hand();
        let hand_from_object = world.hand_from_object();
        let mut contacts = world.hand_contacts();
        contacts.retain(|contact| contact.object == Some(world.target()));
        let center = hand_from_object * episode.scene().center_of_mass();
        let core = prepared.half_extents() * CORE;
        let at = hand_from_object.inverse() * hand.grasp.center - prepared.bounds_center();
        let outside = at.abs().zip_map(&core, |a, c| (a - c).max(0.0)).norm();
        let touching = !contacts.is_empty();
        let held = touching && !judge.on_scenery();
        let lift = world.object_center().z - judge.resting_height();
        let pushed = (world.object_center() - first_center).xy().norm();
        let verdict = judge.verdict(world);
        let share = |x: f64| if x.is_finite() { x.clamp(0.0, 1.0) } else { 0.0 };
        Self {
            reach: share(1.0 - outside / REACH),
            contact: share(opposition(hand, &contacts)),
            closure: share(epsilon(hand, &contacts, &center)),
            lift: if held { share(lift / judge.criterion().lift_height) } else { 0.0 },
            hold: share(judge.held_share(world)),
            push: share(pushed / PUSHED),
            slip: share((verdict.shift / SECURE_SHIFT).max(verdict.turn / SECURE_TURN)),
        }
    }
}

/// Mean of the share of fingers that press on the object and of the greatest opposition of two parts of the hand.
///
/// * `contacts`: of the hand with the object.
fn opposition(hand: &Hand, contacts: &[HandContact]) -> f64 {
    let palm = hand.chain_count();
    let mut presses = vec![Vector3::zeros(); palm + 1];
    for contact in contacts {
        presses[hand.chain_of_link(contact.link).unwrap_or(palm)] += contact.normal * contact.force;
    }
    let directions: Vec<_> = presses.iter().map(|p| p.try_normalize(1e-9)).collect();
    let fingers = directions[..palm].iter().flatten().count() as f64 / palm.max(1) as f64;
    let mut opposed = 0.0_f64;
    for (i, a) in directions.iter().enumerate() {
        for b in directions[i + 1..].iter().flatten() {
            opposed = a.map_or(opposed, |a| opposed.max(-a.dot(b)));
        }
    }
    0.5 * fingers + 0.5 * opposed
}
