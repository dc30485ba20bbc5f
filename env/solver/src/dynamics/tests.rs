//! Kinematics and dynamics of random trees against numerical derivatives: revolute, prismatic, mimic and driven joints.

use super::*;
use crate::kinematics::Twist;
use crate::problem::matrix::Factors;
use crate::tree::{Body, Coordinate, Joint, Tree};
use nalgebra::{Isometry3, Point3, Rotation3, Translation3, Unit, UnitQuaternion};

const GRAVITY: f64 = 9.81;
/// Step of the numerical derivatives.
const H: f64 = 1e-4;
const FREE: usize = 4;
const DRIVEN: usize = 1;

/// Numbers in [-1, 1) from a small generator.
struct Numbers(u64);

impl Numbers {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.next(), self.next(), self.next())
    }

    fn pose(&mut self) -> Isometry3<f64> {
        Isometry3::from_parts(Translation3::from(self.vector() * 0.1), UnitQuaternion::from_scaled_axis(self.vector()))
    }
}

/// Seven bodies on a base: two branches, one of which forks; one coordinate moves two joints, one is driven.
fn model(next: &mut Numbers) -> Model {
    let mut bodies = vec![Body {
        parent: 0,
        joint: None,
        mass: 1.0,
        center: Point3::origin(),
        inertia: Matrix3::identity(),
        shapes: Vec::new(),
    }];
    let (turn, shift) = (JointKind::Revolute, JointKind::Prismatic);
    // Parent, kind, coordinate (4 is driven), ratio.
    let joints = [
        (0, turn, 4, 1.0),
        (1, turn, 0, 1.0),
        (2, shift, 1, 1.0),
        (2, turn, 2, 1.0),
        (4, turn, 2, -0.7),
        (0, shift, 3, 0.5),
        (6, turn, 4, -1.0),
    ];
    for (parent, kind, coordinate, ratio) in joints {
        let turned = Rotation3::from_scaled_axis(next.vector());
        let diagonal = next.vector().map(|x| 1e-4 * (1.5 + 0.5 * x));
        let joint = Joint {
            kind,
            parent_from_joint: next.pose(),
            axis: Unit::new_normalize(next.vector()),
            coordinate,
            ratio,
            offset: 0.1 * next.next(),
        };
        bodies.push(Body {
            parent,
            joint: Some(joint),
            mass: 0.1 * (1.5 + next.next()),
            center: Point3::from(next.vector() * 0.03),
            inertia: turned.matrix() * Matrix3::from_diagonal(&diagonal) * turned.matrix().transpose(),
            shapes: Vec::new(),
        });
    }
    Model::of_tree(Tree { bodies, coordinates: vec![Coordinate::FREE; FREE], driven: DRIVEN, ..Tree::default() })
}

fn placed(model: &Model, q: &[f64]) -> Kinematics {
    let mut kinematics = Kinematics::default();
    kinematics.place(model, q);
    kinematics
}

/// Moves coordinates by `h` times their rates.
fn moved(q: &[f64], rates: &[f64], h: f64) -> Vec<f64> {
    q.iter().zip(rates).map(|(q, v)| q + h * v).collect()
}

fn numbers(next: &mut Numbers) -> Vec<f64> {
    (0..FREE + DRIVEN).map(|_| next.next()).collect()
}

/// A bug here: a wrong axis, a forgotten ratio, a column of a body that is not an ancestor.
#[test]
fn twists_are_the_derivatives_of_poses() {
    let mut next = Numbers(1);
    for _ in 0..20 {
        let model = model(&mut next);
        let (q, rates, reference) = (numbers(&mut next), numbers(&mut next), next.vector());
        let mut kinematics = placed(&model, &q);
        kinematics.differentiate(&model, &reference, &rates[FREE..]);
        let (before, after) = (placed(&model, &moved(&q, &rates, -H)), placed(&model, &moved(&q, &rates, H)));
        for body in 0..model.tree.bodies.len() {
            let Twist { angular, linear } = kinematics.twist(&model, body, &rates);
            let change = after.pose[body] * before.pose[body].inverse();
            let turned = change.rotation.scaled_axis() / (2.0 * H);
            let own = kinematics.pose[body].inverse_transform_point(&Point3::from(reference));
            let shifted = (after.pose[body] * own - before.pose[body] * own) / (2.0 * H);
            assert!((angular - turned).norm() < 1e-6, "body {body}: {angular} {turned}");
            assert!((linear - shifted).norm() < 1e-6, "body {body}: {linear} {shifted}");
        }
    }
}

