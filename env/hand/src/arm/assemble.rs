//! Combines the two files of an arm: cuts the tree at base and flange, resolves names, checks numbers.

use std::collections::BTreeSet;

use toml::Spanned;

use super::table::{ArmTable, LimitTable, SlowingTable};
use super::{Arm, Axis, Mount, Slowing};
use crate::assemble::{find, pose};
use crate::error::{ProblemKind, Report};
use crate::model::{Joint, JointKind, Link};
use crate::table::Reader;
use crate::urdf::Tree;
use crate::urdf::assumption::AssumptionKind;

/// Largest number of axes, of tables of limits, and of mounts.
const MAX_AXES: usize = 12;
const MAX_TABLES: usize = 64;

/// Units of the numbers of an axis.
struct Units {
    position: &'static str,
    speed: &'static str,
    acceleration: &'static str,
    jerk: &'static str,
}

fn units(kind: JointKind) -> Units {
    match kind {
        JointKind::Fixed | JointKind::Revolute => {
            Units { position: "rad", speed: "rad/s", acceleration: "rad/s2", jerk: "rad/s3" }
        }
        JointKind::Prismatic => Units { position: "m", speed: "m/s", acceleration: "m/s2", jerk: "m/s3" },
    }
}

/// Builds the arm and records every problem; the result may be used only if there are none.
///
/// `None` where names cannot be resolved.
pub(super) fn assemble<'a>(
    tree: Tree,
    table: &ArmTable,
    toml: &'a str,
    links: &mut Report<'_>,
    tables: &mut Report<'a>,
) -> Option<Arm> {
    let mut reader = Reader::new(toml, tables);
    let (limits, slowing, mounts) = (table.limits.len(), table.slowing.len(), table.mounts.len());
    for (what, count) in [("tables of limits", limits), ("tables of slowing", slowing), ("mounts", mounts)] {
        if count > MAX_TABLES {
            reader.add(&table.name, ProblemKind::TooMany { what, count, limit: MAX_TABLES });
            return None;
        }
    }
    let base = find(&table.base, "link", tree.links.iter().map(|l| &l.name), &mut reader);
    let flange = find(&table.flange, "link", tree.links.iter().map(|l| &l.name), &mut reader)?;
    let (parts, chain) = cut(tree, base?, flange, &table.flange, links, &mut reader)?;
    let mut arm = Arm {
        name: table.name.get_ref().clone(),
        flange: parts.flange,
        links: parts.links,
        joints: parts.joints,
        axes: Vec::new(),
        payload: reader.positive(("arm", table.name.get_ref()), "payload", &table.payload, "kg"),
        mounts: Vec::new(),
        assumptions: Vec::new(),
    };
    arm.axes = axes(&mut arm, &chain, table, &parts.lines, links, &mut reader)?;
    for (name, mount) in &table.mounts {
        let flange_from_mount = pose(&mount.xyz, &mount.rpy, &mut reader);
        arm.mounts.push(Mount { hand: name.get_ref().clone(), flange_from_mount });
    }
    Some(arm)
}

/// The part of a tree that is the arm.
struct Parts {
    links: Vec<Link>,
    joints: Vec<Joint>,
    /// Line of each joint.
    lines: Vec<usize>,
    flange: usize,
}

/// Keeps the links from base to flange, and what is fixed to them; also returns the moving joints between base and flange, in this order.
fn cut(
    tree: Tree,
    base: usize,
    flange: usize,
    name: &Spanned<String>,
    links: &mut Report<'_>,
    reader: &mut Reader<'_, '_>,
) -> Option<(Parts, Vec<usize>)> {
    let mut path = BTreeSet::from([base]);
    let mut at = flange;
    while at != base {
        path.insert(at);
        let Some(joint) = at.checked_sub(1) else {
            let (flange, base) = (name.get_ref().clone(), tree.links[base].name.clone());
            reader.add(name, ProblemKind::NotBeyond { flange, base });
            return None;
        };
        at = tree.joints[joint].parent;
    }
    let mut kept = vec![None; tree.links.len()];
    let (mut kept_links, mut joints, mut lines) = (Vec::new(), Vec::new(), Vec::new());
    let before = tree.joints;
    for (index, link) in tree.links.into_iter().enumerate() {
        let joint = index.checked_sub(1).map(|joint| &before[joint]);
        let parent = joint.and_then(|joint| kept[joint.parent]);
        let fixed = joint.is_some_and(|joint| joint.is_fixed() && joint.parent != flange);
        if path.contains(&index) || (parent.is_some() && fixed) {
            kept[index] = Some(kept_links.len());
            if let (Some(joint), Some(parent), true) = (joint, parent, index != base) {
                joints.push(Joint { parent, child: kept_links.len(), mimic: joint.mimic, ..joint.clone() });
                lines.push(tree.joint_lines[index - 1]);
            }
            kept_links.push(link);
        } else if let (Some(_), Some(joint)) = (parent, joint) {
            let (link, joint) = (link.name, joint.name.clone());
            links.assume(tree.joint_lines[index - 1], AssumptionKind::LeftOut { link, joint });
        }
    }
    let parts = Parts { flange: kept[flange]?, links: kept_links, joints, lines };
    let on_path: BTreeSet<usize> = path.iter().filter_map(|link| kept[*link]).collect();
    let chain =
        (0..parts.joints.len()).filter(|j| on_path.contains(&(j + 1)) && !parts.joints[*j].is_fixed()).collect();
    Some((parts, chain))
}

