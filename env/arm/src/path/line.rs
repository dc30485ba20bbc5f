//! Straight lines of the hand: postures along them, each found from the one before.

use crate::chain::{Chain, MAX_AXES, Motion, Positions};
use crate::descent::{Descent, POSITION, ROTATION};
use nalgebra::{Isometry3, Vector3};

/// Longest distance between postures, metres.
const STEP: f64 = 0.005;
/// Greatest change of an axis from posture to posture, rad or m: a greater one is a jump, or a singularity that no drive passes.
const JUMP: f64 = 0.15;
/// How far a smooth curve may leave the chord between two postures, as a share of the greatest second difference of the positions: an eighth
/// of its second derivative, which is about three times that at most.
const BULGE: f64 = 0.375;
/// Greatest distance of a point of the hand from its straight line between two postures, metres.
pub const DEVIATION: f64 = 5e-4;

/// Postures along a line.
#[derive(Clone, Debug)]
pub struct Line {
    /// Distance of each from the first one, metres.
    pub lengths: Vec<f64>,
    pub postures: Vec<Positions>,
    /// How far a point of the hand is from its line at most, metres.
    pub deviation: f64,
}

/// Why there are no such postures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Broken {
    /// This axis is at its limit.
    AtLimit(usize),
    /// The postures do not follow each other.
    Jumps,
}

impl Line {
    /// The flange moves straight, without a turn.
    ///
    /// * `start`: the posture at the beginning.
    /// * `way`: base's frame, metres.
    /// * `radius`: distance of the farthest point of the hand from the flange, metres.
    /// * `max_angle`: greatest turn of the flange, rad, for an arm with fewer than six axes.
    ///
    /// # Errors
    /// [`Broken`], which says where it ends.
    pub fn follow(
        chain: &Chain,
        start: &Positions,
        way: &Vector3<f64>,
        radius: f64,
        max_angle: f64,
    ) -> Result<Self, Broken> {
        let first = chain.frames(start).flange;
        let length = way.norm();
        let count = (length / STEP).ceil().max(1.0) as usize;
        let angle = if chain.len() < 6 { max_angle } else { 10.0 * ROTATION };
        let at = |share: f64| Motion { turn: first.turn, shift: first.shift + way * share };
        let mut line = Self { lengths: vec![0.0], postures: vec![*start], deviation: 0.0 };
        let mut before = *start;
        for number in 1..=count {
            let share = number as f64 / count as f64;
            let landing = Descent::new(chain, at(share)).from(&before);
            if landing.distance > 10.0 * POSITION || landing.angle > angle {
                return Err(landing.held.map_or(Broken::Jumps, Broken::AtLimit));
            }
            let next = landing.positions;
            let middle: Positions = std::array::from_fn(|axis| 0.5 * (before[axis] + next[axis]));
            let half = at(share - 0.5 / count as f64);
            let between = away(chain, &middle, &half, radius);
            let jumps = (0..MAX_AXES).any(|axis| (next[axis] - before[axis]).abs() > JUMP);
            // The five axes of a small arm turn the hand on its line; what they turn from posture to posture is no jump.
            let bend = if chain.len() < 6 { between - away(chain, &next, &at(share), radius) } else { between };
            if jumps || bend > DEVIATION {
                return Err(Broken::Jumps);
            }
            line.deviation = line.deviation.max(between).max(away(chain, &next, &at(share), radius));
            line.lengths.push(length * share);
            line.postures.push(next);
            before = next;
        }
        line.beyond(chain).map_or(Ok(line), |axis| Err(Broken::AtLimit(axis)))
    }

    /// The first axis that a smooth curve through the postures would move beyond its limit.
    fn beyond(&self, chain: &Chain) -> Option<usize> {
        let leaves = |axis: &usize| {
            let bend = |three: &[Positions]| (three[0][*axis] - 2.0 * three[1][*axis] + three[2][*axis]).abs();
            let bulge = BULGE * self.postures.windows(3).map(bend).fold(0.0, f64::max);
            let [lower, upper] = chain.limits(*axis);
            !self.postures.iter().all(|at| lower <= at[*axis] - bulge && at[*axis] + bulge <= upper)
        };
        (0..chain.len()).find(leaves)
    }

    /// The same line, the other way.
    #[must_use]
    pub fn reversed(&self) -> Self {
        let length = self.lengths.last().copied().unwrap_or(0.0);
        Self {
            lengths: self.lengths.iter().rev().map(|from| length - from).collect(),
            postures: self.postures.iter().rev().copied().collect(),
            deviation: self.deviation,
        }
    }

    /// The posture at its end.
    #[must_use]
    pub fn end(&self) -> Positions {
        self.postures.last().copied().unwrap_or([0.0; MAX_AXES])
    }
}

/// How far a point of the hand is from where it should be at most, metres.
fn away(chain: &Chain, positions: &Positions, wanted: &Motion, radius: f64) -> f64 {
    let [is, wanted]: [Isometry3<f64>; 2] = [chain.frames(positions).flange.isometry(), wanted.isometry()];
    (is.translation.vector - wanted.translation.vector).norm() + is.rotation.angle_to(&wanted.rotation) * radius
}
