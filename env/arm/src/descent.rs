//! From one posture to a pose: damped least squares within the limits.
//!
//! Each step solves `(J J^T + d I) y = e`, `dq = J^T y` for the error `e` of position (in lengths of the arm) and rotation (rad), with damping `d`
//! in proportion to the squared error: large far away, so that steps stay where the linear model holds, and 0 at a solution, so that convergence is
//! quadratic. An axis at a limit that a step would leave is taken out of `J`, and the step is solved again.
//!
//! Five axes or fewer cannot meet a rotation: position then weighs more and more, until its error is nothing beside that of the rotation, and a last
//! stage meets it exactly.
//!
//! Source: Sugihara, "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method", IEEE Transactions on Robotics 27(5), 2011.

use crate::chain::{Chain, Motion, Positions};
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

/// A position is met within this distance, metres, and a rotation within this angle, rad.
pub const POSITION: f64 = 1e-7;
pub const ROTATION: f64 = 1e-7;
/// Most steps of a stage.
const STEPS: usize = 60;
/// First factor of the squared error in the damping, and its least and greatest value.
const DAMPING: f64 = 0.03;
const LEAST_DAMPING: f64 = 1e-4;
const MOST_DAMPING: f64 = 1e4;
/// Damping that keeps the system solvable where the Jacobian is singular.
const SINGULAR: f64 = 1e-12;
/// Greatest step of an axis, rad or m.
const LONGEST: f64 = 1.0;
/// A step that lowers the squared error by less than this share is slow; after so many of them there is a minimum.
const SLOW: f64 = 0.01;
const PATIENCE: usize = 4;
/// Weights of the position, per length of the arm, of an arm with fewer than six axes, one stage each.
const STAGES: [f64; 3] = [3.0, 30.0, 1000.0];

/// Where a descent ended.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Landing {
    pub positions: Positions,
    /// Distance of the flange from the position, metres.
    pub distance: f64,
    /// Angle to the rotation, rad.
    pub angle: f64,
    /// Axis at a limit that keeps the flange from the pose most, if one does.
    pub held: Option<usize>,
}

impl Landing {
    /// The error as one number: rad, and lengths of the arm.
    pub fn error(&self, length: f64) -> f64 {
        self.angle + self.distance / length
    }
}

/// The error of a posture.
struct Error {
    weighted: Vector6<f64>,
    distance: f64,
    angle: f64,
}

/// The search for one pose.
pub(crate) struct Descent<'a> {
    chain: &'a Chain,
    target: Motion,
}

impl<'a> Descent<'a> {
    pub fn new(chain: &'a Chain, base_from_flange: Motion) -> Self {
        Self { chain, target: base_from_flange }
    }

    /// Descends from a posture within the limits.
    pub fn from(&self, start: &Positions) -> Landing {
        let (one, length) = ([1.0], self.chain.length());
        let stages: &[f64] = if self.chain.len() < 6 { &STAGES } else { &one };
        let mut at = *start;
        let mut held = None;
        for weight in stages {
            held = self.stage(&mut at, weight / (0.5 * length), 1.0);
        }
        if self.chain.len() < 6 {
            // The position alone; the rotation is where the last stage left it.
            self.stage(&mut at, 2.0 / length, 0.0);
        }
        let error = self.error(&at, 1.0, 1.0).0;
        Landing { positions: at, distance: error.distance, angle: error.angle, held }
    }

    /// Descends with fixed weights; returns the axis at a limit that holds the flange back most.
    fn stage(&self, at: &mut Positions, place: f64, turn: f64) -> Option<usize> {
        let (mut error, mut columns) = self.error(at, place, turn);
        let mut cost = error.weighted.norm_squared();
        let (mut factor, mut slow) = (DAMPING, 0);
        for _ in 0..STEPS {
            if error.distance <= POSITION && (error.angle <= ROTATION || turn == 0.0) {
                return None;
            }
            let moved = self.step(at, &columns, &error.weighted, factor * cost + SINGULAR);
            let (next, next_columns) = self.error(&moved, place, turn);
            let next_cost = next.weighted.norm_squared();
            if next_cost >= cost {
                factor *= 8.0;
                slow += 1;
                if factor > MOST_DAMPING || slow > PATIENCE {
                    break;
                }
                continue;
            }
            slow = if cost - next_cost < SLOW * cost { slow + 1 } else { 0 };
            (*at, error, columns, cost) = (moved, next, next_columns, next_cost);
            if slow > PATIENCE {
                break;
            }
            factor = (factor * 0.3).max(LEAST_DAMPING);
        }
        self.holding(at, &columns, &error.weighted)
    }

