//! An arm in motion: rates of its axes for a wanted motion, within speed, acceleration and range, and so that it can always stop in free space.
//!
//! Rates change at a constant acceleration within a period. In each period:
//!
//! - A wanted twist becomes rates by damped least squares: `(J J^T + d I) y = v - J z`, `dq = z + J^T y`, with damping `d` near singularities only.
//!   An axis that must brake before its limit is taken out, and the rest is solved again. `z` moves the axes beyond the sixth: towards home with
//!   [`HOMING`], at most [`HOMING_SHARE`] of their speeds. With fewer than six axes position counts more than rotation.
//! - Rates beyond a speed are scaled down together, and so are changes beyond an acceleration: the direction stays.
//! - The rates are accepted if from the end of the period the arm can stop, all axes together, without leaving free space. Else smaller changes are
//!   tried, and at last it stops on the way that was checked a period before.
//!
//! Source of the last rule: Fraichard, Asama, "Inevitable collision states - a step towards safer robots?", Advanced Robotics 18(10), 2004.

use crate::chain::{Chain, Frames, Positions};
use graspbox_hand::{Arm, JointKind};
use nalgebra::{Matrix6, Vector3, Vector6};
use serde::{Deserialize, Serialize};

/// Rate towards home per distance from it, 1/s, and the greatest share of an axis' speed.
pub const HOMING: f64 = 0.5;
pub const HOMING_SHARE: f64 = 0.1;
/// Greatest acceleration of an axis for which none is published, rad/s2 and m/s2.
pub const ASSUMED_ACCELERATION: [f64; 2] = [10.0, 2.0];
/// Metres per radian, for which an error of rotation counts as one of position: with six axes or more, and with fewer.
const LEVERS: [f64; 2] = [0.2, 0.03];
/// Least pivot of `J J^T`, squared metres, below which it is damped, and the greatest damping.
const PIVOT: f64 = 0.0016;
const DAMPING: f64 = 0.0016;
/// Damping of fewer than six axes, which cannot meet every twist.
const FEW_DAMPING: f64 = 1e-5;
/// Shares of a change that are tried if the whole of it is refused.
const SHARES: [f64; 3] = [1.0, 0.5, 0.25];
/// Most periods that a stop takes: beyond, the axes count as stopped.
const MOST_PERIODS: usize = 1000;

/// The axes at one instant. Entries beyond the arm's number of axes are 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AxesState {
    /// rad or m.
    pub positions: Positions,
    /// rad/s or m/s.
    pub rates: Positions,
}

/// The limits of an arm in motion.
#[derive(Clone, Debug)]
pub struct Follower {
    chain: Chain,
    accelerations: Positions,
}

/// The rates at the end of a period.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Next {
    pub rates: Positions,
    /// Something in the way, not a limit of the axes, made them smaller.
    pub blocked: bool,
}

impl Follower {
    /// Takes the limits of an arm; where it states no acceleration, [`ASSUMED_ACCELERATION`] holds.
    #[must_use]
    pub fn new(arm: &Arm, chain: Chain) -> Self {
        let mut accelerations = [0.0; crate::chain::MAX_AXES];
        for ((own, axis), joint) in accelerations.iter_mut().zip(&arm.axes).zip(arm.axis_joints()) {
            let assumed = ASSUMED_ACCELERATION[usize::from(joint.kind == JointKind::Prismatic)];
            *own = axis.acceleration.unwrap_or(assumed);
        }
        Self { chain, accelerations }
    }

    /// The axes.
    #[must_use]
    pub fn chain(&self) -> &Chain {
        &self.chain
    }

    /// Greatest acceleration of an axis, rad/s2 or m/s2.
    #[must_use]
    pub fn acceleration(&self, axis: usize) -> f64 {
        self.accelerations[axis]
    }

    /// Greatest speed of an axis, rad/s or m/s.
    #[must_use]
    pub fn speed(&self, axis: usize) -> f64 {
        self.chain.speed(axis)
    }

    fn count(&self) -> usize {
        self.chain.len()
    }

    /// Velocity (m/s) of a point of the flange and its angular velocity (rad/s), base frame.
    #[must_use]
    pub fn twist(&self, frames: &Frames, point: &Vector3<f64>, rates: &Positions) -> (Vector3<f64>, Vector3<f64>) {
        let mut sum = Vector6::zeros();
        (0..self.count()).for_each(|axis| sum += self.chain.column_at(frames, axis, point) * rates[axis]);
        (sum.fixed_rows::<3>(0).into(), sum.fixed_rows::<3>(3).into())
    }

