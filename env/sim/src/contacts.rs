//! Contacts of the object and of the hand's links, and the forces on the tactile sensors.

use crate::engine::{Contact, Part};
use crate::world::World;
use nalgebra::{Point3, Vector3};
use std::cell::Cell;

/// Bodies touch if a contact presses, or if they are nearer than this, metres: half of `allowed_penetration` in
/// [`crate::config::RapierConfig`].
const TOUCH: f64 = 2.5e-4;

/// Summary of the contacts of the target object.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Contacts {
    /// The object touches the table, the ground or a wall.
    pub scenery: bool,
    /// Indices of the links that touch the object, ascending, without duplicates.
    pub links: Vec<usize>,
    /// Indices of the other objects that touch the object, ascending, without duplicates.
    pub objects: Vec<usize>,
    /// Deepest penetration between hand and object, metres.
    pub hand_depth: f64,
    /// Deepest penetration between scenery and object, metres.
    pub scenery_depth: f64,
    /// Sum of the normal forces between hand and object, N.
    pub hand_force: f64,
}

/// Forces on the tactile sensors, in the order of the hand's sensors.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tactile {
    /// Force per sensor, N.
    pub force: Vec<f64>,
}

/// A contact point that presses on a link of the hand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkContact {
    pub link: usize,
    /// Position in the link's frame, metres.
    pub point: Point3<f64>,
    /// Unit normal in the link's frame, into the link: the direction of the force on it.
    pub normal: Vector3<f64>,
    /// Normal force, N.
    pub force: f64,
}

impl World {
    /// The contacts of the target object at present.
    pub fn contacts(&self) -> Contacts {
        let mut found = Contacts::default();
        let target = self.target();
        self.engine().contacts(&|parts| parts.contains(&Part::Object(target)), &mut |contact| {
            let depth = (-contact.distance).max(0.0);
            for side in &contact.sides {
                match side.part {
                    Part::Table | Part::Ground | Part::Wall => {
                        found.scenery |= touches(contact);
                        found.scenery_depth = found.scenery_depth.max(depth);
                    }
                    Part::Link { link, .. } => {
                        found.hand_depth = found.hand_depth.max(depth);
                        found.hand_force += contact.force;
                        if touches(contact) {
                            found.links.push(link);
                        }
                    }
                    Part::Object(other) if other != target && touches(contact) => found.objects.push(other),
                    Part::Object(_) | Part::Arm(_) => {}
                }
            }
        });
        for indices in [&mut found.links, &mut found.objects] {
            indices.sort_unstable();
            indices.dedup();
        }
        found
    }

    /// True if the target object touches table, ground or a wall: `scenery` of [`World::contacts`], at less cost.
    pub fn object_on_scenery(&self) -> bool {
        let found = Cell::new(false);
        let target = Part::Object(self.target());
        // No further contact is wanted once one touches.
        let wanted =
            |parts: [Part; 2]| !found.get() && parts.contains(&target) && parts.into_iter().any(Part::is_scenery);
        self.engine().contacts(&wanted, &mut |contact| found.set(touches(contact)));
        found.get()
    }

    /// For each object, true if table, ground or walls carry it: it touches them, or another object that they carry.
    pub fn carried_by_scenery(&self) -> Vec<bool> {
        if self.object_count() == 1 {
            return vec![self.object_on_scenery()];
        }
        let (mut carried, mut touching) = (vec![false; self.object_count()], Vec::new());
        self.engine().contacts(&|parts| parts.into_iter().any(Part::is_object), &mut |contact| match [
            contact.sides[0].part,
            contact.sides[1].part,
        ] {
            _ if !touches(contact) => {}
            [Part::Object(one), Part::Object(other)] => touching.push([one, other]),
            [Part::Object(object), other] | [other, Part::Object(object)] => carried[object] |= other.is_scenery(),
            _ => {}
        });
        // Each pass carries one object more, or is the last.
        while let Some(next) = touching.iter().find(|[one, other]| carried[*one] != carried[*other]) {
            let [one, other] = *next;
            carried[one] = true;
            carried[other] = true;
        }
        carried
    }

    /// The object on which the hand presses most, by its index; `None` if it presses on none.
    pub fn most_pressed(&self) -> Option<usize> {
        let mut forces = vec![0.0; self.object_count()];
        self.engine().contacts(&|parts| parts.into_iter().any(Part::is_link), &mut |contact| {
            for side in &contact.sides {
                if let Part::Object(object) = side.part {
                    forces[object] += contact.force;
                }
            }
        });
        let pressed = forces.into_iter().enumerate().filter(|(_, force)| *force > 0.0);
        pressed.max_by(|(_, a), (_, b)| a.total_cmp(b)).map(|(object, _)| object)
    }

    /// Forces on the tactile sensors.
    ///
    /// The force of a contact is shared among the sensors of its link by distance and direction; sensors beyond `REACH`, or facing away, get none.
    pub fn tactile(&self) -> Tactile {
        let hand = self.hand();
        let mut force = vec![0.0; hand.sensors.len()];
        for contact in self.link_contacts() {
            let weight = |i: usize| {
                let sensor = &hand.sensors[i];
                let facing = -sensor.normal.dot(&contact.normal);
                let distance = (sensor.position - contact.point).norm();
                if sensor.link == contact.link && facing > 0.0 {
                    facing * (1.0 - distance / REACH).max(0.0)
                } else {
                    0.0
                }
            };
            let total: f64 = (0..force.len()).map(weight).sum();
            if total > 0.0 {
                for (i, f) in force.iter_mut().enumerate() {
                    *f += contact.force * weight(i) / total.max(1.0);
                }
            }
        }
        Tactile { force }
    }

    /// Contact points that press on the hand's links, in the links' frames.
    pub fn link_contacts(&self) -> Vec<LinkContact> {
        let mut found = Vec::new();
        self.engine().contacts(&|parts| parts.into_iter().any(Part::is_link), &mut |contact| {
            for side in &contact.sides {
                if let Part::Link { link, .. } = side.part
                    && contact.force > 0.0
                {
                    found.push(LinkContact { link, point: side.point, normal: side.normal, force: contact.force });
                }
            }
        });
        found
    }
}

fn touches(contact: &Contact) -> bool {
    contact.force > 0.0 || contact.distance < TOUCH
}

/// Reach of a tactile sensor, metres: the spacing of the sensors on a link.
const REACH: f64 = 0.008;
