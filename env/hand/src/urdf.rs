//! Reads the URDF: strict scan with line numbers, then `urdf-rs`, then links and joints in tree order.
//!
//! `urdf-rs` is too lenient (it skips a bad token in a vector and defaults missing limits and masses to 0)
//! and does not keep line numbers; the scan before it reports both.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Matrix3, Point3, Translation3, Unit, UnitQuaternion, Vector3};
use urdf_rs::{Geometry, JointType};

use crate::error::ProblemKind;
use crate::model::{Collider, Joint, JointKind, Link, Material, Mimic, Shape};
use crate::scan::{Report, Scan, one_line, scan};

/// Largest number of links; the largest real hands have about 30.
const MAX_LINKS: usize = 64;
/// Largest number of colliders.
const MAX_COLLIDERS: usize = 256;

/// Links and joints in tree order, and the lines of their names.
pub(crate) struct Tree {
    /// Links, the base first, parents before children.
    pub links: Vec<Link>,
    /// Joint `i` moves link `i + 1`.
    pub joints: Vec<Joint>,
    /// Line of each joint, by its index.
    pub joint_lines: Vec<usize>,
}

/// Reads links and joints; `None` where problems prevent building a tree.
///
/// A tree with invalid numbers is returned too, so that the other file can be checked in the same run.
pub(crate) fn read(text: &str, report: &mut Report<'_>) -> Option<Tree> {
    let scan = scan(text, report)?;
    if !report.problems.is_empty() {
        return None;
    }
    let robot = match urdf_rs::read_from_string(text) {
        Ok(robot) => robot,
        Err(error) => {
            report.add(1, ProblemKind::Urdf(one_line(&error.to_string())));
            return None;
        }
    };
    check_counts(&robot, report);
    if !report.problems.is_empty() {
        return None;
    }
    let order = tree_order(&robot, &scan, report)?;
    Some(build(&robot, &order, &scan, report))
}

/// Reads links and joints of a file with wrong numbers, as far as they can be read; `None` where no tree can be built.
pub(crate) fn read_anyway(text: &str) -> Option<Tree> {
    let mut ignored = Report { file: "", problems: Vec::new() };
    let scan = scan(text, &mut ignored)?;
    let robot = urdf_rs::read_from_string(text).ok()?;
    let mut structure = Report { file: "", problems: Vec::new() };
    check_counts(&robot, &mut structure);
    let order = tree_order(&robot, &scan, &mut structure)?;
    Some(build(&robot, &order, &scan, &mut ignored))
}

fn check_counts(robot: &urdf_rs::Robot, report: &mut Report<'_>) {
    let colliders = robot.links.iter().map(|l| l.collision.len()).sum();
    for (what, count, limit) in [
        ("links", robot.links.len(), MAX_LINKS),
        ("joints", robot.joints.len(), MAX_LINKS),
        ("collision shapes", colliders, MAX_COLLIDERS),
    ] {
        if count > limit {
            report.add(1, ProblemKind::TooMany { what, count, limit });
        }
    }
}

/// For each link in tree order (depth first, in the order of the file): its index in the file and that of its parent joint.
fn tree_order(robot: &urdf_rs::Robot, scan: &Scan, report: &mut Report<'_>) -> Option<Vec<(usize, Option<usize>)>> {
    let index: BTreeMap<&str, usize> = robot.links.iter().enumerate().map(|(i, l)| (l.name.as_str(), i)).collect();
    let mut parent_joint = vec![None; robot.links.len()];
    let mut children = vec![Vec::new(); robot.links.len()];
    for (j, joint) in robot.joints.iter().enumerate() {
        let line = scan.joint_line(&joint.name);
        let ends = [&joint.parent.link, &joint.child.link].map(|name| {
            let found = index.get(name.as_str()).copied();
            if found.is_none() {
                let known = robot.links.iter().map(|l| l.name.clone()).collect();
                report.add(line, ProblemKind::Unknown { what: "link", name: name.clone(), known });
            }
            found
        });
        let [Some(parent), Some(child)] = ends else {
            continue;
        };
        if parent_joint[child].replace(j).is_some() {
            report.add(line, ProblemKind::TwoParents(joint.child.link.clone()));
        }
        children[parent].push((j, child));
    }
    let Some(root) = parent_joint.iter().position(Option::is_none) else {
        report.add(1, if robot.links.is_empty() { ProblemKind::Empty("links") } else { ProblemKind::NoRoot });
        return None;
    };
    if !report.problems.is_empty() {
        return None;
    }
    let mut order = Vec::with_capacity(robot.links.len());
    let mut seen = vec![false; robot.links.len()];
    let mut stack = vec![(root, None)];
    while let Some((link, joint)) = stack.pop() {
        seen[link] = true;
        order.push((link, joint));
        stack.extend(children[link].iter().rev().map(|&(j, child)| (child, Some(j))));
    }
    for (link, _) in robot.links.iter().zip(&seen).filter(|(_, seen)| !**seen) {
        report.add(scan.link_line(&link.name), ProblemKind::Unreachable(link.name.clone()));
    }
    report.problems.is_empty().then_some(order)
}