    /// The rates that the axes have when a contact with a force at a point of a body moves them, up to a factor: `J^T f`.
    ///
    /// * `body`: the axis that moves it.
    #[must_use]
    pub fn yielding(&self, frames: &Frames, body: usize, point: &Vector3<f64>, force: &Vector3<f64>) -> Positions {
        let mut rates = [0.0; crate::chain::MAX_AXES];
        for (axis, rate) in rates.iter_mut().enumerate().take(self.count().min(body + 1)) {
            *rate = self.chain.column_at(frames, axis, point).fixed_rows::<3>(0).dot(force);
        }
        rates
    }

    /// Rates for a twist of a point of the flange, without limits but those that positions impose.
    ///
    /// * `frames`: those of the positions of `state`.
    /// * `linear`, `angular`: m/s and rad/s, base frame.
    /// * `period`: in which they are to be reached, seconds.
    #[must_use]
    pub fn rates(
        &self,
        state: &AxesState,
        frames: &Frames,
        point: &Vector3<f64>,
        (linear, angular): (&Vector3<f64>, &Vector3<f64>),
        period: f64,
    ) -> Positions {
        let few = self.count() < 6;
        let lever = LEVERS[usize::from(few)];
        let mut columns = [Vector6::zeros(); crate::chain::MAX_AXES];
        for (axis, column) in columns.iter_mut().enumerate().take(self.count()) {
            *column = self.chain.column_at(frames, axis, point);
            column.fixed_rows_mut::<3>(3).scale_mut(lever);
        }
        let mut target = Vector6::zeros();
        target.fixed_rows_mut::<3>(0).copy_from(linear);
        target.fixed_rows_mut::<3>(3).copy_from(&(angular * lever));
        let homing = self.homing(state);
        let mut ranges = [[0.0; 2]; crate::chain::MAX_AXES];
        (0..self.count()).for_each(|axis| ranges[axis] = self.brakes(state, axis, period));
        let (mut rates, mut free) = ([0.0; crate::chain::MAX_AXES], [true; crate::chain::MAX_AXES]);
        for _ in 0..=self.count() {
            let mut left = target;
            let mut squares = Matrix6::zeros();
            for axis in 0..self.count() {
                if free[axis] {
                    left -= columns[axis] * homing[axis];
                    squares.ger(1.0, &columns[axis], &columns[axis], 1.0);
                } else {
                    left -= columns[axis] * rates[axis];
                }
            }
            let Some(solved) = damped(squares, few, &left) else { break };
            let mut bound = false;
            for axis in (0..self.count()).filter(|axis| free[*axis]) {
                let wanted = homing[axis] + columns[axis].dot(&solved);
                let [low, high] = ranges[axis];
                rates[axis] = wanted.clamp(low, high);
                if rates[axis] != wanted {
                    bound = true;
                }
            }
            if !bound {
                break;
            }
            // All axes that are bound now stay so; the others are solved again.
            for axis in 0..self.count() {
                let [low, high] = ranges[axis];
                free[axis] &= low < rates[axis] && rates[axis] < high;
            }
        }
        rates
    }

    /// Rates towards home, for axes beyond the sixth.
    fn homing(&self, state: &AxesState) -> Positions {
        let mut homing = [0.0; crate::chain::MAX_AXES];
        if self.count() > 6 {
            for (axis, rate) in homing.iter_mut().enumerate().take(self.count()) {
                let most = HOMING_SHARE * self.speed(axis);
                *rate = (HOMING * (self.chain.home(axis) - state.positions[axis])).clamp(-most, most);
            }
        }
        homing
    }

    /// The rates at the end of a period, towards `wanted` as far as limits and free space allow.
    ///
    /// * `is_free`: whether a way by straight lines from the first posture over the next ones to the last is in free space.
    pub fn next(
        &self,
        state: &AxesState,
        wanted: &Positions,
        period: f64,
        mut is_free: impl FnMut(&[Positions]) -> bool,
    ) -> Next {
        let mut scaled = *wanted;
        let fastest = |rates: &Positions| {
            let share = |axis: usize| rates[axis].abs() / self.speed(axis);
            (0..self.count()).map(share).fold(1.0, f64::max)
        };
        let shrink = fastest(&scaled).recip();
        scaled.iter_mut().for_each(|rate| *rate *= shrink);
        let goal = self.towards(state, &scaled, period);
        let stop = self.stopping(state, period);
        for share in SHARES {
            let mut rates = stop;
            rates.iter_mut().zip(&goal).for_each(|(rate, goal)| *rate += share * (goal - *rate));
            if is_free(&self.way(state, &rates, period)) {
                return Next { rates, blocked: share < 1.0 };
            }
        }
        Next { rates: stop, blocked: true }
    }

