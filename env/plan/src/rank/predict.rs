//! Prediction of a grasp: chains (fingers) closed on the object's surface, their contacts, and features of both.

use super::neighbors::{Group, Groups};
use crate::chain::{ChainModel, ClosedChain, PlanePoint, PlaneTable, SpatialChain, TableSide, Workspace};
use crate::collision::CollisionScene;
use crate::preshape::closing_center;
use crate::wrench::{Directions, WrenchSpace};
use graspbox_hand::Hand;
use graspbox_mesh::SurfaceSample;
use nalgebra::{Isometry3, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// Features of a predicted grasp, from the geometry of the closed hand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Prediction {
    /// Number of fingers that touch the object.
    pub fingers: f64,
    /// Number of links that touch it with a pad.
    pub pads: f64,
    /// Least wrench in any direction that one unit of force per finger resists (torques divided by 5 cm); 0 without force closure.
    pub epsilon: f64,
    /// Cancellation of opposing fingers' normals: 1 minus the length of their sum over the sum of their lengths.
    pub balance: f64,
    /// Horizontal distance of the centre of mass from the middle of the contacts, metres.
    pub lever: f64,
    /// Distance of the centre of mass from the palm along hand z, metres.
    pub depth: f64,
    /// Distance of the centre of mass from the closing centre in the palm's plane, metres.
    pub offset: f64,
    /// Mean rotation of the last links of touching fingers, radians; beyond pi/2 they reach behind the object.
    pub wrap: f64,
    /// Least of these rotations, radians.
    pub least_wrap: f64,
    /// Greatest difference between the first joints of touching fingers, radians or metres.
    pub uneven: f64,
    /// Number of fingers that touched the table while closing.
    pub on_table: f64,
    /// Downward component of the approach: 1 from above, 0 from the side.
    pub down: f64,
    /// Greatest distance between two contacts, metres.
    pub span: f64,
    /// Distance of the centre of mass ahead of the closing centre along hand x, metres.
    pub ahead: f64,
    /// Distance of the centre of mass from the closing centre along hand y, metres.
    pub aside: f64,
    /// Downward component of hand x: 1 straight down, -1 straight up.
    pub nose_down: f64,
    /// Distance of the middle of the contacts from the palm along hand z, metres.
    pub contact_depth: f64,
    /// Greatest distance between two contacts along hand x, metres.
    pub width: f64,
    /// Opposition of one finger to the others: greatest cosine between its force and the reverse of theirs; 0 for a single finger.
    pub opposed: f64,
}

/// A contact of a finger with the object; object frame.
struct Contact {
    point: Point3<f64>,
    /// Unit normal into the object.
    inward: Vector3<f64>,
    /// Coefficient of friction.
    friction: f64,
    finger: usize,
}

/// Data shared by all predictions of one object.
pub(crate) struct Target<'a> {
    pub samples: &'a [SurfaceSample],
    pub groups: &'a Groups,
    pub center_of_mass: Point3<f64>,
    pub scene: &'a CollisionScene,
}

/// A hand at one preshape, prepared for closing.
pub(crate) struct ClosingHand {
    pub preshape: f64,
    pub fingers: Fingers,
    pub center: Vector3<f64>,
    pub friction: [f64; 2],
}

/// The chains of a hand.
pub(crate) enum Fingers {
    /// Each closes in its plane.
    Planar(Vec<ChainModel>),
    /// They close in space, since the plane of one of them rotates, or its joints close at the same time.
    Spatial(Vec<SpatialChain>),
}

impl Fingers {
    fn count(&self) -> usize {
        match self {
            Self::Planar(chains) => chains.len(),
            Self::Spatial(chains) => chains.len(),
        }
    }
}

/// Most contacts of a link that enter the wrench space.
const LINK_CONTACTS: usize = 4;

