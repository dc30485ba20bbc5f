//! How contact forces change with the velocities: the contact's part of the derivative of the residual, patch by patch.

use nalgebra::{Matrix3, Vector3};

use crate::problem::Point;

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
