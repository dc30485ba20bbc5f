//! A finger as a planar double pendulum in closed form, from nothing but the hand's masses, inertias, armature and springs.
//!
//! Both joints turn about one axis. With the proximal angle `p` and the distal angle `d` the proximal link points along
//! `p`, the distal one along `p + d`; every vector below lies in the finger's plane as (along the flat finger, out of the palm).

use crate::bench::bending;
use graspbox_hand::Hand;
use nalgebra::{Matrix2, Rotation2, Vector2, Vector3};

/// Constants of one finger.
#[derive(Clone, Copy, Debug)]
pub struct TwoLink {
    /// Masses of the two links, kg.
    pub mass: [f64; 2],
    /// Centres of mass in the links' frames, metres.
    pub center: [Vector2<f64>; 2],
    /// Inertias about the centres of mass and the joints' axis, kg m2.
    pub inertia: [f64; 2],
    /// Distal joint in the proximal link's frame, metres.
    pub knuckle: Vector2<f64>,
    /// Armature of both joints, kg m2.
    pub armature: f64,
    /// Stiffness of the springs at both joints, N m/rad.
    pub spring: Vector2<f64>,
    /// Rest angles of both springs, rad.
    pub rest: Vector2<f64>,
    /// Damping of proximal and distal joint, N m s/rad.
    pub damping: [f64; 2],
}

fn planar(v: &Vector3<f64>) -> Vector2<f64> {
    Vector2::new(v.x, v.z)
}

impl TwoLink {
    /// Reads finger `index`; its joints must turn about -y of frames whose x runs along the flat finger, as the ReFlex's do.
    pub fn of(hand: &Hand, index: usize) -> Self {
        let joints = bending(hand, index).map(|j| &hand.joints[j]);
        assert_eq!(joints[0].armature, joints[1].armature);
        for joint in joints {
            assert!((joint.axis.into_inner() + Vector3::y()).norm() < 1e-12, "axis is not -y");
        }
        assert!(joints[1].parent_from_joint.rotation.angle() < 1e-12);
        let links = joints.map(|j| &hand.links[j.child]);
        Self {
            mass: links.map(|l| l.mass),
            center: links.map(|l| planar(&l.center_of_mass.coords)),
            inertia: links.map(|l| l.inertia[(1, 1)]),
            knuckle: planar(&joints[1].parent_from_joint.translation.vector),
            armature: joints[0].armature,
            spring: Vector2::from(joints.map(|joint| joint.stiffness)),
            rest: Vector2::from(joints.map(|joint| joint.spring_reference)),
            damping: joints.map(|joint| joint.damping),
        }
    }

    /// Positions of the centres of mass from the proximal joint, metres.
    pub fn centers(&self, q: Vector2<f64>) -> [Vector2<f64>; 2] {
        let (first, second) = (Rotation2::new(q.x), Rotation2::new(q.x + q.y));
        [first * self.center[0], first * self.knuckle + second * self.center[1]]
    }

    /// Mass matrix, kg m2.
    pub fn mass_matrix(&self, q: Vector2<f64>) -> Matrix2<f64> {
        let [m1, m2] = self.mass;
        let [c1, c2] = self.center;
        let across = self.knuckle.dot(&(Rotation2::new(q.y) * c2));
        let far = self.inertia[1] + m2 * c2.norm_squared();
        let near = self.inertia[0] + m1 * c1.norm_squared() + m2 * self.knuckle.norm_squared();
        let coupling = far + m2 * across;
        Matrix2::new(near + far + 2.0 * m2 * across + self.armature, coupling, coupling, far + self.armature)
    }

    /// Joint torques of gravity (m/s2, in the finger's plane), N m.
    pub fn gravity_torque(&self, q: Vector2<f64>, gravity: Vector2<f64>) -> Vector2<f64> {
        let [a, b] = self.centers(q);
        let knuckle = Rotation2::new(q.x) * self.knuckle;
        let about = |mass: f64, arm: Vector2<f64>| mass * arm.perp(&gravity);
        let distal = about(self.mass[1], b - knuckle);
        Vector2::new(about(self.mass[0], a) + about(self.mass[1], b), distal)
    }

    /// Torques of gravity and springs, N m.
    pub fn torque(&self, q: Vector2<f64>, gravity: Vector2<f64>) -> Vector2<f64> {
        self.gravity_torque(q, gravity) - self.spring.component_mul(&(q - self.rest))
    }

    /// Kinetic plus potential energy at rest point (0, 0), J.
    pub fn energy(&self, q: Vector2<f64>, speed: Vector2<f64>, gravity: Vector2<f64>) -> f64 {
        let [a, b] = self.centers(q);
        let height = -(self.mass[0] * a + self.mass[1] * b).dot(&gravity);
        let bent = q - self.rest;
        0.5 * speed.dot(&(self.mass_matrix(q) * speed)) + height + 0.5 * bent.dot(&self.spring.component_mul(&bent))
    }

    /// Stiffness matrix of small motions about `q`, N m/rad.
    pub fn stiffness(&self, q: Vector2<f64>, gravity: Vector2<f64>) -> Matrix2<f64> {
        let [a, b] = self.centers(q);
        let outer = b - Rotation2::new(q.x) * self.knuckle;
        // Turning a lever by da changes the torque m (arm x g) by -m (arm . g) da.
        let second = self.mass[1] * outer.dot(&gravity);
        let whole = self.mass[0] * a.dot(&gravity) + self.mass[1] * b.dot(&gravity);
        Matrix2::new(whole, second, second, second) + Matrix2::from_diagonal(&self.spring)
    }

    /// Where the finger hangs still, by Newton's method from `start`.
    pub fn equilibrium(&self, start: Vector2<f64>, gravity: Vector2<f64>) -> Vector2<f64> {
        let mut q = start;
        for _ in 0..50 {
            let step = self.stiffness(q, gravity).try_inverse().unwrap() * self.torque(q, gravity);
            q += step;
        }
        assert!(self.torque(q, gravity).norm() < 1e-12, "Newton did not converge");
        q
    }

    /// Undamped small oscillations about `q`: angular frequency (rad/s) and mode shape, slow one first.
    pub fn modes(&self, q: Vector2<f64>, gravity: Vector2<f64>) -> [(f64, Vector2<f64>); 2] {
        let (m, k) = (self.mass_matrix(q), self.stiffness(q, gravity));
        // det(K - w2 M) = 0 is a quadratic in w2.
        let a = m.determinant();
        let b = -(k[(0, 0)] * m[(1, 1)] + k[(1, 1)] * m[(0, 0)] - 2.0 * k[(0, 1)] * m[(0, 1)]);
        let root = (b * b - 4.0 * a * k.determinant()).sqrt();
        [(-b - root) / (2.0 * a), (-b + root) / (2.0 * a)].map(|w2| {
            let r = k - m * w2;
            (w2.sqrt(), Vector2::new(-r[(0, 1)], r[(0, 0)]).normalize())
        })
    }
}
