//! Who touches whom, how deep and how hard.

use crate::engine::{Contact, Part};
use crate::world::World;
use nalgebra::{Point3, Vector3};

/// Two bodies touch when a contact presses, or when they are nearer than this, metres: half the penetration that
/// [`crate::config::RapierConfig`] allows.
const TOUCH: f64 = 2.5e-4;

/// What the object touches, summed over its contacts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Contacts {
    /// The object touches the table or the ground.
    pub scenery: bool,
    /// Links of the hand that touch the object, ascending, each once.
    pub links: Vec<usize>,
    /// Deepest penetration between hand and object, metres.
    pub hand_depth: f64,
    /// Deepest penetration between scenery and object, metres.
    pub scenery_depth: f64,
    /// Sum of the normal forces between hand and object, N.
    pub hand_force: f64,
}

/// Forces on the tactile sensors in the order of the hand's sensors, N.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tactile {
    /// One force per sensor.
    pub force: Vec<f64>,
}

/// One pressing contact point between a link of the hand and something else.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LinkContact {
    /// Index of the link.
    pub link: usize,
    /// Where, in the link's frame, metres.
    pub point: Point3<f64>,
    /// Unit normal in the link's frame, pointing into the link: the direction in which the force pushes it.
    pub normal: Vector3<f64>,
    /// Normal force, N.
    pub force: f64,
}

impl World {
    /// What the object touches now.
    pub fn contacts(&self) -> Contacts {
        let mut found = Contacts::default();
        self.engine().contacts(&|parts| parts.contains(&Part::Object), &mut |contact| {
            let depth = (-contact.distance).max(0.0);
            for side in &contact.sides {
                match side.part {
                    Part::Table | Part::Ground => {
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
                    Part::Object => {}
                }
            }
        });
        found.links.sort_unstable();
        found.links.dedup();
        found
    }

    /// True when the object touches table or ground, as [`World::contacts`] says.
    pub fn object_on_scenery(&self) -> bool {
        let mut found = false;
        let wanted = |parts: [Part; 2]| parts.contains(&Part::Object) && parts.into_iter().any(Part::is_scenery);
        self.engine().contacts(&wanted, &mut |contact| found |= touches(contact));
        found
    }

    /// Forces on the tactile sensors.
    ///
    /// A contact presses the sensors of its link in proportion to their nearness: a sensor feels nothing beyond its reach.
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

    /// Contacts of the hand's links in the links' frames; normals point into the link.
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

/// Reach of a tactile sensor, metres: its spacing on the link.
const REACH: f64 = 0.008;
