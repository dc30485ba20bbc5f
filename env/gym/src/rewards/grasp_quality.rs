//! Grasp quality of the present contacts: the epsilon of `graspbox_plan::wrench`, in [0, 1].

use graspbox_hand::Hand;
use graspbox_plan::{Directions, WrenchSpace};
use graspbox_sim::HandContact;
use nalgebra::Point3;

/// Least support over the axes' directions, in [0, 1]: 0 without force closure. Each chain of the hand presses with one unit of normal force;
/// the palm counts as a chain.
///
/// * `contacts`: of the hand with the object, from [`graspbox_sim::World::hand_contacts`].
/// * `center`: centre of mass of the object, hand frame.
pub fn epsilon(hand: &Hand, contacts: &[HandContact], center: &Point3<f64>) -> f64 {
    let palm = hand.chain_count();
    let mut space = WrenchSpace::new(palm + 1);
    for contact in contacts {
        let chain = hand.chain_of_link(contact.link).unwrap_or(palm);
        space.press(chain, &(contact.point - center), -contact.normal, contact.friction);
    }
    space.epsilon(Directions::Axes).min(1.0)
}
