//! Which forces and torques the closed fingers can take up: a grasp wrench space, sampled.

use crate::boxes::half_sphere;
use nalgebra::{Point3, Vector3, Vector6};

/// A point where a finger presses on the object.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contact {
    pub point: Point3<f64>,
    /// Into the object, unit.
    pub inward: Vector3<f64>,
    /// Coefficient of friction.
    pub friction: f64,
    pub finger: usize,
}

/// Edges of the friction pyramid.
const EDGES: usize = 6;
/// Torques are divided by this length to be compared with forces, metres: half the size of what a hand holds.
const LENGTH: f64 = 0.05;
/// Directions of disturbance beside the axes: this many forces and as many torques, each in both directions, and mixtures of them.
const DIRECTIONS: usize = 24;

/// The wrench space of one unit of normal force a finger, about a centre.
pub(crate) struct WrenchSpace {
    /// Wrenches of each finger.
    fingers: Vec<Vec<Vector6<f64>>>,
}

impl WrenchSpace {
    pub fn new(contacts: &[Contact], fingers: usize, center: &Point3<f64>) -> Self {
        let mut space = vec![Vec::new(); fingers];
        for contact in contacts {
            let n = contact.inward;
            let u = n.cross(&Vector3::ith(n.iamin(), 1.0)).normalize();
            let v = n.cross(&u);
            for k in 0..EDGES {
                let (sin, cos) = (std::f64::consts::TAU * k as f64 / EDGES as f64).sin_cos();
                let force = n + (u * cos + v * sin) * contact.friction;
                let torque = (contact.point - center).cross(&force) / LENGTH;
                space[contact.finger].push(Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z));
            }
        }
        Self { fingers: space }
    }

    /// The greatest wrench along `direction` with at most one unit of force a finger.
    pub fn support(&self, direction: &Vector6<f64>) -> f64 {
        let best = |wrenches: &Vec<Vector6<f64>>| wrenches.iter().map(|w| w.dot(direction)).fold(0.0, f64::max);
        self.fingers.iter().map(best).sum()
    }

    /// The least support over sampled directions: 0 without force closure. An upper bound of the epsilon quality (Ferrari and Canny,
    /// "Planning optimal grasps", 1992) for forces bounded finger by finger.
    pub fn epsilon(&self) -> f64 {
        let both_ways = |d: &Vector6<f64>| self.support(d).min(self.support(&-d));
        let mut least = (0..6).map(|i| both_ways(&Vector6::ith(i, 1.0))).fold(f64::INFINITY, f64::min);
        let halves = half_sphere(DIRECTIONS).zip(half_sphere(DIRECTIONS).collect::<Vec<_>>().into_iter().rev());
        for (f, t) in halves {
            let mixed = std::f64::consts::FRAC_1_SQRT_2;
            for (a, b) in [(1.0, 0.0), (0.0, 1.0), (mixed, mixed), (mixed, -mixed)] {
                let d = Vector6::new(f.x * a, f.y * a, f.z * a, t.x * b, t.y * b, t.z * b);
                least = least.min(both_ways(&d));
            }
        }
        least
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pinch(friction: f64) -> WrenchSpace {
        let contact = |x: f64, y: f64, finger| Contact {
            point: Point3::new(x, y, 0.0),
            inward: Vector3::new(-x.signum(), 0.0, 0.0),
            friction,
            finger,
        };
        // Two fingers, each with a contact line, face to face.
        let contacts =
            [contact(0.03, -0.02, 0), contact(0.03, 0.02, 0), contact(-0.03, -0.02, 1), contact(-0.03, 0.02, 1)];
        WrenchSpace::new(&contacts, 2, &Point3::origin())
    }

    #[test]
    fn friction_lifts_as_coulomb_says() {
        // Two fingers of unit force with friction 0.5 lift 1; a hexagonal cone reaches it at its corners, and 0.87 of it between them.
        let up = Vector6::new(0.0, 0.0, 1.0, 0.0, 0.0, 0.0);
        let lift = pinch(0.5).support(&up);
        assert!((0.86..=1.0 + 1e-9).contains(&lift), "{lift}");
        assert_eq!(pinch(0.0).support(&up), 0.0);
    }

    #[test]
    fn without_friction_a_pinch_closes_nothing() {
        assert_eq!(pinch(0.0).epsilon(), 0.0);
        assert!(pinch(1.0).epsilon() > 0.1);
    }

    #[test]
    fn one_sided_contacts_close_nothing() {
        let contact = Contact { point: Point3::new(0.03, 0.0, 0.0), inward: -Vector3::x(), friction: 1.0, finger: 0 };
        assert_eq!(WrenchSpace::new(&[contact], 1, &Point3::origin()).epsilon(), 0.0);
    }
}
