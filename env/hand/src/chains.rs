//! Results of the tree of joints: coordinates, chains, and the driver of each joint.

use crate::model::{Drive, DrivenJoint, Hand, Joint, ShapeIndex, Transmission};

/// A branch of moving joints that leaves the base: a finger, in most hands.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Chain {
    /// Name of its first link.
    pub name: String,
    /// Its joints that move, from the root to the tip; where it forks, in the order of the joints.
    pub joints: Vec<usize>,
}

/// The first link of the rigid body of a link; joint `i` moves link `i + 1`.
pub(crate) fn carrier(joints: &[Joint], link: usize) -> usize {
    let mut at = link;
    while let Some(joint) = at.checked_sub(1) {
        if !joints[joint].is_fixed() {
            return at;
        }
        at = joints[joint].parent;
    }
    at
}

impl Hand {
    /// Indices of the independent joints, in the order of the joints: the coordinates of the hand.
    pub fn coordinates(&self) -> impl Iterator<Item = usize> + '_ {
        (0..self.joints.len()).filter(|joint| self.joints[*joint].is_independent())
    }

    /// The chains that leave the base, in the order of their first joints.
    #[must_use]
    pub fn chains(&self) -> Vec<Chain> {
        let mut chains: Vec<Chain> = Vec::new();
        let mut chain_of = vec![None; self.links.len()];
        for (index, joint) in self.joints.iter().enumerate() {
            let mut chain = chain_of[joint.parent];
            if !joint.is_fixed() {
                let number = *chain.get_or_insert(chains.len());
                if number == chains.len() {
                    chains.push(Chain { name: self.links[joint.child].name.clone(), joints: Vec::new() });
                }
                chains[number].joints.push(index);
            }
            chain_of[joint.child] = chain;
        }
        chains
    }

    #[must_use]
    pub fn chain_count(&self) -> usize {
        (0..self.joints.len()).filter(|joint| self.is_root(*joint)).count()
    }

    /// Index of the chain that moves a link; `None` for the base and links fixed to it.
    #[must_use]
    pub fn chain_of_link(&self, link: usize) -> Option<usize> {
        let (mut root, mut at) = (None, link);
        while let Some(joint) = at.checked_sub(1) {
            if !self.joints[joint].is_fixed() {
                root = Some(joint);
            }
            at = self.joints[joint].parent;
        }
        Some((0..root?).filter(|joint| self.is_root(*joint)).count())
    }

    /// True for a joint that moves and whose parent is the base or fixed to it.
    fn is_root(&self, joint: usize) -> bool {
        !self.joints[joint].is_fixed() && self.carrier(self.joints[joint].parent) == 0
    }

    /// The link that a link is fixed to and that a joint moves, or the base: the first link of a rigid body.
    #[must_use]
    pub fn carrier(&self, link: usize) -> usize {
        carrier(&self.joints, link)
    }

    /// True if a rigid body, given by its first link, has collision shapes.
    fn has_shapes(&self, first: usize) -> bool {
        let mut links = self.links.iter().enumerate();
        links.any(|(link, l)| !l.colliders.is_empty() && self.carrier(link) == first)
    }

    /// Rigid bodies that carry collision shapes, chain by chain from the root to the tip, each by its first link; the base is left out.
    #[must_use]
    pub fn touch_links(&self) -> Vec<usize> {
        let joints = self.chains().into_iter().flat_map(|chain| chain.joints);
        joints.map(|joint| self.joints[joint].child).filter(|link| self.has_shapes(*link)).collect()
    }

    /// True if a link may touch the palm: where a moving link with collision shapes lies between them.
    ///
    /// Links next to the palm overlap with it where they are hinged.
    #[must_use]
    pub fn meets_palm(&self, link: usize) -> bool {
        let mut at = self.carrier(link);
        while let Some(joint) = at.checked_sub(1) {
            at = self.carrier(self.joints[joint].parent);
            if at != 0 && self.has_shapes(at) {
                return true;
            }
        }
        false
    }

    /// Pairs of rigid bodies that may touch, by their first links: those of different chains, and the palm with those that
    /// [`Hand::meets_palm`].
    #[must_use]
    pub fn meeting_bodies(&self) -> Vec<[usize; 2]> {
        let links = self.touch_links();
        let chains: Vec<Option<usize>> = links.iter().map(|link| self.chain_of_link(*link)).collect();
        let chain = |number: usize| {
            links.iter().zip(&chains).filter(move |(_, own)| **own == Some(number)).map(|(link, _)| *link)
        };
        let mut pairs = Vec::new();
        for number in 0..self.chain_count() {
            pairs.extend(chain(number).filter(|link| self.meets_palm(*link)).map(|link| [link, 0]));
            for other in number + 1..self.chain_count() {
                pairs.extend(chain(number).flat_map(|a| chain(other).map(move |b| [a, b])));
            }
        }
        pairs
    }

    /// Shapes of a rigid body, given by its first link.
    pub fn shapes_of_body(&self, first: usize) -> impl Iterator<Item = ShapeIndex> + '_ {
        let links = (0..self.links.len()).filter(move |link| self.carrier(*link) == first);
        links.flat_map(|link| (0..self.links[link].colliders.len()).map(move |shape| (link, shape)))
    }

    /// False for shapes that pass through each other.
    #[must_use]
    pub fn shapes_touch(&self, a: ShapeIndex, b: ShapeIndex) -> bool {
        self.no_contact.shapes.binary_search(&[a.min(b), a.max(b)]).is_err()
    }

    /// True if no moving joint follows on a link: the tip of a chain.
    #[must_use]
    pub fn is_tip(&self, link: usize) -> bool {
        !self.joints.iter().any(|joint| !joint.is_fixed() && self.carrier(joint.parent) == link)
    }

    /// The actuator that drives an independent joint, and how it does so; `None` for a joint that moves freely or on tendons.
    #[must_use]
    pub fn driver(&self, joint: usize) -> Option<(usize, &DrivenJoint, Drive)> {
        self.actuators.iter().enumerate().find_map(|(index, actuator)| match &actuator.transmission {
            Transmission::Joints { joints, drive } => {
                joints.iter().find(|driven| driven.joint == joint).map(|driven| (index, driven, *drive))
            }
            Transmission::Spool { .. } => None,
        })
    }

    /// Where a rigidly driven joint, or one that follows such a joint, is with the actuators at `positions`; `None` for any other joint.
    ///
    /// * `positions`: one per actuator, rad or m.
    #[must_use]
    pub fn rigid_position(&self, joint: usize, positions: impl Fn(usize) -> f64) -> Option<f64> {
        if let Some(mimic) = self.joints[joint].mimic {
            return self.rigid_position(mimic.joint, positions).map(|position| mimic.ratio * position + mimic.offset);
        }
        match self.driver(joint)? {
            (actuator, driven, Drive::Rigid) => Some(self.led(driven, positions(actuator))),
            (_, _, Drive::Servo { .. }) => None,
        }
    }
}
