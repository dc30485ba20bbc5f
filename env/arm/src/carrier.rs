//! An arm with the hand that it carries, as a simulation in the frame of the hand sees it: [`graspbox_hand::Carrier`].

use crate::bodies::{ArmBodies, Body};
use crate::chain::Chain;
use graspbox_hand::{Arm, Carrier, CarrierAxis, CarrierBody, Hand, JointKind};
use nalgebra::Isometry3;

/// The bodies of an arm in a chain from the base of a hand to its own.
///
/// * `flange_from_base`: pose of the hand's base on the flange.
#[must_use]
pub fn carrier(
    arm: &Arm,
    chain: &Chain,
    bodies: &ArmBodies,
    hand: &Hand,
    flange_from_base: &Isometry3<f64>,
) -> Carrier {
    let count = chain.len();
    // The frame of a body is that of the axis that it ends in, at position 0; of the body that bears the hand, that of the last axis.
    let own_from_body = |body: usize| match body {
        body if body == count => Isometry3::identity(),
        body => chain.before(body).isometry().inverse(),
    };
    let shapes = |body: usize, of: &Body| {
        let place = own_from_body(body);
        of.solids.iter().map(|solid| (solid.shape, place * solid.body_from_shape)).collect()
    };
    let one = |body: usize| CarrierBody {
        name: bodies.name(body).to_owned(),
        kind: match body {
            body if body == count => JointKind::Fixed,
            body if chain.is_revolute(body) => JointKind::Revolute,
            _ => JointKind::Prismatic,
        },
        before_from_joint: match body {
            body if body == count => flange_from_base.inverse() * chain.axis_from_flange().inverse(),
            body => own_from_body(body + 1),
        },
        shapes: shapes(body, &bodies.bodies[body]),
    };
    let axis = |(axis, joint): (&graspbox_hand::Axis, &graspbox_hand::Joint)| CarrierAxis {
        name: joint.name.clone(),
        kind: joint.kind,
        limits: joint.limits,
        speed: axis.speed,
    };
    Carrier {
        arm: arm.name.clone(),
        friction: hand.friction.bare,
        axes: arm.axes.iter().zip(arm.axis_joints()).map(axis).collect(),
        bodies: (0..=count).rev().map(one).collect(),
    }
}
