//! The equations of one step in the velocities at its end: their residual and its derivative.
//!
//! Unknowns are the velocities `v` of the hand's free coordinates and of the objects (linear, of the centre of mass, then angular), those of one
//! island at a time (`islands`):
//!
//! ```text
//! r(v) = (M + dt D) v - p - dt f(v) - J^T c(J v + u_0) = 0
//! ```
//!
//! * `M`: mass matrix with armature; `D`: damping of the free coordinates and of saturated cables.
//! * `p = M v_0 + dt (bias + spring forces)`: momentum at the end of the step without damping, `f` and `c`.
//! * `f(v)`: forces of cables and joint stops at the end of the step (`laws`).
//! * `J`: the contact Jacobian; `u = J v + u_0` are the velocities of the second body of each contact relative to the first, `u_0` the part that
//!   prescribed motion adds (driven coordinates, the table).
//! * `c(u)`: contact impulses on the second body, N s.
//!
//! A contact point with unit normal `n` from the first to the second body, normal speed `u_n = n . u` (positive: the bodies separate) and
//! slip velocity `u_t = u - u_n n` gets
//!
//! ```text
//! normal    g = max(0, dt k (dt + tau) (target - u_n)),   target = depth / (dt + tau)
//!             = max(0, dt k (depth - (dt + tau) u_n))
//! friction  c_t = -mu g u_t / max(|u_t|, stick speed)
//! ```
//!
//! The normal impulse is that of a spring of stiffness `k` at the depth of the end of the step, with damping `k tau`. Friction is Coulomb's
//! law, regularized below the stick speed. `rows` documents `k`, `tau` and `depth`.
//!
//! Both laws resemble those of MuJoCo and of Drake's SAP (Castro et al., "An unconstrained convex formulation of compliant contact", 2022).
//! Those relax friction to a convex problem, in which sliding pushes bodies apart. Here the bound `mu g` follows the normal impulse within the
//! step, so sliding does not lift; the derivative of the residual is then not symmetric. With the bounds frozen the contact impulses are minus
//! the gradient of a convex function, and the derivative is symmetric and positive definite.

pub(crate) mod islands;
pub(crate) mod matrix;
pub(crate) mod newton;
pub(crate) mod objects;
pub(crate) mod ordering;
pub(crate) mod rows;
pub(crate) mod sides;
pub(crate) mod stiffness;

use nalgebra::Vector3;

use crate::kinematics::{Kinematics, Twist};
use crate::laws::{CableState, stop};
use crate::model::{BodyKind, Model};
use crate::problem::matrix::Matrix;
use crate::problem::objects::{ObjectTerms, own_twist};
use crate::problem::sides::Side;
use crate::problem::stiffness::{Slope, Stiffness};

/// A contact point during one step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Point {
    /// Position relative to the reference point, metres.
    pub arm: Vector3<f64>,
    /// Unit normal from body a to body b.
    pub normal: Vector3<f64>,
    /// `arm x normal`, metres.
    pub moment: Vector3<f64>,
    /// Normal speed from which the point no longer presses, m/s.
    pub target: f64,
    /// Normal impulse per normal speed below `target`, N s/(m/s).
    pub stiffness: f64,
    /// Coefficient of friction.
    pub friction: f64,
    /// Normal impulse, N s.
    pub impulse: f64,
    /// Greatest friction impulse, N s.
    pub bound: f64,
    /// Normal speed of body b relative to body a, m/s; positive while they separate.
    pub normal_speed: f64,
    /// Slip velocity, m/s.
    pub slip: Vector3<f64>,
    /// Its norm, m/s.
    pub slip_speed: f64,
}

impl Point {
    /// Friction impulse on body b, N s; `stick`: slip speed from which friction slides, m/s.
    #[inline]
    pub fn friction_impulse(&self, stick: f64) -> Vector3<f64> {
        if self.bound <= 0.0 {
            return Vector3::zeros(); // `slip` may be that of an earlier evaluation
        }
        -self.slip * (self.bound / self.slip_speed.max(stick))
    }
}

