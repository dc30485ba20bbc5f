//! Mass matrix and bias forces of the hand's tree, in the frame of the base: the composite-rigid-body algorithm and the recursive Newton-Euler
//! algorithm (Featherstone, "Rigid Body Dynamics Algorithms", 2008, chapters 5 and 6).

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};

use crate::kinematics::Kinematics;
use crate::model::Model;
use crate::problem::matrix::Matrix;
use crate::tree::JointKind;

/// Motion of the base's frame; axes of the base.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct FrameMotion {
    /// Gravity less the acceleration of the base's origin, m/s2.
    pub gravity: Vector3<f64>,
    /// Angular velocity, rad/s.
    pub omega: Vector3<f64>,
    /// Angular acceleration, rad/s2.
    pub alpha: Vector3<f64>,
}

/// Mass, first moment of mass and inertia of a subtree, about the base's origin.
#[derive(Clone, Copy)]
struct Composite {
    mass: f64,
    moment: Vector3<f64>,
    inertia: Matrix3<f64>,
}

/// Velocity and acceleration of a body's frame, with the accelerations of the free coordinates taken as 0.
#[derive(Clone, Copy)]
struct Acceleration {
    omega: Vector3<f64>,
    alpha: Vector3<f64>,
    /// Of the body's origin.
    linear: Vector3<f64>,
}

/// Force and its moment about the base's origin.
#[derive(Clone, Copy)]
struct Wrench {
    force: Vector3<f64>,
    moment: Vector3<f64>,
}

impl Acceleration {
    /// Acceleration of a child whose origin is at `arm` from this body's, on a joint that moves at `rate` with the prescribed acceleration
    /// `driven`.
    fn of_child(&self, kind: JointKind, arm: &Vector3<f64>, rate: &Vector3<f64>, driven: &Vector3<f64>) -> Self {
        let linear = self.linear + self.alpha.cross(arm) + self.omega.cross(&self.omega.cross(arm));
        match kind {
            JointKind::Revolute => {
                Self { omega: self.omega + rate, alpha: self.alpha + self.omega.cross(rate) + driven, linear }
            }
            JointKind::Prismatic => Self { linear: linear + 2.0 * self.omega.cross(rate) + driven, ..*self },
        }
    }

    /// Wrench that causes this motion of a body whose centre of mass is at `arm` from its own origin and at `center` from the base's.
    fn wrench(&self, mass: f64, inertia: &Matrix3<f64>, arm: &Vector3<f64>, center: &Vector3<f64>) -> Wrench {
        let force = mass * (self.linear + self.alpha.cross(arm) + self.omega.cross(&self.omega.cross(arm)));
        let couple = inertia * self.alpha + self.omega.cross(&(inertia * self.omega));
        Wrench { force, moment: couple + center.cross(&force) }
    }
}

/// Inputs of [`Dynamics::update`]. `velocity` and `acceleration` have one entry per coordinate, the driven ones last; accelerations of the
/// free ones are not read.
#[derive(Clone, Copy)]
pub(crate) struct TreeMotion<'a> {
    pub model: &'a Model,
    pub kinematics: &'a Kinematics,
    pub frame: &'a FrameMotion,
    pub velocity: &'a [f64],
    pub acceleration: &'a [f64],
}

/// Buffers of one world.
#[derive(Clone, Default)]
pub(crate) struct Dynamics {
    composites: Vec<Composite>,
    accelerations: Vec<Acceleration>,
    wrenches: Vec<Wrench>,
    /// Generalized force of gravity, Coriolis and centrifugal effects on each free coordinate, N m (N).
    pub bias: Vec<f64>,
}

impl Dynamics {
    /// Writes the mass matrix (with armature) of the free coordinates to `mass` and their bias forces to `bias`.
    pub fn update(&mut self, motion: TreeMotion, mass: &mut Matrix) {
        self.outwards(motion);
        self.inwards(motion.model, motion.kinematics, mass);
    }