/// Closes the hand at `object_from_hand` and computes the features of the grasp.
pub(crate) fn predict(
    target: &Target<'_>,
    hand: &ClosingHand,
    object_from_hand: &Isometry3<f64>,
    work: &mut Workspace,
) -> Prediction {
    let hand_from_object = object_from_hand.inverse();
    let closed: Vec<ClosedChain> = match &hand.fingers {
        Fingers::Planar(chains) => {
            chains.iter().map(|finger| close_one(target, finger, &hand_from_object, object_from_hand, work)).collect()
        }
        Fingers::Spatial(chains) => close_in_space(target, chains, &hand_from_object, object_from_hand),
    };
    let contacts = contacts(target, hand, &closed);
    let com = hand_from_object * target.center_of_mass;
    let mut p = Prediction {
        fingers: closed.iter().filter(|f| touches(f)).count() as f64,
        pads: closed.iter().flat_map(|f| &f.touched).filter(|t| t.iter().any(|&(_, pad)| pad)).count() as f64,
        depth: com.z,
        offset: (com.coords - hand.center).xy().norm(),
        on_table: closed.iter().filter(|f| f.met_table).count() as f64,
        down: -target.scene.up().dot(&(object_from_hand * Vector3::z())),
        ahead: com.x - hand.center.x,
        aside: (com.y - hand.center.y).abs(),
        nose_down: -target.scene.up().dot(&(object_from_hand * Vector3::x())),
        ..Prediction::default()
    };
    describe_fingers(&closed, &mut p);
    describe_contacts(target, hand, &contacts, object_from_hand, &mut p);
    p
}

fn touches(finger: &ClosedChain) -> bool {
    finger.touched.iter().any(|link| !link.is_empty())
}

fn close_in_space(
    target: &Target<'_>,
    chains: &[SpatialChain],
    hand_from_object: &Isometry3<f64>,
    object_from_hand: &Isometry3<f64>,
) -> Vec<ClosedChain> {
    let points: Vec<_> =
        target.samples.iter().zip(0u32..).map(|(sample, index)| (hand_from_object * sample.point, index)).collect();
    let up = hand_from_object * target.scene.up().into_inner();
    let table = TableSide { up, offset: target.scene.height(&(object_from_hand * Point3::origin())) };
    chains.iter().map(|chain| chain.close(&points, &table)).collect()
}

fn close_one(
    target: &Target<'_>,
    finger: &ChainModel,
    hand_from_object: &Isometry3<f64>,
    object_from_hand: &Isometry3<f64>,
    work: &mut Workspace,
) -> ClosedChain {
    /// Greatest distance of a point from the finger, metres: samples are about 5 mm apart.
    const BESIDE: f64 = 0.002;
    /// Margin for the rounding between two frames, metres; far above it.
    const ROUNDING: f64 = 1e-9;
    let [x_axis, y_axis, z_axis] = finger.axes();
    let origin = finger.hand_from_plane.translation.vector;
    let reach = finger.reach + BESIDE;
    // Most samples are off the finger: a test of whole groups in their own frame rejects them faster.
    let across = object_from_hand * y_axis;
    let root = object_from_hand * Point3::from(origin);
    let slab = (across, across.dot(&root.coords), finger.half_width + BESIDE + ROUNDING);
    let around = (root, reach.hypot(slab.2) + ROUNDING);
    let groups: Vec<&Group> = target.groups.near(slab, around).collect();
    let [x_side, z_side] = [x_axis, z_axis].map(|axis| object_from_hand * axis);
    let disc = |group: &&Group| {
        let from = group.center - root;
        ([from.dot(&x_side), from.dot(&z_side)], group.radius)
    };
    let fill = |number: usize, points: &mut Vec<PlanePoint>| {
        for &(point, index) in target.groups.samples(groups[number]) {
            if (across.dot(&point.coords) - slab.1).abs() > slab.2 {
                continue;
            }
            let from = (hand_from_object * point).coords - origin;
            if from.dot(&y_axis).abs() > finger.half_width + BESIDE {
                continue;
            }
            let (x, z) = (from.dot(&x_axis), from.dot(&z_axis));
            if x * x + z * z <= reach.powi(2) {
                points.push(PlanePoint { x, z, index });
            }
        }
    };
    let object_from_plane = object_from_hand * finger.hand_from_plane;
    let up = object_from_plane.inverse() * target.scene.up().into_inner();
    let origin = target.scene.height(&Point3::from(object_from_plane.translation.vector));
    // The lower edge of the finger counts.
    let offset = up.y.abs() * finger.half_width - origin;
    finger.close(groups.iter().map(disc), &fill, &PlaneTable { normal: [up.x, up.z], offset }, work)
}

