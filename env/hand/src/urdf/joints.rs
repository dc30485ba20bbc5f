//! Joints: kinds, ranges, and those that follow others.

use std::f64::consts::PI;

use nalgebra::{Unit, Vector3};

use super::assumption::AssumptionKind;
use super::element::Element;
use super::links::isometry;
use super::{MAX_COORDINATE, Tree, names_of};
use crate::error::{ProblemKind, Report};
use crate::model::{Joint, JointKind, Mimic};

/// Rounding of limits that were written with few digits, rad or m.
const ROUNDING: f64 = 1e-9;
/// Share of its range by which a follower may leave its limits without a word: numbers of three digits.
const WORTH_TELLING: f64 = 1e-3;

/// A joint as written; `None` as its range: that of its leader.
pub(super) fn read(
    written: &Element,
    parent: usize,
    child: usize,
    report: &mut Report<'_>,
) -> (Joint, Option<[f64; 2]>) {
    let name = names_of(written).to_owned();
    let found = written.attribute("type").unwrap_or_default();
    let kind = match found {
        "revolute" | "continuous" => JointKind::Revolute,
        "prismatic" => JointKind::Prismatic,
        // Free joints are settled later, once all joints are known.
        "fixed" | "floating" | "planar" => JointKind::Fixed,
        other => {
            let remedy = match other {
                "ball" | "spherical" => "use three revolute joints with a small link between each two",
                _ => "its type must be revolute, continuous, prismatic or fixed",
            };
            let found = if other.is_empty() { "without a type" } else { other }.to_owned();
            report.add(written.line, ProblemKind::JointType { name: name.clone(), found, remedy });
            JointKind::Fixed
        }
    };
    let fixed = kind == JointKind::Fixed;
    let range = if fixed { Some([0.0; 2]) } else { range(written, &name, found == "continuous", report) };
    let stated = |attribute| written.child("limit").map_or(0.0, |limit| limit.number(attribute, 0.0));
    let limit = |attribute| Some(stated(attribute)).filter(|number| number.is_finite()).unwrap_or_default();
    let joint = Joint {
        kind,
        parent,
        child,
        parent_from_joint: isometry(written),
        axis: axis(written, &name, fixed, report),
        limits: range.unwrap_or_default(),
        effort: limit("effort"),
        velocity: limit("velocity"),
        mimic: None,
        stiffness: 0.0,
        spring_reference: 0.0,
        damping: 0.0,
        armature: 0.0,
        stop_stiffness: 0.0,
        name,
    };
    (joint, range)
}

/// The range of a moving joint; `None` for that of its leader.
fn range(written: &Element, name: &str, continuous: bool, report: &mut Report<'_>) -> Option<[f64; 2]> {
    let follows = written.child("mimic").is_some();
    let limit = written.child("limit");
    let stated = limit.map(|limit| [limit.number("lower", 0.0), limit.number("upper", 0.0)]);
    let (joint, line) = (name.to_owned(), limit.map_or(written.line, |limit| limit.line));
    match stated {
        Some([lower, upper]) if lower < upper && lower.abs().max(upper.abs()) <= MAX_COORDINATE => {
            if continuous && !follows {
                let (from, limits) = ("that of its <limit>", [lower, upper]);
                report.assume(line, AssumptionKind::Continuous { joint, from, limits });
            }
            stated
        }
        _ if follows => None,
        _ if continuous => {
            let limits = [-PI, PI];
            report.assume(line, AssumptionKind::Continuous { joint, from: "one turn", limits });
            Some(limits)
        }
        Some([lower, upper]) => {
            let (quantity, must) = ("limit", "the upper end must be greater");
            report.add(line, ProblemKind::Interval { item: "joint", name: joint, quantity, lower, upper, must });
            stated
        }
        None => {
            report.add(line, ProblemKind::Missing { item: "joint", name: joint, missing: "limit" });
            Some([0.0; 2])
        }
    }
}

fn axis(written: &Element, name: &str, fixed: bool, report: &mut Report<'_>) -> Unit<Vector3<f64>> {
    let axis = written.child("axis");
    let xyz = axis.and_then(|axis| axis.numbers::<3>("xyz")).map_or(Vector3::x(), Vector3::from);
    Unit::try_new(xyz, 1e-6).unwrap_or_else(|| {
        if !fixed {
            let (value, must) = (xyz.norm(), "longer than 0");
            let (item, name, quantity) = ("joint", name.to_owned(), "axis length");
            let line = axis.map_or(written.line, |axis| axis.line);
            report.add(line, ProblemKind::Value { item, name, quantity, value, must });
        }
        Vector3::x_axis()
    })
}

