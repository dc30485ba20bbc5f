//! How contact forces change with the velocities: the contact's part of the derivative of the residual, patch by patch.

use nalgebra::{Matrix3, Vector3};

use crate::kinematics::{Kinematics, Twist};
use crate::problem::Point;
use crate::problem::matrix::Matrix;
use crate::problem::sides::{Side, about_center};

/// Slope of friction in the derivative of the residual.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Slope {
    /// Its derivative, with bounds that follow.
    Follow,
    /// Its derivative, with frozen bounds.
    Frozen,
    /// That of the straight line from no slip to the present friction, with frozen bounds. It is steeper than the derivative, so that a step does
    /// not go far beyond the point where sliding ends.
    Secant,
}

/// The negative derivative of a patch's wrench with respect to its relative twist, in 3 x 3 blocks: `force = -(ll linear + la angular)`,
/// `moment = -(al linear + aa angular)`.
#[derive(Clone, Copy, Default)]
pub(crate) struct Stiffness {
    pub ll: Matrix3<f64>,
    pub la: Matrix3<f64>,
    pub al: Matrix3<f64>,
    pub aa: Matrix3<f64>,
}

impl Stiffness {
    /// Adds one point: `A = -d c / d u`, moved to the reference point.
    ///
    /// With `h = bound / max(|u_t|, stick speed)`, `s` the stiffness of a point that presses (else 0) and `t` the direction of the slip:
    ///
    /// ```text
    /// A = s n n^T + h (1 - n n^T)
    ///   - h t t^T                                        if the point slides: |u_t| > stick speed; not for the secant
    ///   - (mu s / max(|u_t|, stick speed)) u_t n^T       if the bounds follow
    /// ```
    #[inline]
    pub fn add(&mut self, point: &Point, stick: f64, slope: Slope) {
        let n = &point.normal;
        let speed = point.slip_speed.max(stick);
        let grip = point.bound / speed;
        let pressed = if point.impulse > 0.0 { point.stiffness } else { 0.0 };
        let mut by_normal = n * (pressed - grip);
        if slope == Slope::Follow {
            by_normal -= point.slip * (point.friction * pressed / speed);
        }
        let mut a = by_normal * n.transpose();
        for i in 0..3 {
            a[(i, i)] += grip;
        }
        if point.slip_speed > stick && slope != Slope::Secant {
            let along = point.slip / point.slip_speed;
            a -= (along * grip) * along.transpose();
        }
        let r = &point.arm;
        let mut la = Matrix3::zeros();
        for i in 0..3 {
            let row = Vector3::new(a[(i, 0)], a[(i, 1)], a[(i, 2)]);
            let turned = r.cross(&row);
            for c in 0..3 {
                la[(i, c)] = turned[c];
            }
        }
        for c in 0..3 {
            let mut column = self.al.column_mut(c);
            column += r.cross(&a.column(c));
            let mut column = self.aa.column_mut(c);
            column += r.cross(&la.column(c));
        }
        self.ll += a;
        self.la += la;
    }

    /// Adds `J^T K J` to the derivative of the residual, with `K` this stiffness and `J` the Jacobian of the twist of the second side relative to
    /// the first.
    pub fn add_to(&self, derivative: &mut Matrix, kinematics: &Kinematics, sides: &[Side; 2]) {
        self.add_columns(derivative, kinematics, &sides[0], sides, [1.0, -1.0]);
        self.add_columns(derivative, kinematics, &sides[1], sides, [-1.0, 1.0]);
    }

