//! Straight lines of the hand: postures along them, each found from the one before.

use crate::chain::{Chain, MAX_AXES, Motion, Positions};
use crate::descent::{Descent, POSITION, ROTATION};
use nalgebra::{Isometry3, Vector3};

/// Longest distance between postures, metres.
const STEP: f64 = 0.005;
/// Greatest change of an axis from posture to posture, rad or m: a greater one is a jump, or a singularity that no drive passes.
const JUMP: f64 = 0.15;
/// Rounding of a position, rad or m.
const ROUNDING: f64 = 1e-9;
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

    /// The first axis that a smooth curve through the postures moves beyond its limit.
    fn beyond(&self, chain: &Chain) -> Option<usize> {
        let leaves = |axis: &usize| {
            let positions: Vec<f64> = self.postures.iter().map(|posture| posture[*axis]).collect();
            let ([lower, upper], [least, greatest]) = (chain.limits(*axis), extremes(&positions));
            least < lower - ROUNDING || greatest > upper + ROUNDING
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

/// Least and greatest value of the cubic spline through evenly spaced values, not-a-knot: the curve that is timed.
fn extremes(values: &[f64]) -> [f64; 2] {
    let bends = bends(values);
    let mut found = [f64::INFINITY, f64::NEG_INFINITY];
    let mut take = |value: f64| found = [found[0].min(value), found[1].max(value)];
    values.iter().for_each(|value| take(*value));
    for (ends, [m, n]) in values.windows(2).zip(bends.windows(2).map(|pair| [pair[0], pair[1]])) {
        // a + b x + c x^2 + d x^3 for x from 0 to 1.
        let (b, c, d) = (ends[1] - ends[0] - (2.0 * m + n) / 6.0, m / 2.0, (n - m) / 6.0);
        let root = (c * c - 3.0 * b * d).max(0.0).sqrt();
        // Both roots of b + 2 c x + 3 d x^2, without a division by d, which may be 0.
        for x in [-b / (c + root), -b / (c - root)] {
            if x > 0.0 && x < 1.0 {
                take(ends[0] + x * (b + x * (c + x * d)));
            }
        }
    }
    found
}

/// Second derivatives of that spline at its values, for a step of 1.
fn bends(values: &[f64]) -> Vec<f64> {
    let last = values.len().saturating_sub(1);
    let second = |i: usize| values[i - 1] - 2.0 * values[i] + values[i + 1];
    let mut bends = vec![0.0; values.len()];
    match last {
        0 | 1 => return bends,
        2 => return vec![second(1); 3],
        _ => {}
    }
    // The third derivative is the same on both sides of the second value and of the last but one: there it is the difference itself.
    (bends[1], bends[last - 1]) = (second(1), second(last - 1));
    // Between them m[i - 1] + 4 m[i] + m[i + 1] = 6 second(i), from left to right and back.
    let mut shares = vec![0.0; values.len()];
    for i in 2..last - 1 {
        let pivot = 4.0 - shares[i - 1];
        shares[i] = 1.0 / pivot;
        bends[i] = (6.0 * second(i) - bends[i - 1]) / pivot;
    }
    for i in (2..last - 1).rev() {
        bends[i] -= shares[i] * bends[i + 1];
    }
    bends[0] = 2.0 * bends[1] - bends[2];
    bends[last] = 2.0 * bends[last - 1] - bends[last - 2];
    bends
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spline_of_a_cubic_is_the_cubic() {
        let cubic = |x: f64| 0.3 + 0.2 * x - 0.7 * x * x + 0.11 * x * x * x;
        for count in [4_u32, 5, 9] {
            let values: Vec<f64> = (0..count).map(|i| cubic(f64::from(i))).collect();
            for (i, bend) in bends(&values).into_iter().enumerate() {
                assert!((bend - (-1.4 + 0.66 * i as f64)).abs() < 1e-9);
            }
            let places = (0..=100_000).map(|i| cubic(f64::from(i) * f64::from(count - 1) / 1e5));
            let [low, high] = places.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [a.min(x), b.max(x)]);
            let [least, greatest] = extremes(&values);
            assert!((least - low).abs() < 1e-7 && (greatest - high).abs() < 1e-7, "{count}");
        }
        // A parabola through three values, and a line through two.
        assert_eq!(extremes(&[0.0, 1.0, 0.0]), [0.0, 1.0]);
        assert!((extremes(&[0.0, 0.3, 0.2])[1] - 0.3125).abs() < 1e-12);
        assert_eq!(extremes(&[0.5, -0.5]), [-0.5, 0.5]);
    }

    /// It swings over a step, by the same amount as scipy's `CubicSpline` (1.17.1, not-a-knot).
    #[test]
    fn a_spline_leaves_the_range_of_its_values() {
        let [least, greatest] = extremes(&[0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]);
        assert!((least + 0.109_240).abs() < 1e-6 && (greatest - 1.109_240).abs() < 1e-6, "{least} {greatest}");
    }
}