fn build(robot: &urdf_rs::Robot, order: &[(usize, Option<usize>)], scan: &Scan, report: &mut Report<'_>) -> Tree {
    let position: BTreeMap<&str, usize> =
        order.iter().enumerate().map(|(i, &(l, _))| (robot.links[l].name.as_str(), i)).collect();
    let mut names = BTreeMap::new();
    let mut tree = Tree { links: Vec::new(), joints: Vec::new(), joint_lines: Vec::new() };
    for (i, &(l, joint)) in order.iter().enumerate() {
        tree.links.push(read_link(&robot.links[l], scan, &mut names, report));
        if let Some(j) = joint {
            let joint = &robot.joints[j];
            let parent = position.get(joint.parent.link.as_str()).copied().unwrap_or(0);
            tree.joints.push(read_joint(joint, parent, i, scan, report));
            tree.joint_lines.push(scan.joint_line(&joint.name));
        }
    }
    set_mimics(robot, &mut tree, scan, report);
    tree
}

/// Resolves the joints that follow others; a joint follows an independent one of the same kind.
fn set_mimics(robot: &urdf_rs::Robot, tree: &mut Tree, scan: &Scan, report: &mut Report<'_>) {
    let followers = robot.joints.iter().filter_map(|joint| joint.mimic.as_ref().map(|mimic| (joint, mimic)));
    for (joint, mimic) in followers {
        let line = scan.child_line("joint", &joint.name, "mimic").unwrap_or_else(|| scan.joint_line(&joint.name));
        let find = |name: &str| tree.joints.iter().position(|j| j.name == name);
        let Some(own) = find(&joint.name) else { continue };
        let Some(leader) = find(&mimic.joint) else {
            let known = tree.joints.iter().map(|j| j.name.clone()).collect();
            report.add(line, ProblemKind::Unknown { what: "joint", name: mimic.joint.clone(), known });
            continue;
        };
        let follows = robot.joints.iter().any(|j| j.name == mimic.joint && j.mimic.is_some());
        let why = match (tree.joints[own].kind, tree.joints[leader].kind) {
            (JointKind::Fixed, _) => "a fixed joint cannot follow",
            _ if follows || own == leader => "follows a joint itself; name the one that leads both",
            (a, b) if a != b => "is of another kind",
            _ => {
                let (ratio, offset) = (mimic.multiplier.unwrap_or(1.0), mimic.offset.unwrap_or(0.0));
                follow(tree, own, Mimic { joint: leader, ratio, offset }, line, report);
                continue;
            }
        };
        let (name, leader) = (joint.name.clone(), mimic.joint.clone());
        report.add(line, ProblemKind::BadMimic { name, leader, why });
    }
}

fn isometry(pose: &urdf_rs::Pose) -> Isometry3<f64> {
    let [r, p, y] = *pose.rpy;
    Isometry3::from_parts(Translation3::from(Vector3::from(*pose.xyz)), UnitQuaternion::from_euler_angles(r, p, y))
}

fn read_link(link: &urdf_rs::Link, scan: &Scan, names: &mut BTreeMap<String, usize>, report: &mut Report<'_>) -> Link {
    let line = scan.child_line("link", &link.name, "inertial");
    if line.is_none() {
        let missing = "inertial";
        report.add(scan.link_line(&link.name), ProblemKind::Missing { item: "link", name: link.name.clone(), missing });
    }
    let line = line.unwrap_or_else(|| scan.link_line(&link.name));
    let mass = link.inertial.mass.value;
    let mut value = |quantity, value, must| {
        report.add(line, ProblemKind::Value { item: "link", name: link.name.clone(), quantity, value, must });
    };
    if mass <= 0.0 {
        value("mass", mass, "greater than 0 kg");
    }
    let i = &link.inertial.inertia;
    let own = Matrix3::new(i.ixx, i.ixy, i.ixz, i.ixy, i.iyy, i.iyz, i.ixz, i.iyz, i.izz);
    let moments = own.symmetric_eigenvalues();
    if moments.min() <= 0.0 {
        value("least principal moment of inertia", moments.min(), "greater than 0 kg m2");
    } else if moments.sum() < 2.0 * moments.max() * (1.0 - 1e-3) {
        value("greatest principal moment of inertia", moments.max(), "at most the sum of the other two");
    }
    let pose = isometry(&link.inertial.origin);
    let turn = pose.rotation.to_rotation_matrix();
    let colliders = link.collision.iter().enumerate().map(|(n, c)| read_collider(link, n, c, scan, names, report));
    Link {
        name: link.name.clone(),
        mass,
        center_of_mass: Point3::from(pose.translation.vector),
        inertia: turn.matrix() * own * turn.matrix().transpose(),
        colliders: colliders.collect(),
    }
}

