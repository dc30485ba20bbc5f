//! What presses on the hand: contact points, and their sum.

use crate::engine::Part;
use crate::world::World;
use nalgebra::{Point3, Vector3};

/// One point where object, table or ground presses on the hand; hand frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandContact {
    /// Index of the link.
    pub link: usize,
    /// True for the object, false for table and ground.
    pub with_object: bool,
    /// Where, metres.
    pub point: Point3<f64>,
    /// Unit normal, pointing into the link: the direction in which the force pushes it.
    pub normal: Vector3<f64>,
    /// Normal force, N.
    pub force: f64,
    /// Coefficient of friction of the pair.
    pub friction: f64,
}

/// The sum of the normal forces that object and scenery put on the hand; hand frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandLoad {
    /// Net force, N.
    pub force: Vector3<f64>,
    /// Mean of the contact points, weighted by their forces, metres; the origin without contact.
    pub at: Point3<f64>,
    /// True where the object presses.
    pub object: bool,
    /// True where table or ground press.
    pub scenery: bool,
}

impl World {
    /// Every point where something else than the hand presses on it.
    pub fn hand_contacts(&self) -> Vec<HandContact> {
        let mut found = Vec::new();
        self.each_press(|contact| found.push(contact));
        found
    }

    /// What presses on the hand, summed.
    pub fn hand_load(&self) -> HandLoad {
        let (mut force, mut at, mut total) = (Vector3::zeros(), Vector3::zeros(), 0.0);
        let (mut object, mut scenery) = (false, false);
        self.each_press(|contact| {
            force += contact.normal * contact.force;
            at += contact.point.coords * contact.force;
            total += contact.force;
            object |= contact.with_object;
            scenery |= !contact.with_object;
        });
        let at = if total > 0.0 { at / total } else { at };
        HandLoad { force, at: Point3::from(at), object, scenery }
    }

    fn each_press(&self, mut visit: impl FnMut(HandContact)) {
        let hand_from_base = self.hand().base_from_hand.inverse();
        // Links that press on each other put no load on the hand.
        let wanted = |[first, second]: [Part; 2]| first.is_link() != second.is_link();
        self.engine().contacts(&wanted, &mut |contact| {
            if contact.force <= 0.0 {
                return;
            }
            let (link, other, into_link) = match contact.sides.map(|side| side.part) {
                [Part::Link { link, .. }, other] => (link, other, -contact.normal),
                [other, Part::Link { link, .. }] => (link, other, contact.normal),
                _ => return,
            };
            visit(HandContact {
                link,
                with_object: other == Part::Object,
                point: hand_from_base * contact.point,
                normal: hand_from_base * into_link,
                force: contact.force,
                friction: contact.friction,
            });
        });
    }
}
