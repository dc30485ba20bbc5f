//! Poses of a hand: which of them an arm reaches, by which postures, and why it does not reach the others.

use crate::bodies::{ArmBodies, Carried, check_payload};
use crate::chain::{MAX_AXES, Positions};
use crate::error::ArmError;
use crate::inverse::{Inverse, Solution, Unsolved};
use crate::scene::{Scene, Touched};
use graspbox_hand::{Arm, Hand};
use nalgebra::Isometry3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;

/// Settings of [`reach`].
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ReachParams {
    /// Postures from which each pose is searched.
    pub starts: usize,
    /// Most postures returned per pose.
    pub solutions: usize,
    /// Greatest angle to the rotation of a pose for an arm with fewer than six axes, rad.
    pub max_angle: f64,
    /// Distance that links keep from the table and from objects, metres.
    pub clearance: f64,
    /// Distance that links keep from measured points, metres.
    pub point_radius: f64,
}

impl Default for ReachParams {
    fn default() -> Self {
        Self { starts: 32, solutions: 4, max_angle: 0.2, clearance: 0.005, point_radius: 0.01 }
    }
}

impl ReachParams {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`ArmError::OutOfRange`], which names the field.
    pub fn check(&self) -> Result<(), ArmError> {
        let counts = [("starts", self.starts, 4096), ("solutions", self.solutions, 64)];
        for (name, count, limit) in counts {
            if count == 0 || count > limit {
                let must = if limit == 64 { "1 to 64" } else { "1 to 4096" };
                return Err(ArmError::OutOfRange { name, value: count as f64, must });
            }
        }
        let numbers = [
            ("max_angle", self.max_angle, std::f64::consts::PI, "0 to pi rad"),
            ("clearance", self.clearance, 1.0, "0 to 1 m"),
            ("point_radius", self.point_radius, 1.0, "0 to 1 m"),
        ];
        for (name, value, most, must) in numbers {
            if !(0.0..=most).contains(&value) {
                return Err(ArmError::OutOfRange { name, value, must });
            }
        }
        Ok(())
    }
}

/// Why a pose is or is not reached. Bodies are those of [`ArmBodies`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reason {
    Reached,
    /// It is farther than the axes allow in any posture.
    TooFar,
    /// This axis is at its limit.
    AtLimit(usize),
    /// Two bodies of the arm touch.
    ArmTouchesArm([usize; 2]),
    /// A body touches the hand.
    ArmTouchesHand(usize),
    /// A body touches something else.
    ArmTouches(usize, Touched),
    /// With fewer than six axes: its position is met, but its rotation by no less than this angle, rad.
    Turned(f64),
    /// No posture was found.
    NotFound,
}

impl Reason {
    /// The reason in words.
    ///
    /// * `names`: of the objects of the scene.
    #[must_use]
    pub fn sentence(&self, arm: &Arm, bodies: &ArmBodies, names: &[String]) -> String {
        let joint = |axis: usize| arm.joints[arm.axes[axis].joint].name.as_str();
        match *self {
            Self::Reached => String::new(),
            Self::TooFar => "too far".to_owned(),
            Self::AtLimit(axis) => format!("{} is at its limit", joint(axis)),
            Self::ArmTouchesArm([a, b]) => format!("{} touches {}", bodies.name(b), bodies.name(a)),
            Self::ArmTouchesHand(body) => format!("the hand touches {}", bodies.name(body)),
            Self::ArmTouches(body, Touched::Table) => format!("{} touches the table", bodies.name(body)),
            Self::ArmTouches(body, Touched::Points) => format!("{} touches what is seen", bodies.name(body)),
            Self::ArmTouches(body, Touched::Obstacle(index)) => {
                format!("{} touches {}", bodies.name(body), names.get(index).map_or("an object", String::as_str))
            }
            Self::Turned(angle) => format!("its rotation is {:.0} degrees out of reach", angle.to_degrees()),
            Self::NotFound => "no solution was found".to_owned(),
        }
    }
}

impl From<Unsolved> for Reason {
    fn from(unsolved: Unsolved) -> Self {
        match unsolved {
            Unsolved::TooFar => Self::TooFar,
            Unsolved::AtLimit(axis) => Self::AtLimit(axis),
            Unsolved::Turned(angle) => Self::Turned(angle),
            Unsolved::NotFound => Self::NotFound,
        }
    }
}

/// The answer for one pose.
#[derive(Clone, Debug)]
pub struct Reach {
    pub reason: Reason,
    /// Postures that touch nothing, the preferred one first; empty if the pose is not reached.
    pub solutions: Vec<Solution>,
}