/// Kinetic energy from the velocities of all bodies, and potential energy.
fn energies(model: &Model, q: &[f64], rates: &[f64]) -> (f64, f64) {
    let mut kinematics = placed(model, q);
    kinematics.differentiate(model, &Vector3::zeros(), &rates[FREE..]);
    let (mut kinetic, mut potential) = (0.0, 0.0);
    for (index, body) in model.tree.bodies.iter().enumerate().skip(1) {
        let twist = kinematics.twist(model, index, rates);
        let center = (kinematics.pose[index] * body.center).coords;
        let turn = &kinematics.turn[index];
        let inertia = turn * body.inertia * turn.transpose();
        kinetic += 0.5 * (body.mass * twist.at(&center).norm_squared() + twist.angular.dot(&(inertia * twist.angular)));
        potential += body.mass * GRAVITY * center.z;
    }
    (kinetic, potential)
}

fn dynamics(model: &Model, q: &[f64], rates: &[f64], accelerations: &[f64]) -> (Matrix, Vec<f64>) {
    let frame =
        FrameMotion { gravity: Vector3::new(0.0, 0.0, -GRAVITY), omega: Vector3::zeros(), alpha: Vector3::zeros() };
    let (mut dynamics, mut mass) = (Dynamics::default(), Matrix::new(FREE));
    let kinematics = &placed(model, q);
    let motion = TreeMotion { model, kinematics, frame: &frame, velocity: rates, acceleration: accelerations };
    dynamics.update(motion, &mut mass);
    (mass, dynamics.bias)
}

/// A bug here: an inertia about the wrong point, a lost product of inertia.
#[test]
fn the_mass_matrix_gives_the_kinetic_energy() {
    let mut next = Numbers(2);
    for _ in 0..20 {
        let model = model(&mut next);
        let (q, mut rates) = (numbers(&mut next), numbers(&mut next));
        rates[FREE..].fill(0.0);
        let (mass, _) = dynamics(&model, &q, &rates, &[0.0; FREE + DRIVEN]);
        let by_matrix: f64 =
            (0..FREE).map(|i| 0.5 * rates[i] * (0..FREE).map(|j| mass.row(i)[j] * rates[j]).sum::<f64>()).sum();
        let (kinetic, _) = energies(&model, &q, &rates);
        assert!((by_matrix - kinetic).abs() < 1e-12 * kinetic.max(1.0), "{by_matrix} {kinetic}");
    }
}

/// Lagrange's equations, `d/dt dT/dv - dT/dq + dV/dq = 0`, by numerical derivatives, with a driven joint that moves and accelerates.
/// A bug here: a lost Coriolis term, a driven acceleration without effect.
#[test]
fn bias_forces_are_those_of_lagrange() {
    let mut next = Numbers(3);
    for _ in 0..20 {
        let model = model(&mut next);
        let (q, rates, mut accelerations) = (numbers(&mut next), numbers(&mut next), numbers(&mut next));
        let (mut mass, bias) = dynamics(&model, &q, &rates, &accelerations);
        let mut solved = bias;
        let mut factors = Factors::new(solved.len());
        assert!(mass.factor(&mut factors) && factors.solve(&mut solved));
        accelerations[..FREE].copy_from_slice(&solved);
        for i in 0..FREE {
            // The momentum of coordinate i along the motion.
            let momentum = |h: f64| {
                let q = moved(&moved(&q, &rates, h), &accelerations, 0.5 * h * h);
                let rates = moved(&rates, &accelerations, h);
                let by = |d: f64| {
                    let mut rates = rates.clone();
                    rates[i] += d;
                    energies(&model, &q, &rates).0
                };
                (by(1e-4) - by(-1e-4)) / 2e-4
            };
            let by_position = |d: f64| {
                let mut q = q.clone();
                q[i] += d;
                let (kinetic, potential) = energies(&model, &q, &rates);
                kinetic - potential
            };
            let change = (momentum(1e-4) - momentum(-1e-4)) / 2e-4;
            let force = (by_position(1e-4) - by_position(-1e-4)) / 2e-4;
            assert!((change - force).abs() < 1e-5 * force.abs().max(0.1), "coordinate {i}: {change} {force}");
        }
    }
}