    /// The error of a posture, and the columns of the weighted Jacobian.
    fn error(&self, at: &Positions, place: f64, turn: f64) -> (Error, [Vector6<f64>; crate::chain::MAX_AXES]) {
        let frames = self.chain.frames(at);
        let away = self.target.shift - frames.flange.shift;
        let rotation = rotation_vector(&(self.target.turn * frames.flange.turn.transpose()));
        let mut columns = [Vector6::zeros(); crate::chain::MAX_AXES];
        for (axis, column) in columns.iter_mut().enumerate().take(self.chain.len()) {
            let own = self.chain.column(&frames, axis);
            *column = Vector6::new(
                own[0] * place,
                own[1] * place,
                own[2] * place,
                own[3] * turn,
                own[4] * turn,
                own[5] * turn,
            );
        }
        let (a, r) = (away * place, rotation * turn);
        let weighted = Vector6::new(a.x, a.y, a.z, r.x, r.y, r.z);
        (Error { weighted, distance: away.norm(), angle: rotation.norm() }, columns)
    }

    /// The next posture.
    fn step(&self, at: &Positions, columns: &[Vector6<f64>], error: &Vector6<f64>, damping: f64) -> Positions {
        let count = self.chain.len();
        let mut free = [true; crate::chain::MAX_AXES];
        let mut moved = *at;
        for _ in 0..=count {
            let mut squares = Matrix6::identity() * damping;
            for column in columns[..count].iter().zip(&free).filter(|(_, free)| **free).map(|(column, _)| column) {
                squares.ger(1.0, column, column, 1.0);
            }
            let Some(factors) = squares.cholesky() else { return moved };
            let solved = factors.solve(error);
            let mut change = [0.0; crate::chain::MAX_AXES];
            let mut longest = LONGEST;
            for axis in (0..count).filter(|axis| free[*axis]) {
                change[axis] = columns[axis].dot(&solved);
                longest = longest.max(change[axis].abs());
            }
            let shrink = LONGEST / longest;
            let mut stopped = false;
            for axis in 0..count {
                if !free[axis] {
                    continue;
                }
                let [lower, upper] = self.chain.limits(axis);
                let wanted = at[axis] + shrink * change[axis];
                let outward = (at[axis] <= lower && change[axis] < 0.0) || (at[axis] >= upper && change[axis] > 0.0);
                if outward {
                    (free[axis], stopped) = (false, true);
                }
                moved[axis] = wanted.clamp(lower, upper);
            }
            if !stopped {
                break;
            }
            for axis in (0..count).filter(|axis| !free[*axis]) {
                moved[axis] = at[axis];
            }
        }
        moved
    }

    /// The axis at a limit along which the error would fall fastest beyond it.
    fn holding(&self, at: &Positions, columns: &[Vector6<f64>], error: &Vector6<f64>) -> Option<usize> {
        /// Gradient below which an axis holds nothing back, of the squared error per rad or m.
        const LEAST_PULL: f64 = 1e-6;
        let pull = |axis: usize| {
            let [lower, upper] = self.chain.limits(axis);
            let fall = columns[axis].dot(error);
            let outward = (at[axis] <= lower && fall < 0.0) || (at[axis] >= upper && fall > 0.0);
            if outward { fall.abs() } else { 0.0 }
        };
        let most = (0..self.chain.len()).max_by(|a, b| pull(*a).total_cmp(&pull(*b)))?;
        (pull(most) > LEAST_PULL).then_some(most)
    }
}

/// Axis times angle of a rotation, with an angle in [0, pi].
fn rotation_vector(turn: &Matrix3<f64>) -> Vector3<f64> {
    let skew =
        Vector3::new(turn[(2, 1)] - turn[(1, 2)], turn[(0, 2)] - turn[(2, 0)], turn[(1, 0)] - turn[(0, 1)]) * 0.5;
    let (sin, cos) = (skew.norm(), 0.5 * (turn.trace() - 1.0));
    if sin > 1e-6 {
        return skew * (sin.atan2(cos) / sin);
    }
    if cos > 0.0 {
        return skew;
    }
    // Half a turn: the axis is the longest column of the symmetric part.
    let symmetric = (turn + Matrix3::identity()) * 0.5;
    let longest = (0..3).max_by(|a, b| symmetric[(*a, *a)].total_cmp(&symmetric[(*b, *b)])).unwrap_or(0);
    let column: Vector3<f64> = symmetric.column(longest).into();
    column.normalize() * std::f64::consts::PI
}
