//! A table of postures, of which the nearest to a pose are where descents begin.
//!
//! An arm whose first axis turns sees every pose as the same one turned about that axis: the table compares poses turned into one plane through it.

use crate::chain::{Chain, MAX_AXES, Motion, Positions};
use nalgebra::{Matrix3, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::f64::consts::{PI, TAU};

/// Number of postures.
const COUNT: usize = 4096;

/// A pose of the flange as twelve numbers, turned about the first axis.
type Seen = [f64; 12];

/// A posture, and how far it turned the first axis to be seen in the plane.
#[derive(Clone, Debug)]
struct Posture {
    positions: Positions,
}

/// The postures, with what the flange's pose is in each.
#[derive(Clone, Debug)]
pub(crate) struct Postures {
    seen: Vec<Seen>,
    postures: Vec<Posture>,
    /// Frame of the first axis, and whether it turns.
    first: Motion,
    turns: bool,
}

impl Postures {
    /// Random postures within the limits; the same for the same seed.
    pub fn new(chain: &Chain, seed: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let at_zero = chain.frames(&[0.0; MAX_AXES]).axes[0];
        let mut table = Self { seen: Vec::new(), postures: Vec::new(), first: at_zero, turns: chain.is_revolute(0) };
        for _ in 0..COUNT {
            let positions = within_limits(chain, || random.random());
            let (seen, azimuth) = table.seen(&chain.frames(&positions).flange, chain.length());
            let mut positions = positions;
            if table.turns {
                positions[0] -= azimuth;
            }
            table.seen.push(seen);
            table.postures.push(Posture { positions });
        }
        table
    }

    /// The `count` postures nearest to a pose of the flange, the nearest first.
    pub fn nearest(&self, chain: &Chain, base_from_flange: &Motion, count: usize) -> Vec<Positions> {
        let (wanted, azimuth) = self.seen(base_from_flange, chain.length());
        let mut ranked: Vec<(f64, usize)> = self
            .seen
            .iter()
            .enumerate()
            .map(|(index, seen)| (seen.iter().zip(&wanted).map(|(a, b)| (a - b) * (a - b)).sum(), index))
            .collect();
        let order = |a: &(f64, usize), b: &(f64, usize)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
        if ranked.len() > count {
            ranked.select_nth_unstable_by(count, order);
            ranked.truncate(count);
        }
        ranked.sort_by(order);
        ranked.into_iter().map(|(_, index)| self.turned(chain, index, azimuth)).collect()
    }

    /// A posture, turned back about the first axis.
    fn turned(&self, chain: &Chain, index: usize, azimuth: f64) -> Positions {
        let mut positions = self.postures[index].positions;
        if self.turns {
            let [lower, upper] = chain.limits(0);
            let wanted = positions[0] + azimuth;
            let middle = 0.5 * (lower + upper);
            positions[0] = (wanted - TAU * ((wanted - middle) / TAU).round()).clamp(lower, upper);
        }
        positions
    }

    /// A pose in the plane through the first axis, and the angle by which it was turned there.
    fn seen(&self, base_from_flange: &Motion, length: f64) -> (Seen, f64) {
        let mut local = Motion {
            turn: self.first.turn.tr_mul(&base_from_flange.turn),
            shift: self.first.turn.tr_mul(&(base_from_flange.shift - self.first.shift)),
        };
        let azimuth = if self.turns { local.shift.y.atan2(local.shift.x) } else { 0.0 };
        let back = Matrix3::from(nalgebra::Rotation3::from_axis_angle(&Vector3::z_axis(), -azimuth));
        local = Motion { turn: back * local.turn, shift: back * local.shift * (2.0 / length) };
        let mut seen = [0.0; 12];
        // A rotation by a small angle changes the nine entries by sqrt 2 of it.
        seen[..9].copy_from_slice(&local.turn.as_slice().iter().map(|x| x * 0.5).collect::<Vec<_>>());
        seen[9..].copy_from_slice(local.shift.as_slice());
        (seen, azimuth)
    }
}

/// A random posture; of an axis with more than one turn, the turn about its home.
pub(crate) fn within_limits(chain: &Chain, mut random: impl FnMut() -> f64) -> Positions {
    let mut positions = [0.0; MAX_AXES];
    for (axis, position) in positions.iter_mut().enumerate().take(chain.len()) {
        let [mut lower, mut upper] = chain.limits(axis);
        if chain.is_revolute(axis) && upper - lower > TAU {
            let home = chain.home(axis).clamp(lower + PI, upper - PI);
            (lower, upper) = (home - PI, home + PI);
        }
        *position = lower + (upper - lower) * random();
    }
    positions
}