/// Takes a floating or planar joint as fixed where it moves the whole hand: no other joint leaves the root.
pub(super) fn settle_free(tree: &Tree, written: &[&Element], report: &mut Report<'_>) {
    let is_free = |joint: usize| matches!(written[joint].attribute("type"), Some("floating" | "planar"));
    let mut settled = vec![false; written.len()];
    for free in (0..written.len()).filter(|joint| is_free(*joint)) {
        let moves = |joint: usize| !tree.joints[joint].is_fixed() || (is_free(joint) && !settled[joint]);
        let carriers = tree.carriers_by(moves);
        let alone = (0..written.len())
            .all(|joint| (carriers[tree.joints[joint].parent] == 0 && moves(joint)) == (joint == free));
        let (joint, found) =
            (tree.joints[free].name.clone(), written[free].attribute("type").unwrap_or_default().to_owned());
        if alone {
            report.assume(written[free].line, AssumptionKind::FreeBase { joint, found });
            settled[free] = true;
        } else {
            let remedy =
                "only one that moves the whole hand may be so; use revolute and prismatic joints, or a fixed one";
            report.add(written[free].line, ProblemKind::JointType { name: joint, found, remedy });
        }
    }
}

/// Resolves the joints that follow others; `ranges` are those that the joints state.
pub(super) fn set_mimics(tree: &mut Tree, written: &[&Element], ranges: &[Option<[f64; 2]>], report: &mut Report<'_>) {
    for own in 0..written.len() {
        let Some(mimic) = written[own].child("mimic") else { continue };
        let joint = tree.joints[own].name.clone();
        if tree.joints[own].is_fixed() {
            report.assume(mimic.line, AssumptionKind::FixedFollower { joint });
            continue;
        }
        let why = match leader(tree, written, own) {
            Leader::Found(law) if tree.joints[law.joint].kind == tree.joints[own].kind => {
                follow(tree, own, law, ranges, mimic.line, report);
                continue;
            }
            Leader::Found(_) => "is of another kind",
            Leader::Cycle => "follows it in turn",
            // The first unknown name is a problem of the joint that has it.
            Leader::Unknown(at) if at != own => continue,
            Leader::Unknown(_) => {
                let name = mimic.attribute("joint").unwrap_or_default().to_owned();
                let known = tree.joints.iter().map(|joint| joint.name.clone()).collect();
                report.add(mimic.line, ProblemKind::Unknown { what: "joint", name, known });
                continue;
            }
        };
        let leader = mimic.attribute("joint").unwrap_or_default().to_owned();
        report.add(mimic.line, ProblemKind::BadMimic { name: joint, leader, why });
    }
}

/// The joint that leads another one.
enum Leader {
    /// An independent one, and how it is followed.
    Found(Mimic),
    /// The joints follow each other.
    Cycle,
    /// This joint follows one that does not exist.
    Unknown(usize),
}

/// Goes from a follower to the joint that leads all joints between them.
fn leader(tree: &Tree, written: &[&Element], own: usize) -> Leader {
    let (mut at, mut ratio, mut offset) = (own, 1.0, 0.0);
    for _ in 0..=written.len() {
        let Some(mimic) = written[at].child("mimic").filter(|_| !tree.joints[at].is_fixed()) else {
            return Leader::Found(Mimic { joint: at, ratio, offset });
        };
        let named = mimic.attribute("joint").unwrap_or_default();
        let Some(next) = tree.joints.iter().position(|joint| joint.name == named) else {
            return Leader::Unknown(at);
        };
        offset += ratio * mimic.number("offset", 0.0);
        ratio *= mimic.number("multiplier", 1.0);
        at = next;
    }
    Leader::Cycle
}

/// Makes a joint follow another one; the range of the leader decides where it goes.
fn follow(tree: &mut Tree, own: usize, law: Mimic, ranges: &[Option<[f64; 2]>], line: usize, report: &mut Report<'_>) {
    let [a, b] = tree.joints[law.joint].limits.map(|limit| law.ratio * limit + law.offset);
    let led = [a.min(b), a.max(b)];
    let (joint, leader) = (tree.joints[own].name.clone(), tree.joints[law.joint].name.clone());
    tree.joints[own].mimic = Some(law);
    if !led.iter().all(|end| end.abs() <= MAX_COORDINATE) {
        let ([lower, upper], quantity, must) = (led, "range to which it follows", "it must be within +-10");
        report.add(line, ProblemKind::Interval { item: "joint", name: joint, quantity, lower, upper, must });
        return;
    }
    let Some(limits) = ranges[own] else {
        report.assume(line, AssumptionKind::FollowerRange { joint, leader, reached: led });
        tree.joints[own].limits = led;
        return;
    };
    let excess = (limits[0] - led[0]).max(led[1] - limits[1]);
    if excess > ROUNDING {
        let reached = [limits[0].min(led[0]), limits[1].max(led[1])];
        tree.joints[own].limits = reached;
        if excess > WORTH_TELLING * (led[1] - led[0]) {
            report.assume(line, AssumptionKind::MimicRange { joint, leader, limits, reached });
        }
    }
}
