//! The arm that carries the hand, in the solver's tree: bodies that move only by driven coordinates, so they push and are not pushed.
//!
//! Seen from the hand's base the arm is a chain that ends at its own base. Six coordinates before it displace the whole chain: what the mount of
//! the hand is off. The order is that of [`crate::world::carrier`].

use super::translate::{bare_body, primitive};
use graspbox_hand::{Carrier, JointKind};
use graspbox_solver as solver;
use nalgebra::{Isometry3, Unit, Vector3};

/// The axes of the coordinates of the mount: x, y, z, then yaw, pitch and roll.
const MOUNT: [(solver::JointKind, usize); 6] = [
    (solver::JointKind::Prismatic, 0),
    (solver::JointKind::Prismatic, 1),
    (solver::JointKind::Prismatic, 2),
    (solver::JointKind::Revolute, 2),
    (solver::JointKind::Revolute, 1),
    (solver::JointKind::Revolute, 0),
];

/// Where the bodies of the arm are in the tree.
#[derive(Clone, Copy, Default)]
pub(crate) struct ArmBodies {
    /// The first of them; `None` without an arm.
    first: Option<usize>,
    /// Number of bodies with those of the mount.
    pub count: usize,
}

impl ArmBodies {
    /// Adds the arm to the tree of its hand, as the last bodies and driven coordinates.
    pub fn add(carrier: &Carrier, tree: &mut solver::Tree) -> Self {
        let mut parent = 0;
        for (kind, axis) in MOUNT {
            parent = push(tree, parent, joint(kind, Isometry3::identity(), Vector3::ith_axis(axis), 1.0));
        }
        let first = tree.bodies.len();
        for body in &carrier.bodies {
            let kind = match body.kind {
                JointKind::Prismatic => solver::JointKind::Prismatic,
                JointKind::Fixed | JointKind::Revolute => solver::JointKind::Revolute,
            };
            let own = joint(kind, body.before_from_joint, Vector3::z_axis(), -1.0);
            parent = match body.kind {
                // The coordinate before, which does not move it.
                JointKind::Fixed => {
                    let coordinate = tree.coordinates.len() + tree.driven - 1;
                    tree.bodies.push(bare_body(parent, Some(solver::Joint { coordinate, ratio: 0.0, ..own })));
                    tree.bodies.len() - 1
                }
                _ => push(tree, parent, own),
            };
            let shape = |(shape, body_from_shape): &(graspbox_hand::Shape, Isometry3<f64>)| solver::BodyShape {
                primitive: primitive(shape),
                body_from_shape: *body_from_shape,
                friction: carrier.friction,
            };
            tree.bodies[parent].shapes = body.shapes.iter().map(shape).collect();
        }
        Self { first: Some(first), count: MOUNT.len() + carrier.bodies.len() }
    }

    /// Index of the arm's body that a body of the tree is; `None` for one of the hand.
    #[inline]
    pub fn body(self, body: usize) -> Option<usize> {
        self.first.and_then(|first| body.checked_sub(first))
    }
}

/// A joint whose coordinate is not known yet.
fn joint(
    kind: solver::JointKind,
    parent_from_joint: Isometry3<f64>,
    axis: Unit<Vector3<f64>>,
    ratio: f64,
) -> solver::Joint {
    solver::Joint { kind, parent_from_joint, axis, coordinate: 0, ratio, offset: 0.0 }
}

/// Adds a body on a joint with a driven coordinate of its own; returns its index.
fn push(tree: &mut solver::Tree, parent: usize, joint: solver::Joint) -> usize {
    let coordinate = tree.coordinates.len() + tree.driven;
    tree.driven += 1;
    tree.bodies.push(bare_body(parent, Some(solver::Joint { coordinate, ..joint })));
    tree.bodies.len() - 1
}
