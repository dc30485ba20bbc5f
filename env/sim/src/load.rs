//! Contact forces of objects and scenery on the hand, and their sum.

use crate::engine::Part;
use crate::world::World;
use nalgebra::{Point3, Vector3};

/// A contact point of an object, table or ground that presses on the hand; hand frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandContact {
    pub link: usize,
    /// Index of the collider within the link.
    pub shape: usize,
    /// Index of the object that presses; `None` for table, ground and walls.
    pub object: Option<usize>,
    /// Position, metres.
    pub point: Point3<f64>,
    /// Unit normal into the link: the direction of the force on it.
    pub normal: Vector3<f64>,
    /// Normal force, N.
    pub force: f64,
    /// Friction on the link, N.
    pub friction_force: Vector3<f64>,
    /// Coefficient of friction of the pair.
    pub friction: f64,
}

/// The sum of the normal forces of object and scenery on the hand; hand frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct HandLoad {
    /// Net force, N.
    pub force: Vector3<f64>,
    /// Mean of the contact points weighted by force, metres; the origin if there are none.
    pub at: Point3<f64>,
    /// True if an object presses.
    pub object: bool,
    /// True if table, ground or a wall presses.
    pub scenery: bool,
}

impl World {
    /// Contact points of object and scenery that press on the hand.
    pub fn hand_contacts(&self) -> Vec<HandContact> {
        let mut found = Vec::new();
        self.each_press(|contact| found.push(contact));
        found
    }

    /// Sum of the contact forces of object and scenery on the hand.
    pub fn hand_load(&self) -> HandLoad {
        let (mut force, mut at, mut total) = (Vector3::zeros(), Vector3::zeros(), 0.0);
        let (mut object, mut scenery) = (false, false);
        self.each_press(|contact| {
            force += contact.normal * contact.force;
            at += contact.point.coords * contact.force;
            total += contact.force;
            object |= contact.object.is_some();
            scenery |= contact.object.is_none();
        });
        let at = if total > 0.0 { at / total } else { at };
        HandLoad { force, at: Point3::from(at), object, scenery }
    }

    fn each_press(&self, mut visit: impl FnMut(HandContact)) {
        let hand_from_base = self.hand().base_from_hand.inverse();
        // Contacts between links are internal to the hand.
        let wanted = |[first, second]: [Part; 2]| first.is_link() != second.is_link();
        self.engine().contacts(&wanted, &mut |contact| {
            if contact.force <= 0.0 {
                return;
            }
            let (link, shape, other, sign) = match contact.sides.map(|side| side.part) {
                [Part::Link { link, shape }, other] => (link, shape, other, -1.0),
                [other, Part::Link { link, shape }] => (link, shape, other, 1.0),
                _ => return,
            };
            visit(HandContact {
                link,
                shape,
                object: if let Part::Object(object) = other { Some(object) } else { None },
                point: hand_from_base * contact.point,
                normal: hand_from_base * (sign * contact.normal),
                force: contact.force,
                friction_force: hand_from_base * (sign * contact.friction_force),
                friction: contact.friction,
            });
        });
    }
}