    /// Velocities, accelerations and wrenches, from the base to the tips.
    fn outwards(&mut self, TreeMotion { model, kinematics, frame, velocity, acceleration }: TreeMotion) {
        self.composites.clear();
        self.accelerations.clear();
        self.wrenches.clear();
        let free = model.tree.coordinates.len();
        for (index, body) in model.tree.bodies.iter().enumerate().take(kinematics.pose.len()) {
            let Some(joint) = &body.joint else {
                self.accelerations.push(Acceleration {
                    omega: frame.omega,
                    alpha: frame.alpha,
                    linear: -frame.gravity,
                });
                self.composites.push(Composite { mass: 0.0, moment: Vector3::zeros(), inertia: Matrix3::zeros() });
                self.wrenches.push(Wrench { force: Vector3::zeros(), moment: Vector3::zeros() });
                continue;
            };
            let above = self.accelerations[body.parent];
            let at = kinematics.pose[index].translation.vector;
            let arm = at - kinematics.pose[body.parent].translation.vector;
            let rate = kinematics.axis[index] * (joint.ratio * velocity[joint.coordinate]);
            let driven = if joint.coordinate < free { 0.0 } else { acceleration[joint.coordinate] };
            let driven = kinematics.axis[index] * (joint.ratio * driven);
            let own = above.of_child(joint.kind, &arm, &rate, &driven);
            self.accelerations.push(own);
            if model.columns[index].is_empty() {
                // Only driven joints move this body: it loads no free coordinate.
                self.wrenches.push(Wrench { force: Vector3::zeros(), moment: Vector3::zeros() });
                self.composites.push(Composite { mass: 0.0, moment: Vector3::zeros(), inertia: Matrix3::zeros() });
                continue;
            }
            let turn = &kinematics.turn[index];
            let inertia = turn * body.inertia * turn.transpose();
            let arm = turn * body.center.coords;
            let center = at + arm;
            self.wrenches.push(own.wrench(body.mass, &inertia, &arm, &center));
            self.composites.push(Composite {
                mass: body.mass,
                moment: body.mass * center,
                inertia: inertia + steiner(body.mass, &center),
            });
        }
    }

    /// Sums wrenches and composites from the tips to the base, and projects them on the joints.
    fn inwards(&mut self, model: &Model, kinematics: &Kinematics, mass: &mut Matrix) {
        let free = model.tree.coordinates.len();
        self.bias.clear();
        self.bias.resize(free, 0.0);
        for (i, coordinate) in model.tree.coordinates.iter().enumerate() {
            mass.row_mut(i)[..free].fill(0.0);
            mass.row_mut(i)[i] = coordinate.armature;
        }
        for index in (1..kinematics.pose.len()).rev() {
            let body = &model.tree.bodies[index];
            let Some(joint) = &body.joint else { continue };
            let (wrench, composite) = (self.wrenches[index], self.composites[index]);
            if model.columns[index].is_empty() {
                continue;
            }
            if joint.coordinate < free {
                let (angular, linear) = axis_at_origin(kinematics, index, joint.kind);
                self.bias[joint.coordinate] -= joint.ratio * (angular.dot(&wrench.moment) + linear.dot(&wrench.force));
                // Momentum of the subtree per unit rate of this joint.
                let push = composite.mass * linear + angular.cross(&composite.moment);
                let spin = composite.inertia * angular + composite.moment.cross(&linear);
                let mut other = index;
                while let Some(joint_above) = &model.tree.bodies[other].joint {
                    if joint_above.coordinate < free {
                        let (a, l) = axis_at_origin(kinematics, other, joint_above.kind);
                        let value = joint.ratio * joint_above.ratio * (a.dot(&spin) + l.dot(&push));
                        mass.row_mut(joint.coordinate)[joint_above.coordinate] += value;
                        if other != index {
                            mass.row_mut(joint_above.coordinate)[joint.coordinate] += value;
                        }
                    }
                    other = model.tree.bodies[other].parent;
                }
            }
            let below = &mut self.wrenches[body.parent];
            below.force += wrench.force;
            below.moment += wrench.moment;
            let below = &mut self.composites[body.parent];
            below.mass += composite.mass;
            below.moment += composite.moment;
            below.inertia += composite.inertia;
        }
    }
}

/// Angular velocity, and velocity of the point at the base's origin, per unit rate of a joint.
fn axis_at_origin(kinematics: &Kinematics, body: usize, kind: JointKind) -> (Vector3<f64>, Vector3<f64>) {
    let axis = kinematics.axis[body];
    match kind {
        JointKind::Revolute => (axis, kinematics.origin[body].cross(&axis)),
        JointKind::Prismatic => (Vector3::zeros(), axis),
    }
}

/// Inertia of a point mass about the origin (the parallel axis theorem).
fn steiner(mass: f64, at: &Vector3<f64>) -> Matrix3<f64> {
    mass * (Matrix3::identity() * at.norm_squared() - at * at.transpose())
}

#[cfg(test)]
mod tests;
