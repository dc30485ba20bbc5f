//! What presses on the hand: contact points, and their sum.

use crate::build::Part;
use crate::contacts::pressed;
use crate::frames;
use crate::world::World;
use nalgebra::{Point3, Vector3};
use rapier3d::math::Vector;

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
        let (physics, dt) = (self.physics(), self.dt() as f32);
        let hand_from_base = self.hand().base_from_hand.inverse();
        for pair in physics.narrow_phase.contact_pairs() {
            if !pair.has_any_active_contact() {
                continue;
            }
            let parts = [self.part(pair.collider1), self.part(pair.collider2)];
            let (first, link, other) = match parts {
                [Part::Link { .. }, Part::Link { .. }] => continue,
                [Part::Link { link, .. }, other] => (true, link, other),
                [other, Part::Link { link, .. }] => (false, link, other),
                _ => continue,
            };
            // The engine's world is the base's frame; a link's shapes are simple, so points are in the shape's own frame.
            let collider = &physics.colliders[if first { pair.collider1 } else { pair.collider2 }];
            let place = collider.position();
            let friction = f64::from(physics.colliders[pair.collider1].friction())
                * f64::from(physics.colliders[pair.collider2].friction());
            for (manifold, point) in pressed(pair) {
                let (local, normal): (Vector, Vector) =
                    if first { (point.local_p1, -manifold.local_n1) } else { (point.local_p2, -manifold.local_n2) };
                visit(HandContact {
                    link,
                    with_object: other == Part::Object,
                    point: hand_from_base * Point3::from(frames::metres64(*place * local)),
                    normal: hand_from_base * frames::vector64(place.rotation * normal),
                    force: frames::metres(point.data.impulse / dt),
                    friction,
                });
            }
        }
    }
}
