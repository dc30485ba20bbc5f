//! The unknowns that move the two sides of a patch: twists at the reference point from velocities, and impulses back into the residual.

use nalgebra::Vector3;

use crate::kinematics::{Kinematics, Twist};
use crate::problem::Touching;
use crate::problem::objects::own_twist;

/// What moves a side of a patch.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Side {
    /// An object: its first unknown, and its lever (see [`super::objects`]).
    Object { start: usize, lever: Option<Vector3<f64>> },
    /// A body of the hand: its columns of the Jacobian, `first` to `last`, which are those of the unknowns from `start` on.
    Hand { start: usize, first: usize, last: usize },
    /// Nothing: its motion is prescribed.
    Scenery,
}

impl Touching {
    /// Twist of the second body relative to the first, at velocities `v`, with the part that is prescribed.
    #[inline(always)]
    pub fn relative_twist(&self, prescribed: &Twist, kinematics: &Kinematics, v: &[f64]) -> Twist {
        let mut twist = *prescribed;
        let [a, b] = &self.sides;
        a.add_twist(kinematics, v, -1.0, &mut twist);
        b.add_twist(kinematics, v, 1.0, &mut twist);
        twist
    }
}

impl Side {
    /// Adds its twist at velocities `v`, times `sign`.
    #[inline(always)]
    fn add_twist(&self, kinematics: &Kinematics, v: &[f64], sign: f64, twist: &mut Twist) {
        match self {
            Side::Object { start, lever } => {
                let mut own = own_twist(&v[*start..]);
                if let Some(lever) = lever {
                    own.linear += own.angular.cross(lever);
                }
                twist.add_scaled(&own, sign);
            }
            Side::Hand { start, first, last } => {
                for (column, v) in kinematics.jacobian[*first..*last].iter().zip(&v[*start..]) {
                    twist.add_scaled(column, sign * v);
                }
            }
            Side::Scenery => {}
        }
    }

    /// Subtracts `J^T c` from the residual, with `c` the impulse and its moment about the reference point in `wrench`, times `sign`.
    #[inline(always)]
    pub fn apply(&self, kinematics: &Kinematics, wrench: &Twist, sign: f64, residual: &mut [f64]) {
        match self {
            Side::Object { start, lever } => {
                let moment = about_center(lever.as_ref(), wrench);
                let own = &mut residual[*start..][..6];
                for i in 0..3 {
                    own[i] -= sign * wrench.linear[i];
                    own[3 + i] -= sign * moment[i];
                }
            }
            Side::Hand { start, first, last } => {
                for (column, r) in kinematics.jacobian[*first..*last].iter().zip(&mut residual[*start..]) {
                    *r -= sign * (column.linear.dot(&wrench.linear) + column.angular.dot(&wrench.angular));
                }
            }
            Side::Scenery => {}
        }
    }
}

/// The moment about the centre of mass of an object with this lever, of a force and its moment about the reference point.
#[inline(always)]
pub(crate) fn about_center(lever: Option<&Vector3<f64>>, wrench: &Twist) -> Vector3<f64> {
    match lever {
        Some(lever) => wrench.angular + lever.cross(&wrench.linear),
        None => wrench.angular,
    }
}