    /// Positions after a period in which the rates change at a constant acceleration.
    #[must_use]
    pub fn after(&self, state: &AxesState, rates: &Positions, period: f64) -> AxesState {
        let mut next = AxesState { positions: state.positions, rates: *rates };
        for (axis, position) in next.positions.iter_mut().enumerate().take(self.count()) {
            let [lower, upper] = self.chain.limits(axis);
            // Beyond a limit by rounding only: rates brake before it.
            *position = (*position + 0.5 * (state.rates[axis] + rates[axis]) * period).clamp(lower, upper);
        }
        next
    }

    /// Changes rates towards others by the same share of all differences, within accelerations and ranges.
    fn towards(&self, state: &AxesState, wanted: &Positions, period: f64) -> Positions {
        let mut share = 1.0_f64;
        for ((wanted, rate), acceleration) in wanted.iter().zip(&state.rates).zip(&self.accelerations) {
            let (change, most) = ((wanted - rate).abs(), acceleration * period);
            if change > most {
                share = share.min(most / change);
            }
        }
        let mut rates = state.rates;
        for (axis, rate) in rates.iter_mut().enumerate().take(self.count()) {
            *rate = self.within(state, axis, *rate + share * (wanted[axis] - *rate), period);
        }
        rates
    }

    /// Rates after a period of braking, in which all axes come to rest together.
    fn stopping(&self, state: &AxesState, period: f64) -> Positions {
        let time = |axis: usize| state.rates[axis].abs() / self.accelerations[axis];
        let longest = (0..self.count()).map(time).fold(0.0, f64::max);
        let left = if longest <= period { 0.0 } else { 1.0 - period / longest };
        let mut rates = [0.0; crate::chain::MAX_AXES];
        for (axis, rate) in rates.iter_mut().enumerate().take(self.count()) {
            *rate = self.within(state, axis, state.rates[axis] * left, period);
        }
        rates
    }

    /// The nearest rate at the end of a period within speed and acceleration from which the axis can stop before its limits.
    fn within(&self, state: &AxesState, axis: usize, wanted: f64, period: f64) -> f64 {
        let (a, rate, speed) = (self.accelerations[axis], state.rates[axis], self.speed(axis));
        let [low, high] = [(-speed).max(rate - a * period), speed.min(rate + a * period)];
        // Nearly always the faster answer, and the same: the limits are far.
        let [lower, upper] = self.chain.limits(axis);
        let distance = (state.positions[axis] - lower).min(upper - state.positions[axis]);
        let fastest = wanted.abs().max(rate.abs()) + a * period;
        if fastest * (fastest + 2.0 * a * period) < a * distance {
            return wanted.clamp(low, high);
        }
        let [least, most] = self.brakes(state, axis, period);
        wanted.clamp(low.max(least), high.min(most))
    }

    /// Least and greatest rate at the end of a period from which an axis can stop before its limits.
    ///
    /// From a rate `v` with periods of constant acceleration the axis stops within `v^2 / 2a + a h^2 / 8`; the same holds a period later.
    fn brakes(&self, state: &AxesState, axis: usize, period: f64) -> [f64; 2] {
        let (a, h, rate) = (self.accelerations[axis], period, state.rates[axis]);
        let [lower, upper] = self.chain.limits(axis);
        let most = |distance: f64, rate: f64| {
            let left = distance - 0.5 * rate * h - a * h * h / 8.0;
            let limit = if left > 0.0 { a * ((0.25 * h * h + 2.0 * left / a).sqrt() - 0.5 * h) } else { 0.0 };
            // At any rate the axis can brake.
            limit.max(rate - a * h)
        };
        [-most(state.positions[axis] - lower, -rate), most(upper - state.positions[axis], rate)]
    }

    /// The way of the arm within a period at whose end it has these rates, and while it stops after it: the present posture and those at the ends of the
    /// periods.
    fn way(&self, state: &AxesState, rates: &Positions, period: f64) -> Vec<Positions> {
        let mut at = self.after(state, rates, period);
        let mut way = vec![state.positions];
        for _ in 0..MOST_PERIODS {
            way.push(at.positions);
            if at.rates.iter().all(|rate| *rate == 0.0) {
                break;
            }
            let slower = self.stopping(&at, period);
            at = self.after(&at, &slower, period);
        }
        way
    }
}

/// The solution `y` of `(J J^T + d I) y = v`.
fn damped(squares: Matrix6<f64>, few: bool, target: &Vector6<f64>) -> Option<Vector6<f64>> {
    let with = |damping: f64| (squares + Matrix6::identity() * damping).cholesky();
    if few {
        return Some(with(FEW_DAMPING)?.solve(target));
    }
    let exact = with(1e-12)?;
    let pivot = exact.l_dirty().diagonal().iter().map(|root| root * root).fold(f64::INFINITY, f64::min);
    if pivot >= PIVOT {
        return Some(exact.solve(target));
    }
    Some(with(DAMPING * (1.0 - pivot / PIVOT))?.solve(target))
}

#[cfg(test)]
mod tests;
