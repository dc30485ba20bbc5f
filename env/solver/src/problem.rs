//! The equations of one step in the velocities at its end, their residual and their derivative.
//!
//! Unknowns are the velocities `v` of the hand's free coordinates and of the object (linear, of its centre of mass, then angular):
//!
//! ```text
//! r(v) = M v - p - dt sum of cable and stop forces(v) - J' c(v J) = 0
//! ```
//!
//! with the mass matrix `M` (with damping), the momentum `p` that the step would end with without these forces, and the contact impulses
//! `c`. A contact point with relative velocity `u`, normal `n`, normal speed `u_n = n . u` and sliding velocity `u_t` gets
//!
//! ```text
//! normal    g = max(0, dt k (dt + tau) (target - u_n)),  target = min(depth, cap) / (dt + tau)
//! friction  -mu g u_t / max(|u_t|, stick speed)
//! ```
//!
//! a spring with damping, implicit in the new velocity, and Coulomb's law, regularised below the stick speed. Both follow the contact
//! models of MuJoCo's and Drake's documentation (SAP: Castro et al., 2022), but friction is not associated: its bound
//! follows the normal impulse within the step, so that sliding does not lift. The Jacobian of that is not symmetric.

use nalgebra::{Matrix3, Vector3};

use crate::kinematics::{Kinematics, Twist};
use crate::laws::{CableState, stop};
use crate::matrix::Matrix;
use crate::model::{BASE, BodyIndex, Model, OBJECT};

/// A contact point during one step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Point {
    /// From the reference, metres.
    pub arm: Vector3<f64>,
    /// From body a to body b.
    pub normal: Vector3<f64>,
    /// Its moment about the reference.
    pub moment: Vector3<f64>,
    /// Normal speed at which the point presses no more, m/s.
    pub target: f64,
    /// Normal impulse per normal speed below that, N s/(m/s).
    pub stiffness: f64,
    pub friction: f64,
    /// Normal impulse, N s.
    pub impulse: f64,
    /// Greatest friction impulse, N s.
    pub bound: f64,
    /// Relative normal speed, m/s.
    pub approach: f64,
    /// Sliding velocity, m/s, and its size.
    pub slide: Vector3<f64>,
    pub speed: f64,
}

/// The contact points of two bodies.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Patch {
    pub a: BodyIndex,
    pub b: BodyIndex,
    pub first: usize,
    pub last: usize,
    /// What driven coordinates and the scenery's motion add to the relative twist.
    pub known: Twist,
}

/// How friction's bounds are treated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Bounds {
    /// They follow the normal impulses.
    Follow,
    /// They stay as the last evaluation left them: the problem is convex then.
    Frozen,
}

/// The equations of one step; buffers are kept from step to step.
#[derive(Clone, Default)]
pub(crate) struct Problem {
    pub dt: f64,
    pub stick_speed: f64,
    /// Mass matrix of the free coordinates, with damping.
    pub mass: Matrix,
    pub object_mass: f64,
    /// The object's inertia, axes of the base.
    pub object_inertia: Matrix3<f64>,
    /// Momentum without the forces that depend on `v`, by unknown.
    pub momentum: Vec<f64>,
    /// Velocities, by unknown.
    pub v: Vec<f64>,
    /// Positions of the free coordinates at the beginning.
    pub q: Vec<f64>,
    pub cables: Vec<CableState>,
    pub points: Vec<Point>,
    pub patches: Vec<Patch>,
    /// Residual at `v`.
    pub residual: Vec<f64>,
    /// Its derivative.
    pub derivative: Matrix,
}

/// Derivative of a patch's wrench by its relative twist, with the sign turned: `force = -(ll linear + la angular)` and so on.
#[derive(Clone, Copy, Default)]
struct Stiffness {
    ll: Matrix3<f64>,
    la: Matrix3<f64>,
    al: Matrix3<f64>,
    aa: Matrix3<f64>,
}

impl Problem {
    pub fn new(model: &Model) -> Self {
        let (free, all) = (model.tree.coordinates.len(), model.unknowns());
        Self {
            stick_speed: model.solver.stick_speed,
            mass: Matrix::new(free),
            object_inertia: Matrix3::identity(),
            momentum: vec![0.0; all],
            v: vec![0.0; all],
            q: vec![0.0; free],
            cables: vec![CableState::default(); model.tree.cables.len()],
            residual: vec![0.0; all],
            derivative: Matrix::new(all),
            ..Self::default()
        }
    }

    /// Twist of the object.
    #[inline(always)]
    fn object_twist(&self) -> Twist {
        let v = &self.v[self.q.len()..];
        Twist { linear: Vector3::new(v[0], v[1], v[2]), angular: Vector3::new(v[3], v[4], v[5]) }
    }

    /// Sets the object's velocities to those of a body that moves with `twist`.
    pub fn set_object_twist(&mut self, twist: &Twist) {
        let v = &mut self.v[self.q.len()..];
        v[..3].copy_from_slice(twist.linear.as_slice());
        v[3..].copy_from_slice(twist.angular.as_slice());
    }