/// The contact points of two bodies.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Patch {
    /// Bodies a and b.
    pub sides: [BodyKind; 2],
    pub first: usize,
    pub last: usize,
    /// Prescribed part of the twist of b relative to a: from driven coordinates and the motion of the scenery.
    pub prescribed: Twist,
}

/// A patch of the island.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Touching {
    /// Index in [`Problem::patches`].
    pub patch: usize,
    /// What moves its bodies.
    pub sides: [Side; 2],
}

/// Treatment of friction's bounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Bounds {
    /// They follow the normal impulses.
    Follow,
    /// They move halfway to those of the normal impulses.
    Halfway,
    /// They keep the values of the last evaluation that let them follow; the problem is then convex.
    Frozen,
}

/// The hand during one step.
#[derive(Clone, Default)]
pub(crate) struct HandTerms {
    /// `M + dt D` of the free coordinates.
    pub mass: Matrix,
    /// Positions of the free coordinates at the beginning of the step.
    pub q: Vec<f64>,
    pub momentum: Vec<f64>,
    /// Velocities at the beginning of the step, and once the step is solved at its end.
    pub velocity: Vec<f64>,
    pub cables: Vec<CableState>,
}

/// Results of an evaluation.
#[derive(Clone, Default)]
struct Evaluation {
    residual: Vec<f64>,
    points: Vec<Point>,
    cables: Vec<CableState>,
}

/// The equations of one step, and of the island that is being solved; buffers are kept from step to step.
#[derive(Clone, Default)]
pub(crate) struct Problem {
    pub dt: f64,
    pub stick_speed: f64,
    pub hand: HandTerms,
    pub objects: Vec<ObjectTerms>,
    pub points: Vec<Point>,
    pub patches: Vec<Patch>,
    /// Velocities, by unknown of the island.
    pub v: Vec<f64>,
    /// Residual at `v`.
    pub residual: Vec<f64>,
    pub derivative: Matrix,
    /// Metres per unit of each unknown, see [`Model::levers`].
    pub levers: Vec<f64>,
    momentum: Vec<f64>,
    /// Number of the hand's coordinates among the unknowns: all or none.
    free: usize,
    /// Objects among the unknowns, in their order.
    members: Vec<usize>,
    /// First unknown of each object, if it is a member.
    start: Vec<usize>,
    /// The island's patches.
    touching: Vec<Touching>,
    /// Friction bounds of the island's points, see [`Problem::keep_bounds`].
    kept_bounds: Vec<f64>,
    /// See [`Problem::keep`].
    kept: Evaluation,
}

impl Problem {
    pub fn new(model: &Model) -> Self {
        let free = model.tree.coordinates.len();
        let hand = HandTerms {
            mass: Matrix::new(free),
            q: vec![0.0; free],
            momentum: vec![0.0; free],
            velocity: vec![0.0; free],
            cables: vec![CableState::default(); model.tree.cables.len()],
        };
        Self {
            stick_speed: model.config.stick_speed,
            hand,
            objects: vec![ObjectTerms::default(); model.object_count()],
            start: vec![usize::MAX; model.object_count()],
            ..Self::default()
        }
    }

    pub fn unknowns(&self) -> usize {
        self.v.len()
    }

    /// Number of contact points of the island.
    pub fn point_count(&self) -> usize {
        let count = |patch: &Patch| patch.last - patch.first;
        self.touching.iter().map(|touching| count(&self.patches[touching.patch])).sum()
    }

    /// Moves the objects with a twist at the reference point.
    pub fn set_twist_of_objects(&mut self, twist: &Twist) {
        for &object in &self.members {
            let start = self.start[object];
            self.v[start..start + 6].copy_from_slice(&self.objects[object].velocity_of(twist));
        }
    }

    /// Whether an object of the island touches the scenery, or a sleeper.
    pub fn rests_on_scenery(&self) -> bool {
        let rests = |touching: &Touching| {
            matches!(touching.sides, [Side::Object { .. }, Side::Scenery] | [Side::Scenery, Side::Object { .. }])
        };
        self.touching.iter().any(rests)
    }