fn read_collider(
    link: &urdf_rs::Link,
    number: usize,
    collision: &urdf_rs::Collision,
    scan: &Scan,
    names: &mut BTreeMap<String, usize>,
    report: &mut Report<'_>,
) -> Collider {
    let name = collision.name.clone().unwrap_or_else(|| format!("{}_{number}", link.name));
    let line = scan.colliders.get(&name).copied().unwrap_or_else(|| scan.link_line(&link.name));
    if names.insert(name.clone(), line).is_some() {
        report.add(line, ProblemKind::Duplicate { what: "collider", name: name.clone() });
    }
    let shape = match &collision.geometry {
        Geometry::Box { size } => Shape::Cuboid(Vector3::from(**size) / 2.0),
        Geometry::Cylinder { radius, length } => Shape::Cylinder { radius: *radius, half_length: length / 2.0 },
        Geometry::Sphere { radius } => Shape::Sphere { radius: *radius },
        Geometry::Capsule { radius, .. } => {
            report.add(line, ProblemKind::Capsule { name: name.clone() });
            Shape::Sphere { radius: *radius }
        }
        Geometry::Mesh { filename, .. } => {
            report.add(line, ProblemKind::CollisionMesh { name: name.clone(), file: filename.clone() });
            Shape::Sphere { radius: 1.0 }
        }
    };
    let least = match shape {
        Shape::Cuboid(half) => half.min(),
        Shape::Cylinder { radius, half_length } => radius.min(half_length),
        Shape::Sphere { radius } => radius,
    };
    if least <= 0.0 {
        let must = "greater than 0 m";
        let kind =
            ProblemKind::Value { item: "collider", name: name.clone(), quantity: "least size", value: least, must };
        report.add(line, kind);
    }
    Collider { name, shape, link_from_shape: isometry(&collision.origin), material: Material::Bare }
}

fn read_joint(joint: &urdf_rs::Joint, parent: usize, child: usize, scan: &Scan, report: &mut Report<'_>) -> Joint {
    let line = scan.joint_line(&joint.name);
    let name = || joint.name.clone();
    let kind = match joint.joint_type {
        JointType::Fixed => JointKind::Fixed,
        JointType::Revolute => JointKind::Revolute,
        JointType::Prismatic => JointKind::Prismatic,
        ref other => {
            let found = format!("{other:?}").to_lowercase();
            report.add(line, ProblemKind::JointType { name: name(), found });
            JointKind::Fixed
        }
    };
    let fixed = kind == JointKind::Fixed;
    let mut limits = [0.0; 2];
    if !fixed {
        limits = [joint.limit.lower, joint.limit.upper];
        let line = scan.child_line("joint", &joint.name, "limit");
        if line.is_none() {
            report.add(
                scan.joint_line(&joint.name),
                ProblemKind::Missing { item: "joint", name: name(), missing: "limit" },
            );
        } else if limits[0] >= limits[1] {
            let must = "the upper end must be greater";
            let [lower, upper] = limits;
            let kind = ProblemKind::Interval { item: "joint", name: name(), quantity: "limit", lower, upper, must };
            report.add(line.unwrap_or(1), kind);
        }
    }
    let xyz = Vector3::from(*joint.axis.xyz);
    let axis = Unit::try_new(xyz, 1e-6).unwrap_or_else(|| {
        if !fixed {
            let line = scan.child_line("joint", &joint.name, "axis").unwrap_or(line);
            let must = "longer than 0";
            let value = xyz.norm();
            report.add(line, ProblemKind::Value { item: "joint", name: name(), quantity: "axis length", value, must });
        }
        Vector3::x_axis()
    });
    Joint {
        name: name(),
        kind,
        parent,
        child,
        parent_from_joint: isometry(&joint.origin),
        axis,
        limits,
        effort: joint.limit.effort,
        velocity: joint.limit.velocity,
        mimic: None,
        stiffness: 0.0,
        spring_reference: 0.0,
        damping: 0.0,
        armature: 0.0,
        stop_stiffness: 0.0,
    }
}

/// Makes a joint follow another one, whose whole range it must reach.
fn follow(tree: &mut Tree, own: usize, mimic: Mimic, line: usize, report: &mut Report<'_>) {
    /// Rounding of limits that were written with few digits, rad or m.
    const ROUNDING: f64 = 1e-9;
    let [lower, upper] = tree.joints[own].limits;
    let led = tree.joints[mimic.joint].limits.map(|limit| mimic.ratio * limit + mimic.offset);
    if led.iter().any(|position| !(lower - ROUNDING..=upper + ROUNDING).contains(position)) {
        let (name, quantity) = (tree.joints[own].name.clone(), "limit");
        let must = "it must hold every position to which it follows";
        report.add(line, ProblemKind::Interval { item: "joint", name, quantity, lower, upper, must });
    }
    tree.joints[own].mimic = Some(mimic);
}
