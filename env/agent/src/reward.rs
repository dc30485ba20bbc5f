//! Named reward terms; their weights are the caller's.
//!
//! Shaping terms are differences of bounded potentials: what they pay in an episode depends on where it began and ended, so there
//! is nothing to gain by going back and forth, and the best policy stays the best (Ng, Harada, Russell, "Policy invariance
//! under reward transformations", 1999; with a discount of 1).

use crate::agent_episode::AgentEpisode;
use crate::arm_controller::{ANGULAR_SPEED, LINEAR_SPEED};
use crate::env_spec::EnvSpec;
use crate::grasp_quality::epsilon;
use crate::objects::Prepared;
use graspbox_episode::Episode;
use graspbox_hand::Hand;
use graspbox_sim::HandContact;
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Number of terms.
pub const TERMS: usize = 11;

/// Name, range in a step, and meaning of every term, in order.
pub const TERM_TABLE: [(&str, f64, f64, &str); TERMS] = [
    ("reach", -1.0, 1.0, "change of 1 - d / 0.4 m, with d the distance from the grasp centre to the object's core"),
    ("contact", -1.0, 1.0, "change of the mean of the share of fingers that touch and how far two of them oppose"),
    ("closure", -1.0, 1.0, "change of the epsilon quality of the present contacts"),
    ("lift", -1.0, 1.0, "change of the share of the lift height, while the hand holds the object off the table"),
    ("hold", -1.0, 1.0, "change of the share of the hold time"),
    ("success", 0.0, 1.0, "1 at success"),
    ("failure", -1.0, 0.0, "-1 where the object is lost for good"),
    ("effort", -1.0, 0.0, "minus the mean square of hand and spool speeds as shares of their limits"),
    ("push", -1.0, 1.0, "minus the change of how far the object was moved sideways, up to 0.2 m"),
    ("table", -1.0, 0.0, "-1 while the hand touches the table"),
    ("stop", -1.0, 0.0, "-1 while the protective stop holds the hand"),
];

/// The grasp centre: where closed fingers meet, hand frame, metres.
pub const GRASP_CENTER: [f64; 3] = [0.0, 0.0, 0.06];
/// Distance at which reaching begins to pay, metres.
const REACH: f64 = 0.4;
/// The object's core: its bounds, shrunk to this share.
const CORE: f64 = 0.5;
/// Sideways motion of the object beyond this costs no more, metres.
const PUSHED: f64 = 0.2;

/// Potentials of the shaping terms, each in [0, 1].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Potentials {
    /// Nearness of the grasp centre.
    pub reach: f64,
    /// Fingers that touch, and how they oppose.
    pub contact: f64,
    /// Epsilon quality.
    pub closure: f64,
    /// Share of the lift height.
    pub lift: f64,
    /// Share of the hold time.
    pub hold: f64,
    /// Share of the sideways motion that counts.
    pub push: f64,
}

impl Potentials {
    /// The potentials of an episode under an agent.
    pub fn of(play: &AgentEpisode, spec: &EnvSpec) -> Self {
        Self::at(play.episode(), play.prepared(), play.first_center(), spec.hand())
    }

    /// The potentials of an episode as it stands, whose object's centre of mass began at `first_center` (world).
    pub fn at(episode: &Episode, prepared: &Prepared, first_center: &Point3<f64>, hand: &Hand) -> Self {
        let (world, judge) = (episode.world(), episode.judge());
        let hand_from_object = world.hand_from_object();
        let contacts = world.hand_contacts();
        let center = hand_from_object * episode.scene().center_of_mass();
        let core = prepared.half_extents() * CORE;
        let at = hand_from_object.inverse() * Point3::from(GRASP_CENTER) - prepared.bounds_center();
        let outside = at.abs().zip_map(&core, |a, c| (a - c).max(0.0)).norm();
        let touching = contacts.iter().any(|c| c.with_object);
        let held = touching && !judge.on_scenery();
        let lift = world.object_center().z - judge.resting_height();
        let pushed = (world.object_center() - first_center).xy().norm();
        let share = |x: f64| if x.is_finite() { x.clamp(0.0, 1.0) } else { 0.0 };
        Self {
            reach: share(1.0 - outside / REACH),
            contact: share(grip(hand, &contacts)),
            closure: share(epsilon(hand, &contacts, &center)),
            lift: if held { share(lift / judge.criterion().lift_height) } else { 0.0 },
            hold: share(judge.held_share(world)),
            push: share(pushed / PUSHED),
        }
    }
}

/// Mean of the share of fingers that press on the object, and of how far two parts of the hand oppose each other.
fn grip(hand: &Hand, contacts: &[HandContact]) -> f64 {
    let palm = hand.fingers.len();
    let mut presses = vec![Vector3::zeros(); palm + 1];
    for contact in contacts.iter().filter(|c| c.with_object) {
        presses[hand.finger_of_link(contact.link).unwrap_or(palm)] += contact.normal * contact.force;
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

/// What happened in a step beside the potentials.
#[derive(Clone, Copy, Debug, Default)]
pub struct Events {
    /// The grasp succeeded.
    pub success: bool,
    /// The object is lost for good.
    pub failure: bool,
    /// The hand touched table or ground.
    pub table: bool,
    /// The protective stop held the hand.
    pub stop: bool,
}

/// The terms of one step.
pub fn terms(before: &Potentials, after: &Potentials, events: &Events, play: &AgentEpisode) -> [f32; TERMS] {
    let flag = |f: bool| if f { 1.0 } else { 0.0 };
    [
        after.reach - before.reach,
        after.contact - before.contact,
        after.closure - before.closure,
        after.lift - before.lift,
        after.hold - before.hold,
        flag(events.success),
        -flag(events.failure),
        -effort(play),
        before.push - after.push,
        -flag(events.table),
        -flag(events.stop),
    ]
    .map(|x| x as f32)
}

/// Mean square of the speeds of hand and spools, as shares of their limits.
fn effort(play: &AgentEpisode) -> f64 {
    let (linear, angular) = play.arm().velocity();
    let world = play.episode().world();
    let hand = world.hand();
    let spools = hand.fingers.iter().map(|f| world.motors()[f.motor].velocity / hand.motors[f.motor].max_speed);
    let fingers = spools.map(|s| s * s).sum::<f64>() / hand.fingers.len().max(1) as f64;
    let moves = (linear.norm() / LINEAR_SPEED).powi(2) + (angular.norm() / ANGULAR_SPEED).powi(2);
    ((moves + fingers) / 3.0).min(1.0)
}