    /// Computes contact impulses and residual at `v`.
    pub fn evaluate(&mut self, model: &Model, kinematics: &Kinematics, bounds: Bounds) {
        self.smooth_residual(model);
        for touching in &self.touching {
            let patch = &self.patches[touching.patch];
            let twist = touching.relative_twist(&patch.prescribed, kinematics, &self.v);
            let points = &mut self.points[patch.first..patch.last];
            if let Some(wrench) = contact_impulses(points, &twist, bounds, self.stick_speed) {
                let [a, b] = &touching.sides;
                a.apply(kinematics, &wrench, -1.0, &mut self.residual);
                b.apply(kinematics, &wrench, 1.0, &mut self.residual);
            }
        }
    }

    /// The same with bounds that follow. Returns the size of the residual, `sum of r_i^2 / M_ii`, joules.
    pub fn evaluate_size(&mut self, model: &Model, kinematics: &Kinematics) -> f64 {
        self.evaluate(model, kinematics, Bounds::Follow);
        let mut size = 0.0;
        for (i, r) in self.residual[..self.free].iter().enumerate() {
            size += r * r / self.hand.mass.row(i)[i];
        }
        for &object in &self.members {
            let (own, start) = (&self.objects[object], self.start[object]);
            for i in 0..3 {
                let (linear, angular) = (self.residual[start + i], self.residual[start + 3 + i]);
                size += linear * linear / own.mass + angular * angular / own.inertia[(i, i)];
            }
        }
        size
    }

    /// Keeps the results of the last evaluation for [`Problem::restore`].
    pub fn keep(&mut self) {
        self.kept.residual.clone_from(&self.residual);
        self.kept.cables.clone_from(&self.hand.cables);
        self.kept.points.clear();
        for touching in &self.touching {
            let patch = &self.patches[touching.patch];
            self.kept.points.extend_from_slice(&self.points[patch.first..patch.last]);
        }
    }

    /// Returns to the evaluation that was kept last for this island, at velocities `v`.
    pub fn restore(&mut self, v: &[f64]) {
        self.v.copy_from_slice(v);
        self.residual.clone_from(&self.kept.residual);
        self.hand.cables.clone_from(&self.kept.cables);
        let mut kept = self.kept.points.as_slice();
        for touching in &self.touching {
            let patch = &self.patches[touching.patch];
            let points = &mut self.points[patch.first..patch.last];
            let (own, rest) = kept.split_at(points.len());
            points.copy_from_slice(own);
            kept = rest;
        }
    }

    /// Largest change of an object's speed that the residual would cause if the objects were free, m/s; angular velocities count by their levers.
    pub fn residual_speed(&self) -> f64 {
        let mut most = 0.0_f64;
        for &object in &self.members {
            let (own, start) = (&self.objects[object], self.start[object]);
            for i in 0..3 {
                let (linear, angular) = (self.residual[start + i], self.residual[start + 3 + i]);
                let turn = angular / own.inertia[(i, i)] * self.levers[start + 3 + i];
                most = most.max((linear / own.mass).abs()).max(turn.abs());
            }
        }
        most
    }

    /// The residual without contacts.
    fn smooth_residual(&mut self, model: &Model) {
        if self.free > 0 {
            self.smooth_residual_of_hand(model);
        }
        for &object in &self.members {
            let (own, start) = (&self.objects[object], self.start[object]);
            let twist = own_twist(&self.v[start..]);
            let spin = own.inertia * twist.angular;
            for i in 0..3 {
                self.residual[start + i] = own.mass * twist.linear[i] - self.momentum[start + i];
                self.residual[start + 3 + i] = spin[i] - self.momentum[start + 3 + i];
            }
        }
    }

