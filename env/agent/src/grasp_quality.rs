//! How well the present contacts hold the object: a sampled epsilon quality.
//!
//! Ferrari and Canny ("Planning optimal grasps", 1992): the least wrench, over all directions, that the contacts can resist. Here each
//! finger (and the palm) presses with one unit of normal force in all, friction cones are exact, and the least is taken over a
//! fixed set of directions, which makes it an upper bound.

use graspbox_hand::Hand;
use graspbox_sim::HandContact;
use nalgebra::{Point3, Vector3};

/// Torques are divided by this length to be compared with forces, metres: half the size of what a hand holds.
const LENGTH: f64 = 0.05;

/// The least support over the sampled directions, in [0, 1]: 0 without force closure.
///
/// * `contacts`: as [`graspbox_sim::World::hand_contacts`] gives them; only those with the object count.
/// * `center`: centre of mass of the object, hand frame.
pub fn epsilon(hand: &Hand, contacts: &[HandContact], center: &Point3<f64>) -> f64 {
    let mut grips: Vec<Vec<Grip>> = vec![Vec::new(); hand.fingers.len() + 1];
    for contact in contacts.iter().filter(|c| c.with_object) {
        let finger = hand.finger_of_link(contact.link).unwrap_or(hand.fingers.len());
        grips[finger].push(Grip {
            inward: -contact.normal,
            arm: (contact.point - center) / LENGTH,
            friction: contact.friction,
        });
    }
    if grips.iter().filter(|g| !g.is_empty()).count() < 2 {
        return 0.0;
    }
    let support = |force: &Vector3<f64>, torque: &Vector3<f64>| -> f64 {
        let best = |finger: &Vec<Grip>| finger.iter().map(|g| g.support(force, torque)).fold(0.0, f64::max);
        grips.iter().map(best).sum()
    };
    let none = Vector3::zeros();
    let mut least = f64::INFINITY;
    for i in 0..3 {
        let axis = Vector3::ith(i, 1.0);
        for axis in [axis, -axis] {
            least = least.min(support(&axis, &none)).min(support(&none, &axis));
            for j in 0..3 {
                let (force, torque) =
                    (axis * std::f64::consts::FRAC_1_SQRT_2, Vector3::ith(j, std::f64::consts::FRAC_1_SQRT_2));
                least = least.min(support(&force, &torque)).min(support(&force, &-torque));
            }
        }
    }
    least.min(1.0)
}

#[derive(Clone, Copy)]
struct Grip {
    /// Into the object.
    inward: Vector3<f64>,
    /// From the centre of mass, in units of [`LENGTH`].
    arm: Vector3<f64>,
    friction: f64,
}

impl Grip {
    /// The greatest component along (`force`, `torque`) of a wrench with at most one unit of normal force.
    fn support(&self, force: &Vector3<f64>, torque: &Vector3<f64>) -> f64 {
        // (arm x f) . torque = f . (torque x arm), so one vector tells how much each force component helps.
        let helps = force + torque.cross(&self.arm);
        let normal = helps.dot(&self.inward);
        let tangent = (helps - self.inward * normal).norm();
        (normal + self.friction * tangent).max(0.0)
    }
}