/// The axes, with the limits that the tables set and the positions at home.
fn axes(
    arm: &mut Arm,
    chain: &[usize],
    table: &ArmTable,
    lines: &[usize],
    links: &mut Report<'_>,
    reader: &mut Reader<'_, '_>,
) -> Option<Vec<Axis>> {
    if chain.is_empty() {
        reader.add(&table.flange, ProblemKind::Empty("moving joints between base and flange"));
        return None;
    }
    if chain.len() > MAX_AXES {
        let (what, count) = ("moving joints between base and flange", chain.len());
        reader.add(&table.flange, ProblemKind::TooMany { what, count, limit: MAX_AXES });
        return None;
    }
    for &joint in chain {
        if arm.joints[joint].mimic.is_some() {
            let name = arm.joints[joint].name.clone();
            links.add(lines[joint], ProblemKind::AxisFollows { name });
        }
    }
    let mut axes: Vec<Axis> = chain
        .iter()
        .map(|&joint| {
            let speed = arm.joints[joint].velocity;
            Axis { joint, speed, acceleration: None, jerk: None, slowing: None, home: f64::NAN }
        })
        .collect();
    let mut used = vec![false; axes.len()];
    for (name, limits) in &table.limits {
        set_limits(arm, &mut axes, &mut used, name, limits, reader)?;
    }
    for (name, slowing) in &table.slowing {
        set_slowing(arm, &mut axes, name, slowing, reader)?;
    }
    for (axis, &joint) in axes.iter().zip(chain) {
        if axis.speed <= 0.0 {
            let name = arm.joints[joint].name.clone();
            links.add(lines[joint], ProblemKind::NoSpeed { name });
        }
    }
    set_home(arm, &mut axes, table, reader)?;
    Some(axes)
}

fn set_limits(
    arm: &mut Arm,
    axes: &mut [Axis],
    used: &mut [bool],
    name: &Spanned<String>,
    limits: &LimitTable,
    reader: &mut Reader<'_, '_>,
) -> Option<()> {
    let own = std::slice::from_ref(name);
    for joint in limits.names.as_deref().unwrap_or(own) {
        let index = find_axis(arm, axes, joint, reader)?;
        if std::mem::replace(&mut used[index], true) {
            let name = joint.get_ref().clone();
            reader.add(joint, ProblemKind::UsedTwice { what: "joint", name, by: "[limits]" });
        }
        let item = ("joint", joint.get_ref().as_str());
        let axis = &mut axes[index];
        let units = units(arm.joints[axis.joint].kind);
        if let Some(position) = &limits.position {
            arm.joints[axis.joint].limits = reader.interval(item, "position", position, units.position);
        }
        if let Some(speed) = &limits.speed {
            axis.speed = reader.positive(item, "speed", speed, units.speed);
        }
        let positive = |number: &Option<_>, quantity, unit, reader: &mut Reader<'_, '_>| {
            number.as_ref().map(|number| reader.positive(item, quantity, number, unit))
        };
        axis.acceleration = positive(&limits.acceleration, "acceleration", units.acceleration, reader);
        axis.jerk = positive(&limits.jerk, "jerk", units.jerk, reader);
    }
    Some(())
}

/// Sets how a joint slows down, and leaves out the ends of its range in which it could hardly move.
fn set_slowing(
    arm: &mut Arm,
    axes: &mut [Axis],
    name: &Spanned<String>,
    slowing: &SlowingTable,
    reader: &mut Reader<'_, '_>,
) -> Option<()> {
    let axis = &mut axes[find_axis(arm, axes, name, reader)?];
    let (item, joint) = (("joint", name.get_ref().as_str()), &mut arm.joints[axis.joint]);
    let units = units(joint.kind);
    let found = Slowing {
        ends: reader.interval(item, "ends", &slowing.ends, units.position),
        rate: reader.positive(item, "rate", &slowing.rate, units.acceleration),
        offset: reader.not_negative(item, "offset", &slowing.offset, units.speed),
    };
    let [lower, upper] = found.usable(joint.limits);
    if lower < upper {
        joint.limits = [lower, upper];
    } else if found.rate > 0.0 && found.ends[0] < found.ends[1] {
        let (name, must) = (name.get_ref().clone(), "the joint must be able to move between them");
        let [lower, upper] = found.ends;
        reader.add(&slowing.ends, ProblemKind::Interval { item: "joint", name, quantity: "ends", lower, upper, must });
    }
    axis.slowing = Some(found);
    Some(())
}

fn set_home(arm: &Arm, axes: &mut [Axis], table: &ArmTable, reader: &mut Reader<'_, '_>) -> Option<()> {
    for (name, number) in &table.home {
        let index = find_axis(arm, axes, name, reader)?;
        let joint = &arm.joints[axes[index].joint];
        let home = reader.value("home", number, units(joint.kind).position);
        let [lower, upper] = joint.limits;
        if !(lower..=upper).contains(&home) && lower < upper {
            let name = joint.name.clone();
            reader.add(number, ProblemKind::HomeBeyond { name, home, lower, upper });
        }
        axes[index].home = home;
    }
    for axis in axes.iter().filter(|axis| axis.home.is_nan()) {
        let name = arm.joints[axis.joint].name.clone();
        reader.add(&table.name, ProblemKind::Missing { item: "joint", name, missing: "position in [home]" });
    }
    Some(())
}

/// Index of the axis of a joint's name.
fn find_axis(arm: &Arm, axes: &[Axis], name: &Spanned<String>, reader: &mut Reader<'_, '_>) -> Option<usize> {
    find(name, "joint between base and flange", axes.iter().map(|axis| &arm.joints[axis.joint].name), reader)
}