    fn smooth_residual_of_hand(&mut self, model: &Model) {
        let dt = self.dt;
        for i in 0..self.free {
            let block = model.blocks[i].clone();
            let row = &self.hand.mass.row(i)[block.clone()];
            let sum: f64 = row.iter().zip(&self.v[block]).map(|(m, v)| m * v).sum();
            let torque = stop(&model.tree.coordinates[i], self.hand.q[i], self.v[i], dt).0;
            self.residual[i] = sum - self.momentum[i] - dt * torque;
        }
        for (state, cable) in self.hand.cables.iter_mut().zip(&model.tree.cables) {
            state.force = state.law(cable, state.rate(cable, &self.v), dt).0;
            for (coordinate, arm) in &cable.arms {
                self.residual[*coordinate] -= dt * state.force * arm;
            }
        }
    }

    /// Computes the derivative of the residual at the velocities of the last evaluation.
    pub fn differentiate(&mut self, model: &Model, kinematics: &Kinematics, slope: Slope) {
        self.smooth_derivative(model);
        for touching in &self.touching {
            let patch = &self.patches[touching.patch];
            let mut sum = Stiffness::default();
            let mut any = false;
            for point in self.points[patch.first..patch.last].iter().filter(|p| p.impulse > 0.0 || p.bound > 0.0) {
                sum.add(point, self.stick_speed, slope);
                any = true;
            }
            if any {
                sum.add_to(&mut self.derivative, kinematics, &touching.sides);
            }
        }
    }

    /// The derivative without contacts: `M + dt D` and the slopes of cables and stops.
    fn smooth_derivative(&mut self, model: &Model) {
        self.derivative.clear();
        if self.free > 0 {
            self.smooth_derivative_of_hand(model);
        }
        for &object in &self.members {
            let (own, start) = (&self.objects[object], self.start[object]);
            for i in 0..3 {
                self.derivative.row_mut(start + i)[start + i] = own.mass;
                for j in 0..3 {
                    self.derivative.row_mut(start + 3 + i)[start + 3 + j] = own.inertia[(i, j)];
                }
            }
        }
    }

    fn smooth_derivative_of_hand(&mut self, model: &Model) {
        let dt = self.dt;
        for (i, coordinate) in model.tree.coordinates.iter().enumerate() {
            let block = model.blocks[i].clone();
            self.derivative.row_mut(i)[block.clone()].copy_from_slice(&self.hand.mass.row(i)[block]);
            self.derivative.row_mut(i)[i] += dt * stop(coordinate, self.hand.q[i], self.v[i], dt).1;
        }
        for (state, cable) in self.hand.cables.iter().zip(&model.tree.cables) {
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
    }
}

/// Computes the impulses of a patch's points. Returns their sum on body b, and its moment about the reference point, if any point presses.
#[inline(always)]
fn contact_impulses(points: &mut [Point], twist: &Twist, bounds: Bounds, stick: f64) -> Option<Twist> {
    match bounds {
        Bounds::Follow => impulses(points, twist, stick, |point| point.friction * point.impulse),
        Bounds::Halfway => impulses(points, twist, stick, |point| 0.5 * (point.bound + point.friction * point.impulse)),
        Bounds::Frozen => impulses(points, twist, stick, |point| point.bound),
    }
}

/// The same, with the friction bound of a point from its normal impulse.
#[inline(always)]
fn impulses(points: &mut [Point], twist: &Twist, stick: f64, bound: impl Fn(&Point) -> f64) -> Option<Twist> {
    let mut sum = Twist::default();
    let mut any = false;
    for point in points {
        let normal_speed = point.normal.dot(&twist.linear) + point.moment.dot(&twist.angular);
        point.normal_speed = normal_speed;
        point.impulse = ((point.target - normal_speed) * point.stiffness).max(0.0);
        point.bound = bound(point);
        if point.impulse <= 0.0 && point.bound <= 0.0 {
            continue;
        }
        point.slip = twist.at(&point.arm) - point.normal * normal_speed;
        point.slip_speed = point.slip.norm();
        let force = point.normal * point.impulse + point.friction_impulse(stick);
        sum.linear += force;
        sum.angular += point.arm.cross(&force);
        any = true;
    }
    any.then_some(sum)
}

#[cfg(test)]
mod tests;
