//! Who touches whom, how deep and how hard.

use crate::build::{Part, link_from_engine};
use crate::frames;
use crate::world::World;
use nalgebra::{Point3, Vector3};
use rapier3d::geometry::{Contact, ContactManifold, ContactPair};

/// Two bodies touch when a contact presses, or when they are nearer than this, metres: half the penetration that the solver
/// leaves alone.
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
        let dt = self.dt() as f32;
        for (other, pair) in self.pairs_of_object() {
            let (least, impulse) = nearness(pair);
            let touches = touches((least, impulse));
            let depth = frames::metres(-least).max(0.0);
            match other {
                Part::Table | Part::Ground => {
                    found.scenery |= touches;
                    found.scenery_depth = found.scenery_depth.max(depth);
                }
                Part::Link { link, .. } => {
                    found.hand_depth = found.hand_depth.max(depth);
                    found.hand_force += frames::metres(impulse / dt);
                    if touches {
                        found.links.push(link);
                    }
                }
                Part::Object => {}
            }
        }
        found.links.sort_unstable();
        found.links.dedup();
        found
    }

    /// True when the object touches table or ground, as [`World::contacts`] says.
    pub fn object_on_scenery(&self) -> bool {
        let mut pairs = self.pairs_of_object();
        pairs.any(|(other, pair)| matches!(other, Part::Table | Part::Ground) && touches(nearness(pair)))
    }

    /// Pairs of the object with what is near it.
    fn pairs_of_object(&self) -> impl Iterator<Item = (Part, &ContactPair)> {
        let object = self.handles().object_collider;
        let pairs = self.physics().narrow_phase.contact_pairs_with(object);
        pairs.map(move |pair| {
            let first = pair.collider1 == object;
            (self.part(if first { pair.collider2 } else { pair.collider1 }), pair)
        })
    }

    /// True where a part of the hand is in contact, or so near to one that the solver looks out for it.
    pub(crate) fn hand_in_contact(&self) -> bool {
        let of_hand = |collider| matches!(self.part(collider), Part::Link { .. });
        let mut pairs = self.physics().narrow_phase.contact_pairs();
        pairs.any(|p| p.has_any_active_contact() && (of_hand(p.collider1) || of_hand(p.collider2)))
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
        let physics = self.physics();
        let dt = self.dt() as f32;
        for pair in physics.narrow_phase.contact_pairs() {
            for (collider, first) in [(pair.collider1, true), (pair.collider2, false)] {
                let Part::Link { link, shape } = self.part(collider) else {
                    continue;
                };
                let pose = link_from_engine(&self.hand().links[link].colliders[shape]);
                for (manifold, p) in pressed(pair) {
                    let (local, normal) =
                        if first { (p.local_p1, -manifold.local_n1) } else { (p.local_p2, -manifold.local_n2) };
                    found.push(LinkContact {
                        link,
                        point: pose * Point3::from(frames::metres64(local)),
                        normal: pose * frames::vector64(normal),
                        force: frames::metres(p.data.impulse / dt),
                    });
                }
            }
        }
        found
    }
}

/// Least distance of a pair's contact points (engine units), and the sum of the impulses on them.
fn nearness(pair: &ContactPair) -> (f32, f32) {
    let points = pair.manifolds().iter().flat_map(|m| &m.points);
    let least = points.fold(f32::MAX, |least, point| least.min(point.dist));
    (least, pressed(pair).fold(0.0, |sum, (_, point)| sum + point.data.impulse))
}

/// Whether a pair with these values of [`nearness`] touches.
fn touches((least, impulse): (f32, f32)) -> bool {
    impulse > 0.0 || frames::metres(least) < TOUCH
}

/// Contact points of a pair that pressed in the last step, with their manifolds.
///
/// Against an object of several parts the engine solves merged manifolds: the impulses are on those. Of a manifold's points it
/// solves four at most; the others keep the impulse of the step in which they were last chosen, so only those that it
/// chose count.
pub(crate) fn pressed(pair: &ContactPair) -> impl Iterator<Item = (&ContactManifold, &Contact)> {
    let manifolds = pair.solver_manifolds().iter();
    let each = manifolds.flat_map(|m| {
        let chosen = m.data.solver_contacts.iter().flat_map(|c| c.contact_indices());
        chosen.filter_map(move |i| Some((m, m.points.get(i as usize)?)))
    });
    each.filter(|(_, p)| p.data.impulse > 0.0)
}

/// Reach of a tactile sensor, metres: its spacing on the link.
const REACH: f64 = 0.008;
