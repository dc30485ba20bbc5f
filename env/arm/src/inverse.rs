//! All solutions of a pose that descents from a table of postures find.

use crate::chain::{Chain, MAX_AXES, Motion, Positions};
use crate::descent::{Descent, Landing, POSITION, ROTATION};
use crate::postures::Postures;
use graspbox_hand::Arm;
use nalgebra::Isometry3;
use std::f64::consts::TAU;
use std::ops::ControlFlow;

/// Solutions differ if an axis does by this much, rad or m: of the curve of solutions that seven axes have, samples are enough.
const DISTINCT: f64 = 0.1;
const DISTINCT_ON_CURVE: f64 = 0.3;
/// Seed of the table of postures.
const SEED: u64 = 0;

/// A posture of the arm at a pose.
#[derive(Clone, Copy, Debug)]
pub struct Solution {
    /// Positions of the axes, within their limits, rad or m.
    pub positions: Positions,
    /// Distance of the flange from the position, metres, and angle to the rotation, rad: 0 but for rounding, the angle only with six axes or more.
    pub distance: f64,
    pub angle: f64,
}

/// Why a pose has no solution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unsolved {
    /// It is farther than the axes allow in any posture.
    TooFar,
    /// At the nearest posture found, this axis is at its limit, beyond which the flange would come nearer.
    AtLimit(usize),
    /// With fewer than six axes: its position is met, but its rotation by no less than this angle, rad.
    Turned(f64),
    /// No descent reached it.
    NotFound,
}

/// Inverse kinematics of an arm.
#[derive(Clone, Debug)]
pub struct Inverse {
    chain: Chain,
    postures: Postures,
}

impl Inverse {
    /// Prepares an arm: some milliseconds.
    #[must_use]
    pub fn new(arm: &Arm) -> Self {
        let chain = Chain::new(arm);
        let postures = Postures::new(&chain, SEED);
        Self { chain, postures }
    }

    /// The axes.
    #[must_use]
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// True if the pose is met: the position exactly, the rotation exactly too with six axes or more, else within `max_angle` (rad).
    fn is_met(&self, landing: &Landing, max_angle: f64) -> bool {
        // A solution at the edge of the reach converges slowly; ten times the tolerance is still a micrometre.
        let angle = if self.chain.len() < 6 { max_angle } else { 10.0 * ROTATION };
        landing.distance <= 10.0 * POSITION && landing.angle <= angle
    }

    /// Visits distinct solutions of a pose of the flange, in the order in which they are found, until `visit` breaks.
    ///
    /// * `starts`: number of postures from which descents begin.
    /// * `max_angle`: greatest angle to the rotation, rad, for an arm with fewer than six axes.
    ///
    /// # Errors
    /// [`Unsolved`] if there was none.
    pub fn solve(
        &self,
        base_from_flange: &Isometry3<f64>,
        starts: usize,
        max_angle: f64,
        mut visit: impl FnMut(Solution) -> ControlFlow<()>,
    ) -> Result<(), Unsolved> {
        let target = Motion::new(base_from_flange);
        if self.chain.excess(&target) > 10.0 * POSITION {
            return Err(Unsolved::TooFar);
        }
        let descent = Descent::new(&self.chain, target);
        let mut found: Vec<Positions> = Vec::new();
        let mut nearest: Option<Landing> = None;
        let mut turned: Option<f64> = None;
        for start in self.postures.nearest(&self.chain, &target, starts) {
            let mut landing = descent.from(&start);
            if !self.is_met(&landing, max_angle) {
                if landing.distance <= 10.0 * POSITION && self.chain.len() < 6 {
                    turned = Some(turned.map_or(landing.angle, |least| least.min(landing.angle)));
                }
                let length = self.chain.length();
                if nearest.is_none_or(|best| landing.error(length) < best.error(length)) {
                    nearest = Some(landing);
                }
                continue;
            }
            self.chain.nearest_home(&mut landing.positions);
            if found.iter().any(|known| self.is_same(known, &landing.positions)) {
                continue;
            }
            found.push(landing.positions);
            let Landing { positions, distance, angle, .. } = landing;
            if visit(Solution { positions, distance, angle }).is_break() {
                break;
            }
        }
        if !found.is_empty() {
            return Ok(());
        }
        if let Some(angle) = turned {
            return Err(Unsolved::Turned(angle));
        }
        Err(nearest.and_then(|landing| landing.held).map_or(Unsolved::NotFound, Unsolved::AtLimit))
    }

    /// True for the same posture, whole turns apart.
    fn is_same(&self, a: &Positions, b: &Positions) -> bool {
        let limit = if self.chain.len() > 6 { DISTINCT_ON_CURVE } else { DISTINCT };
        (0..self.chain.len()).all(|axis| {
            let apart = a[axis] - b[axis];
            let turns = if self.chain.is_revolute(axis) { (apart / TAU).round() } else { 0.0 };
            (apart - turns * TAU).abs() < limit
        })
    }

    /// Positions as an array of the chain's capacity.
    #[must_use]
    pub fn positions_of(&self, values: &[f64]) -> Positions {
        let mut positions = [0.0; MAX_AXES];
        positions[..self.chain.len()].copy_from_slice(&values[..self.chain.len()]);
        positions
    }
}