fn contacts(target: &Target<'_>, hand: &ClosingHand, closed: &[ClosedChain]) -> Vec<Contact> {
    let mut contacts = Vec::new();
    for (finger, state) in closed.iter().enumerate() {
        for link in &state.touched {
            let every = link.len().div_ceil(LINK_CONTACTS).max(1);
            contacts.extend(link.iter().step_by(every).map(|&(index, pad)| {
                let sample = &target.samples[index as usize];
                Contact {
                    point: sample.point,
                    inward: -sample.normal,
                    friction: hand.friction[usize::from(pad)],
                    finger,
                }
            }));
        }
    }
    contacts
}

fn describe_fingers(closed: &[ClosedChain], p: &mut Prediction) {
    let touching: Vec<&ClosedChain> = closed.iter().filter(|f| touches(f)).collect();
    if touching.is_empty() {
        return;
    }
    let turns = touching.iter().map(|f| f.turn);
    p.wrap = turns.clone().sum::<f64>() / touching.len() as f64;
    p.least_wrap = turns.fold(f64::INFINITY, f64::min);
    let angles = touching.iter().map(|f| f.root);
    p.uneven = angles.clone().fold(f64::NEG_INFINITY, f64::max) - angles.fold(f64::INFINITY, f64::min);
}

fn describe_contacts(
    target: &Target<'_>,
    hand: &ClosingHand,
    contacts: &[Contact],
    object_from_hand: &Isometry3<f64>,
    p: &mut Prediction,
) {
    if contacts.is_empty() {
        return;
    }
    let up = target.scene.up();
    let [closing, approach] = [Vector3::x(), Vector3::z()].map(|axis| object_from_hand * axis);
    // One mean normal per finger: a link with many samples does not outweigh the others.
    let mut pushes = vec![Vector3::zeros(); hand.fingers.count()];
    for contact in contacts {
        pushes[contact.finger] += contact.inward;
    }
    let pushes: Vec<Vector3<f64>> = pushes.iter().filter_map(|push| push.try_normalize(1e-9)).collect();
    let across = |push: &Vector3<f64>| push - approach * push.dot(&approach);
    let total: Vector3<f64> = pushes.iter().map(across).sum();
    let lengths: f64 = pushes.iter().map(|push| across(push).norm()).sum();
    p.balance = 1.0 - total.norm() / lengths.max(1e-9);
    let sum: Vector3<f64> = pushes.iter().sum();
    let against = |push: &Vector3<f64>| (sum - push).try_normalize(1e-9).map_or(0.0, |others| -push.dot(&others));
    p.opposed = pushes.iter().map(against).fold(0.0, f64::max);
    let middle = contacts.iter().map(|c| c.point.coords).sum::<Vector3<f64>>() / contacts.len() as f64;
    p.contact_depth = (object_from_hand.inverse() * Point3::from(middle)).z;
    let along = contacts.iter().map(|c| c.point.coords.dot(&closing));
    p.width = along.clone().fold(f64::NEG_INFINITY, f64::max) - along.fold(f64::INFINITY, f64::min);
    let arm = target.center_of_mass.coords - middle;
    p.lever = (arm - up.into_inner() * arm.dot(&up)).norm();
    let apart = |a: &Contact| contacts.iter().map(|b| (a.point - b.point).norm()).fold(0.0, f64::max);
    p.span = contacts.iter().map(apart).fold(0.0, f64::max);
    let mut space = WrenchSpace::new(hand.fingers.count());
    for contact in contacts {
        space.press(contact.finger, &(contact.point - target.center_of_mass), contact.inward, contact.friction);
    }
    p.epsilon = space.epsilon(Directions::Fine);
}

/// The chains of the hand at a preshape, prepared for closing.
pub(crate) fn closing_hand(hand: &Hand, preshape: f64) -> Result<ClosingHand, crate::PlanError> {
    let planar = ChainModel::all(hand, preshape)?;
    let fingers = if planar.iter().any(|chain| chain.turns || chain.together) {
        Fingers::Spatial(SpatialChain::all(hand, preshape)?)
    } else {
        Fingers::Planar(planar)
    };
    Ok(ClosingHand {
        preshape,
        fingers,
        center: closing_center(hand, preshape)?,
        friction: [hand.friction.bare, hand.friction.pad],
    })
}
