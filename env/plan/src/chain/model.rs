//! The chain of a hand as rectangles in the plane in which it closes.

use super::plane::{LinkShape, Rect};
use super::steps::motions;
use super::{ChainModel, Coordinate, Direction, Motion, STEP, Segment, TURNING};
use crate::PlanError;
use graspbox_hand::{Chain, Collider, Hand, JointKind, Material, Transmission};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// A joint closes in the plane if the cosine between its axis and the plane's normal (for a prismatic joint, the sine) is at least this.
const IN_PLANE: f64 = 0.9;
/// Step of a prismatic joint per angular step, metres per radian: 5 mm for [`STEP`].
const SLIDE: f64 = 0.005 / STEP;

impl ChainModel {
    /// Every chain of `hand` that closes, at `preshape`.
    ///
    /// # Errors
    /// [`PlanError::UnsupportedHand`] for a preshape beyond the hand's limits.
    pub fn all(hand: &Hand, preshape: f64) -> Result<Vec<Self>, PlanError> {
        let bad = |_| PlanError::UnsupportedHand { name: hand.name.clone(), reason: "does not take this preshape" };
        let configuration = hand.open_configuration(preshape);
        let open = hand.joint_positions(&configuration).map_err(bad)?;
        let links = hand.hand_from_links(&configuration).map_err(bad)?;
        let mut models = Vec::new();
        for chain in hand.chains() {
            let Some(planar) = Planar::of(hand, &chain, &links) else { continue };
            models.push(Self::new(hand, &chain, &planar, &links, &open));
        }
        Ok(models)
    }

    /// * `links`: hand_from_link of the open hand.
    /// * `open`: joint positions of the open hand.
    fn new(hand: &Hand, chain: &Chain, planar: &Planar, links: &[Isometry3<f64>], open: &[f64]) -> Self {
        let joints = &planar.joints;
        let hand_from_plane = plane(hand, chain, links, planar);
        let plane_from_hand = hand_from_plane.inverse();
        let (coordinates, moving) = coordinates(hand, joints, open);
        let mut half_width: f64 = 0.0;
        let (mut segments, mut before): (Vec<Segment>, Vector3<f64>) = (Vec::new(), Vector3::zeros());
        let (mut reach, mut length): (f64, f64) = (0.0, 0.0);
        let (mut extent, mut furthest, mut slides): (f64, f64, Vec<f64>) = (0.0, 0.0, Vec::new());
        for (&joint, &(coordinate, ratio)) in joints.iter().zip(&moving) {
            let ratio = if planar.turns_back(hand, links, joint) { -ratio } else { ratio };
            let plane_from_child = plane_from_hand * links[hand.joints[joint].child];
            // The plane's origin is exactly the first joint, despite rounding.
            let origin = if segments.is_empty() { Vector3::zeros() } else { plane_from_child.translation.vector };
            let rects = rects(hand, joints, joint, &origin, &mut half_width, |link| plane_from_hand * links[link]);
            let motion = match hand.joints[joint].kind {
                JointKind::Prismatic => {
                    let along = plane_from_hand * closing_axis(hand, links, joint);
                    Motion::Slide([along.x, along.z])
                }
                JointKind::Fixed | JointKind::Revolute => Motion::Turn,
            };
            let step = origin - before;
            let most = coordinates[coordinate].limits[1] * ratio;
            length += step.norm() + if motion == Motion::Turn { 0.0 } else { most };
            let corner = |r: &Rect| r.x[1].hypot(r.z[1].abs().max(r.z[0].abs()));
            reach = reach.max(length + rects.iter().map(corner).fold(0.0, f64::max));
            let shape = LinkShape::new(rects);
            let far = coordinates[coordinate].limits.map(f64::abs).into_iter().fold(0.0, f64::max) * ratio.abs();
            slides.push(if motion == Motion::Turn { 0.0 } else { far });
            furthest += step.norm() + slides[slides.len() - 1];
            extent = extent.max(furthest + shape.furthest_corner());
            segments.push(Segment { at: [step.x, step.z], motion, coordinate, ratio, shape });
            before = origin;
        }
        let direction = |along: Vec<f64>| Direction { links: motions(&segments, &slides, &along), along };
        let moves = moves(&coordinates).into_iter().map(direction).collect();
        let padded = segments.iter().rposition(|segment| segment.shape.rects.iter().any(|rect| rect.pad));
        let tip = padded.unwrap_or(segments.len().saturating_sub(1));
        let together = coordinates.len() > 1 && coordinates.iter().all(|coordinate| coordinate.arm == 0.0);
        let turns = planar.turns;
        Self { hand_from_plane, segments, tip, coordinates, moves, half_width, reach, extent, turns, together }
    }
}