    /// Contact impulses and residual at `v`; returns the residual's size: the sum of its squares over the masses.
    pub fn evaluate(&mut self, model: &Model, kinematics: &Kinematics, bounds: Bounds) -> f64 {
        self.smooth_residual(model);
        for index in 0..self.patches.len() {
            let patch = self.patches[index];
            let twist = self.relative_twist(model, kinematics, &patch);
            if let Some(wrench) = self.press(&patch, &twist, bounds) {
                self.spread(model, kinematics, &patch, &wrench);
            }
        }
        let free = self.q.len();
        let mut size = 0.0;
        for (i, r) in self.residual[..free].iter().enumerate() {
            size += r * r / self.mass.row(i)[i];
        }
        for i in 0..3 {
            let (linear, angular) = (self.residual[free + i], self.residual[free + 3 + i]);
            size += linear * linear / self.object_mass + angular * angular / self.object_inertia[(i, i)];
        }
        size
    }

    /// Everything but contacts.
    fn smooth_residual(&mut self, model: &Model) {
        let free = self.q.len();
        let dt = self.dt;
        for i in 0..free {
            let block = model.blocks[i].clone();
            let row = &self.mass.row(i)[block.clone()];
            let sum: f64 = row.iter().zip(&self.v[block]).map(|(m, v)| m * v).sum();
            let torque = stop(&model.tree.coordinates[i], self.q[i], self.v[i], dt).0;
            self.residual[i] = sum - self.momentum[i] - dt * torque;
        }
        for (state, cable) in self.cables.iter_mut().zip(&model.tree.cables) {
            state.force = state.law(cable, state.rate(cable, &self.v), dt).0;
            for (coordinate, arm) in &cable.arms {
                self.residual[*coordinate] -= dt * state.force * arm;
            }
        }
        let twist = self.object_twist();
        let spin = self.object_inertia * twist.angular;
        for i in 0..3 {
            self.residual[free + i] = self.object_mass * twist.linear[i] - self.momentum[free + i];
            self.residual[free + 3 + i] = spin[i] - self.momentum[free + 3 + i];
        }
    }

    #[inline]
    fn relative_twist(&self, model: &Model, kinematics: &Kinematics, patch: &Patch) -> Twist {
        let mut twist = patch.known;
        for (body, sign) in [(patch.a, -1.0), (patch.b, 1.0)] {
            if body == OBJECT {
                twist.add_scaled(&self.object_twist(), sign);
            } else if body < model.scenery_body() {
                let columns = model.columns[body - BASE].clone();
                for (column, v) in kinematics.columns(model, body - BASE).iter().zip(&self.v[columns]) {
                    twist.add_scaled(column, sign * v);
                }
            }
        }
        twist
    }

    /// Impulses of a patch's points; returns their sum on body b, force and moment about the reference, if any presses.
    #[inline]
    fn press(&mut self, patch: &Patch, twist: &Twist, bounds: Bounds) -> Option<Twist> {
        let mut sum = Twist::default();
        let mut any = false;
        let stick = self.stick_speed;
        for point in &mut self.points[patch.first..patch.last] {
            let approach = point.normal.dot(&twist.linear) + point.moment.dot(&twist.angular);
            point.approach = approach;
            point.impulse = ((point.target - approach) * point.stiffness).max(0.0);
            if bounds == Bounds::Follow {
                point.bound = point.friction * point.impulse;
            }
            if point.impulse <= 0.0 && point.bound <= 0.0 {
                continue;
            }
            point.slide = twist.at(&point.arm) - point.normal * approach;
            point.speed = point.slide.norm();
            let grip = point.bound / point.speed.max(stick);
            let force = point.normal * point.impulse - point.slide * grip;
            sum.linear += force;
            sum.angular += point.arm.cross(&force);
            any = true;
        }
        any.then_some(sum)
    }

    /// Takes a patch's impulse (force and moment on body b) off the residual.
    #[inline]
    fn spread(&mut self, model: &Model, kinematics: &Kinematics, patch: &Patch, wrench: &Twist) {
        for (body, sign) in [(patch.a, -1.0), (patch.b, 1.0)] {
            if body == OBJECT {
                let free = self.q.len();
                for i in 0..3 {
                    self.residual[free + i] -= sign * wrench.linear[i];
                    self.residual[free + 3 + i] -= sign * wrench.angular[i];
                }
            } else if body < model.scenery_body() {
                let columns = model.columns[body - BASE].clone();
                for (column, r) in kinematics.columns(model, body - BASE).iter().zip(&mut self.residual[columns]) {
                    *r -= sign * (column.linear.dot(&wrench.linear) + column.angular.dot(&wrench.angular));
                }
            }
        }
    }