    /// Adds the columns of a side's unknowns, in the rows of both sides with these signs.
    #[inline(always)]
    fn add_columns(
        &self,
        derivative: &mut Matrix,
        kinematics: &Kinematics,
        columns: &Side,
        [a, b]: &[Side; 2],
        signs: [f64; 2],
    ) {
        match columns {
            Side::Hand { start, first, last } => {
                for (j, column) in kinematics.jacobian[*first..*last].iter().enumerate() {
                    let force = self.ll * column.linear + self.la * column.angular;
                    let moment = self.al * column.linear + self.aa * column.angular;
                    let wrench = Twist { linear: force, angular: moment };
                    a.add_to_column(derivative, kinematics, &wrench, signs[0], start + j);
                    b.add_to_column(derivative, kinematics, &wrench, signs[1], start + j);
                }
            }
            Side::Object { start, lever: Some(lever) } => {
                let own = self.by_velocity(lever);
                own.add_to_rows(derivative, kinematics, a, signs[0], *start);
                own.add_to_rows(derivative, kinematics, b, signs[1], *start);
            }
            Side::Object { start, lever: None } => {
                self.add_to_rows(derivative, kinematics, a, signs[0], *start);
                self.add_to_rows(derivative, kinematics, b, signs[1], *start);
            }
            Side::Scenery => {}
        }
    }

    /// Adds `J^T K` to the rows of a side's unknowns, in the six columns of an object from `start` on, with `K` this stiffness by its velocity.
    #[inline(always)]
    fn add_to_rows(&self, derivative: &mut Matrix, kinematics: &Kinematics, side: &Side, sign: f64, start: usize) {
        match side {
            Side::Hand { start: row, first, last } => {
                for (i, column) in kinematics.jacobian[*first..*last].iter().enumerate() {
                    let by_linear = self.ll.tr_mul(&column.linear) + self.al.tr_mul(&column.angular);
                    let by_angular = self.la.tr_mul(&column.linear) + self.aa.tr_mul(&column.angular);
                    let target = derivative.six_mut(row + i, start);
                    for c in 0..3 {
                        target[c] += sign * by_linear[c];
                        target[3 + c] += sign * by_angular[c];
                    }
                }
            }
            Side::Object { start: row, lever: Some(lever) } => {
                self.about_center(lever).add_block(derivative, sign, *row, start);
            }
            Side::Object { start: row, lever: None } => self.add_block(derivative, sign, *row, start),
            Side::Scenery => {}
        }
    }

    /// Adds itself times `sign` to six rows and six columns.
    #[inline(always)]
    fn add_block(&self, derivative: &mut Matrix, sign: f64, row: usize, column: usize) {
        for (first, linear, angular) in [(row, &self.ll, &self.la), (row + 3, &self.al, &self.aa)] {
            for i in 0..3 {
                let target = derivative.six_mut(first + i, column);
                for c in 0..3 {
                    target[c] += sign * linear[(i, c)];
                    target[3 + c] += sign * angular[(i, c)];
                }
            }
        }
    }

    /// The stiffness of twists at the reference point as one of the velocities of an object with this lever.
    #[inline(always)]
    pub fn by_velocity(&self, lever: &Vector3<f64>) -> Self {
        let turn = lever.cross_matrix();
        Self { la: self.la - self.ll * turn, aa: self.aa - self.al * turn, ..*self }
    }

    /// The stiffness of moments about the reference point as one of moments about the centre of mass of an object with this lever.
    #[inline(always)]
    pub fn about_center(&self, lever: &Vector3<f64>) -> Self {
        let turn = lever.cross_matrix();
        Self { al: self.al + turn * self.ll, aa: self.aa + turn * self.la, ..*self }
    }
}

impl Side {
    /// Adds `J^T w` times `sign` to the rows of its unknowns in one column, with `w` a force and its moment about the reference point.
    #[inline(always)]
    fn add_to_column(
        &self,
        derivative: &mut Matrix,
        kinematics: &Kinematics,
        wrench: &Twist,
        sign: f64,
        column: usize,
    ) {
        match self {
            Side::Hand { start, first, last } => {
                for (i, row) in kinematics.jacobian[*first..*last].iter().enumerate() {
                    let value = row.linear.dot(&wrench.linear) + row.angular.dot(&wrench.angular);
                    *derivative.entry_mut(start + i, column) += sign * value;
                }
            }
            Side::Object { start, lever } => {
                let moment = about_center(lever.as_ref(), wrench);
                for i in 0..3 {
                    *derivative.entry_mut(start + i, column) += sign * wrench.linear[i];
                    *derivative.entry_mut(start + 3 + i, column) += sign * moment[i];
                }
            }
            Side::Scenery => {}
        }
    }
}