/// The joints of a chain that close in one plane.
struct Planar {
    /// These joints, from the root to the tip; at least one.
    joints: Vec<usize>,
    /// The joint that defines the plane: the last independent one that closes.
    last: usize,
    /// Another independent joint closes about another axis at a similar speed.
    turns: bool,
}

impl Planar {
    /// `None` for a chain that does not close.
    fn of(hand: &Hand, chain: &Chain, links: &[Isometry3<f64>]) -> Option<Self> {
        let closing: Vec<usize> =
            chain.joints.iter().copied().filter(|joint| hand.closing_rate(*joint) != 0.0).collect();
        let independent = |joint: &&usize| hand.joints[**joint].is_independent();
        let last = *closing.iter().rfind(independent).or(closing.last())?;
        let axis = closing_axis(hand, links, last);
        let in_plane = |joint: &usize| {
            let along = closing_axis(hand, links, *joint).dot(&axis);
            // A joint that follows the same coordinate may turn against it, as the tip of a parallel linkage does.
            let follows = hand.joints[*joint].mimic.is_some() && leader(hand, *joint) == leader(hand, last);
            match (hand.joints[last].kind, hand.joints[*joint].kind) {
                (JointKind::Revolute, JointKind::Revolute) if follows => along.abs() >= IN_PLANE,
                (a, b) if a == b => along >= IN_PLANE,
                (JointKind::Revolute, JointKind::Prismatic) => along.abs() <= 1.0 - IN_PLANE,
                _ => false,
            }
        };
        let (joints, others): (Vec<usize>, Vec<usize>) = closing.into_iter().partition(in_plane);
        let rate = |joint: &usize| hand.closing_rate(*joint).abs();
        let fastest = joints.iter().map(rate).fold(0.0, f64::max);
        let turns = |joint: &usize| hand.joints[*joint].is_independent() && rate(joint) > TURNING * fastest;
        let turns = others.iter().any(turns);
        Some(Self { joints, last, turns })
    }

    /// True for a joint that turns against the closing of the chain as its coordinate closes.
    fn turns_back(&self, hand: &Hand, links: &[Isometry3<f64>], joint: usize) -> bool {
        let same = hand.joints[joint].kind == hand.joints[self.last].kind;
        same && closing_axis(hand, links, joint).dot(&closing_axis(hand, links, self.last)) < 0.0
    }
}

/// The independent joint whose position is the coordinate of `joint`.
fn leader(hand: &Hand, joint: usize) -> usize {
    hand.joints[joint].mimic.map_or(joint, |mimic| mimic.joint)
}

/// Axis of a joint in the hand frame, with the sign for which positive motion closes.
fn closing_axis(hand: &Hand, links: &[Isometry3<f64>], joint: usize) -> Vector3<f64> {
    let description = &hand.joints[joint];
    links[description.child].rotation * description.axis.into_inner() * hand.closing_rate(joint).signum()
}

/// The plane of a chain: origin on its first joint.
fn plane(hand: &Hand, chain: &Chain, links: &[Isometry3<f64>], planar: &Planar) -> Isometry3<f64> {
    let (first, last) = (planar.joints[0], planar.last);
    let hand_from_link = links[hand.joints[first].child];
    let link_from_hand = hand_from_link.inverse();
    let out = link_from_hand.rotation * furthest(hand, chain, links, &hand_from_link.translation.vector);
    let along = |axis: usize| -> (f64, Vector3<f64>) {
        let unit = Vector3::ith(axis, 1.0);
        let share = out.dot(&unit);
        (share.abs(), unit * if share < 0.0 { -1.0 } else { 1.0 })
    };
    let description = &hand.joints[last];
    let basis = match description.kind {
        JointKind::Fixed | JointKind::Revolute => {
            let y = if last == first || hand.joints[first].kind == JointKind::Revolute {
                -(hand.joints[first].axis.into_inner() * hand.closing_rate(first).signum())
            } else {
                -(link_from_hand.rotation * closing_axis(hand, links, last))
            };
            let best = (0..3).map(along).map(|(share, unit)| (share * (1.0 - y.dot(&unit).abs()), unit));
            let (_, unit) = best.fold((-1.0, Vector3::x()), |a, b| if b.0 > a.0 { b } else { a });
            let x = (unit - y * y.dot(&unit)).normalize();
            Matrix3::from_columns(&[x, y, x.cross(&y)])
        }
        JointKind::Prismatic => {
            let z = link_from_hand.rotation * closing_axis(hand, links, first);
            let approach = link_from_hand.rotation * Vector3::z();
            let across =
                if z.dot(&approach).abs() > IN_PLANE { link_from_hand.rotation * Vector3::x() } else { approach };
            let x = (across - z * z.dot(&across)).normalize();
            Matrix3::from_columns(&[x, z.cross(&x), z])
        }
    };
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(basis));
    hand_from_link * Isometry3::from_parts(Translation3::identity(), rotation)
}