    /// The derivative of the residual where it was evaluated last.
    pub fn differentiate(&mut self, model: &Model, kinematics: &Kinematics, bounds: Bounds) {
        self.smooth_derivative(model);
        for index in 0..self.patches.len() {
            let patch = self.patches[index];
            let points = &self.points[patch.first..patch.last];
            let mut sum = Stiffness::default();
            let mut any = false;
            for point in points.iter().filter(|p| p.impulse > 0.0 || p.bound > 0.0) {
                sum.add(point, self.stick_speed, bounds);
                any = true;
            }
            if any {
                self.project(model, kinematics, &patch, &sum);
            }
        }
    }

    fn smooth_derivative(&mut self, model: &Model) {
        let free = self.q.len();
        let dt = self.dt;
        for i in 0..free + 6 {
            self.derivative.row_mut(i).fill(0.0);
        }
        for (i, coordinate) in model.tree.coordinates.iter().enumerate() {
            let block = model.blocks[i].clone();
            self.derivative.row_mut(i)[block.clone()].copy_from_slice(&self.mass.row(i)[block]);
            self.derivative.row_mut(i)[i] += dt * stop(coordinate, self.q[i], self.v[i], dt).1;
        }
        for (state, cable) in self.cables.iter().zip(&model.tree.cables) {
            let slope = state.law(cable, state.rate(cable, &self.v), dt).1;
            if slope == 0.0 {
                continue;
            }
            for (i, arm) in &cable.arms {
                let row = self.derivative.row_mut(*i);
                for (j, other) in &cable.arms {
                    row[*j] += dt * slope * arm * other;
                }
            }
        }
        for i in 0..3 {
            self.derivative.row_mut(free + i)[free + i] = self.object_mass;
            for j in 0..3 {
                self.derivative.row_mut(free + 3 + i)[free + 3 + j] = self.object_inertia[(i, j)];
            }
        }
    }

    /// Adds a patch's stiffness to the derivative.
    fn project(&mut self, model: &Model, kinematics: &Kinematics, patch: &Patch, k: &Stiffness) {
        let free = self.q.len();
        let sides = [(patch.a, -1.0), (patch.b, 1.0)];
        let columns = |body: BodyIndex| {
            if body == OBJECT || body >= model.scenery_body() {
                (0, [].as_slice())
            } else {
                (model.columns[body - BASE].start, kinematics.columns(model, body - BASE))
            }
        };
        for (body, sign) in sides {
            let (start, own) = columns(body);
            for (j, column) in own.iter().enumerate() {
                let force = k.ll * column.linear + k.la * column.angular;
                let moment = k.al * column.linear + k.aa * column.angular;
                for (other, other_sign) in sides {
                    let s = sign * other_sign;
                    let (first, rows) = columns(other);
                    for (i, row) in rows.iter().enumerate() {
                        let value = row.linear.dot(&force) + row.angular.dot(&moment);
                        self.derivative.row_mut(first + i)[start + j] += s * value;
                    }
                    if other == OBJECT {
                        for i in 0..3 {
                            self.derivative.row_mut(free + i)[start + j] += s * force[i];
                            self.derivative.row_mut(free + 3 + i)[start + j] += s * moment[i];
                        }
                    }
                }
            }
            if body == OBJECT {
                for (other, other_sign) in sides {
                    let s = sign * other_sign;
                    let (first, rows) = columns(other);
                    for (i, row) in rows.iter().enumerate() {
                        let by_linear = k.ll.tr_mul(&row.linear) + k.al.tr_mul(&row.angular);
                        let by_angular = k.la.tr_mul(&row.linear) + k.aa.tr_mul(&row.angular);
                        let target = &mut self.derivative.row_mut(first + i)[free..];
                        for c in 0..3 {
                            target[c] += s * by_linear[c];
                            target[3 + c] += s * by_angular[c];
                        }
                    }
                }
                for i in 0..3 {
                    let row = &mut self.derivative.row_mut(free + i)[free..];
                    for c in 0..3 {
                        row[c] += k.ll[(i, c)];
                        row[3 + c] += k.la[(i, c)];
                    }
                    let row = &mut self.derivative.row_mut(free + 3 + i)[free..];
                    for c in 0..3 {
                        row[c] += k.al[(i, c)];
                        row[3 + c] += k.aa[(i, c)];
                    }
                }
            }
        }
    }
}

impl Stiffness {
    /// Adds one point: `A = -d force / d u`, moved to the reference.
    #[inline]
    fn add(&mut self, point: &Point, stick: f64, bounds: Bounds) {
        let n = &point.normal;
        let speed = point.speed.max(stick);
        let grip = point.bound / speed;
        let pressed = if point.impulse > 0.0 { point.stiffness } else { 0.0 };
        // k n n' + grip (1 - n n'), and the coupling of friction to the normal speed.
        let mut by_normal = n * (pressed - grip);
        if bounds == Bounds::Follow {
            by_normal -= point.slide * (point.friction * pressed / speed);
        }
        let mut a = by_normal * n.transpose();
        for i in 0..3 {
            a[(i, i)] += grip;
        }
        if point.speed > stick {
            // A sliding contact resists only across its slide.
            let along = point.slide / point.speed;
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
}