/// What an arm reaches: everything that is the same for all poses.
#[derive(Debug)]
pub struct Reacher<'a> {
    pub arm: &'a Arm,
    pub inverse: &'a Inverse,
    pub bodies: &'a ArmBodies,
    pub scene: &'a Scene,
    pub params: ReachParams,
}

/// Tests poses of the hand in the world, on rayon; the answers do not depend on the number of threads.
///
/// * `poses`: `world_from_hand`, with the preshape of each.
/// * `flange_from_base`: pose of the hand's base on the flange.
///
/// # Errors
/// [`ArmError`] for a hand that is too heavy, mounted in the arm or without one of the preshapes, and for settings out of range.
pub fn reach(
    reacher: &Reacher<'_>,
    hand: &Hand,
    flange_from_base: &Isometry3<f64>,
    poses: &[(Isometry3<f64>, f64)],
) -> Result<Vec<Reach>, ArmError> {
    let Reacher { arm, inverse, bodies, params, .. } = *reacher;
    params.check()?;
    check_payload(arm, hand)?;
    let mut preshapes: Vec<f64> = poses.iter().map(|(_, preshape)| *preshape).collect();
    preshapes.sort_by(f64::total_cmp);
    preshapes.dedup();
    let carried: Vec<Carried> = preshapes
        .par_iter()
        .map(|preshape| Carried::new(arm, inverse.chain(), bodies, hand, *preshape, flange_from_base))
        .collect::<Result<_, _>>()?;
    let hand_from_flange = hand.base_from_hand.inverse() * flange_from_base.inverse();
    let base_from_world = reacher.scene.world_from_base().inverse();
    let one = |(world_from_hand, preshape): &(Isometry3<f64>, f64)| {
        let index = preshapes.binary_search_by(|other| other.total_cmp(preshape)).unwrap_or(0);
        reacher.reach_one(&(base_from_world * world_from_hand * hand_from_flange), &carried[index])
    };
    Ok(poses.par_iter().map(one).collect())
}

impl Reacher<'_> {
    fn reach_one(&self, base_from_flange: &Isometry3<f64>, hand: &Carried) -> Reach {
        let params = &self.params;
        let mut blocked = None;
        let mut solutions = Vec::new();
        let solved = self.inverse.solve(base_from_flange, params.starts, params.max_angle, |solution| {
            match self.contact(&solution.positions, hand) {
                Some(reason) => blocked = blocked.or(Some(reason)),
                None => solutions.push(solution),
            }
            if solutions.len() >= params.solutions { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        let mut ranked: Vec<(f64, Solution)> = solutions.into_iter().map(|s| (self.cost(&s.positions), s)).collect();
        ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
        let solutions: Vec<Solution> = ranked.into_iter().map(|(_, solution)| solution).collect();
        let reason = match (solved, blocked) {
            _ if !solutions.is_empty() => Reason::Reached,
            (_, Some(reason)) => reason,
            (Err(unsolved), _) => unsolved.into(),
            (Ok(()), _) => Reason::NotFound,
        };
        Reach { reason, solutions }
    }

    /// What a posture touches.
    fn contact(&self, positions: &Positions, hand: &Carried) -> Option<Reason> {
        let frames = self.inverse.chain().frames(positions);
        let placed = self.bodies.place(&frames);
        if let Some(pair) = self.bodies.self_contact(&placed) {
            return Some(Reason::ArmTouchesArm(pair));
        }
        if let Some(body) = self.bodies.hand_contact(&placed, &frames, hand) {
            return Some(Reason::ArmTouchesHand(body));
        }
        self.bodies.moving(&placed).find_map(|(body, solid, at)| {
            self.scene.touches(solid, at).map(|touched| Reason::ArmTouches(body, touched))
        })
    }

    /// Postures with a lower cost are preferred: time from home at full speed, and up to a second more near limits and singularities.
    fn cost(&self, positions: &Positions) -> f64 {
        /// Room and least singular value from which more is no better.
        const ENOUGH_ROOM: f64 = 0.2;
        const ENOUGH_DEXTERITY: f64 = 0.1;
        let chain = self.inverse.chain();
        let room = (chain.room(positions) / ENOUGH_ROOM).min(1.0);
        let dexterity = (chain.least_singular_value(positions) / ENOUGH_DEXTERITY).min(1.0);
        chain.time_from_home(positions) + 1.0 - room.min(dexterity)
    }
}

/// Positions of a solution as a slice.
impl Solution {
    /// Positions of the axes of an arm with `count` of them.
    #[must_use]
    pub fn values(&self, count: usize) -> &[f64] {
        &self.positions[..count.min(MAX_AXES)]
    }
}