/// Vector from a point to the middle of the farthest collision shape of a chain, hand frame.
fn furthest(hand: &Hand, chain: &Chain, links: &[Isometry3<f64>], from: &Vector3<f64>) -> Vector3<f64> {
    let children = chain.joints.iter().map(|joint| hand.joints[*joint].child);
    let shapes = children.flat_map(|link| {
        hand.links[link].colliders.iter().map(move |c| (links[link] * c.link_from_shape).translation.vector - from)
    });
    shapes.fold(Vector3::zeros(), |a, b| if b.norm() > a.norm() { b } else { a })
}

/// The coordinates that move `joints`, and for each joint its coordinate and ratio.
fn coordinates(hand: &Hand, joints: &[usize], open: &[f64]) -> (Vec<Coordinate>, Vec<(usize, f64)>) {
    let mut leaders: Vec<usize> = Vec::new();
    let mut found: Vec<Coordinate> = Vec::new();
    let mut moving = Vec::with_capacity(joints.len());
    for &joint in joints {
        let (leader, ratio) = hand.joints[joint].mimic.map_or((joint, 1.0), |mimic| (mimic.joint, mimic.ratio.abs()));
        let number = leaders.iter().position(|known| *known == leader).unwrap_or_else(|| {
            leaders.push(leader);
            found.push(coordinate(hand, leader, open[leader]));
            leaders.len() - 1
        });
        moving.push((number, ratio));
    }
    (found, moving)
}

fn coordinate(hand: &Hand, joint: usize, open: f64) -> Coordinate {
    let [lower, upper] = hand.joints[joint].limits;
    let limits =
        if hand.closing_rate(joint) < 0.0 { [open - upper, open - lower] } else { [lower - open, upper - open] };
    let arm = |actuator: &usize| match hand.actuators[*actuator].transmission {
        Transmission::Spool { tendon, .. } => hand.tendons[tendon].arm(joint).abs(),
        Transmission::Joints { .. } => 0.0,
    };
    let arm = hand.grasp.closing.iter().map(arm).fold(0.0, f64::max);
    let scale = if hand.joints[joint].kind == JointKind::Prismatic { SLIDE } else { 1.0 };
    Coordinate { limits, arm, scale }
}

/// Each coordinate by itself, from the root; then each with an earlier one that yields, if the tendon still shortens.
fn moves(coordinates: &[Coordinate]) -> Vec<Vec<f64>> {
    let still = vec![0.0; coordinates.len()];
    let alone = |i: usize| {
        let mut direction = still.clone();
        direction[i] = coordinates[i].scale;
        direction
    };
    let mut moves: Vec<Vec<f64>> = (0..coordinates.len()).map(alone).collect();
    for outer in 1..coordinates.len() {
        for inner in 0..outer {
            let [near, far] = [coordinates[inner].arm, coordinates[outer].arm];
            if near <= 0.0 || far <= 0.0 {
                continue;
            }
            let most = 0.95 * far / near;
            for give in [most / 3.0, most * 2.0 / 3.0, most] {
                let mut direction = alone(outer);
                direction[inner] = -give;
                moves.push(direction);
            }
        }
    }
    moves
}

/// Rectangles of all links that move with `joint` but with none of the later `joints`.
fn rects(
    hand: &Hand,
    joints: &[usize],
    joint: usize,
    origin: &Vector3<f64>,
    half_width: &mut f64,
    plane_from_link: impl Fn(usize) -> Isometry3<f64>,
) -> Vec<Rect> {
    let moves_with = |link: usize| {
        let mut at = link;
        while let Some(above) = at.checked_sub(1) {
            if joints.contains(&above) {
                return above == joint;
            }
            at = hand.joints[above].parent;
        }
        false
    };
    let mut rects = Vec::new();
    for link in (0..hand.links.len()).filter(|link| moves_with(*link)) {
        rects.extend(hand.links[link].colliders.iter().map(|c: &Collider| {
            let place = plane_from_link(link) * c.link_from_shape;
            let half = c.shape.half_extents(&place.rotation);
            *half_width = half_width.max(half.y);
            let middle = place.translation.vector - origin;
            let side = |i: usize| [middle[i] - half[i], middle[i] + half[i]];
            Rect { x: side(0), z: side(2), pad: c.material == Material::Pad }
        }));
    }
    rects
}
