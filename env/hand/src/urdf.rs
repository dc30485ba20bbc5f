//! Reads the URDF as other programs do, and says what it assumes where these guess; then links and joints in tree order.
//!
//! | module | purpose |
//! |---|---|
//! | `element` | the elements of the XML, with their lines |
//! | `links` | links with their collision shapes |
//! | `joints` | joints, their ranges, and those that follow others |
//! | `inertia` | masses and inertias |
//! | [`assumption`] | what is assumed |

pub mod assumption;
mod element;
mod inertia;
mod joints;
mod links;

use std::collections::BTreeMap;

use assumption::AssumptionKind;
use element::Element;
pub use links::MeshShape;

use crate::error::{ProblemKind, Report};
use crate::model::{Joint, Link};

/// Largest number of links: an image labels each, and the objects, by a byte.
const MAX_LINKS: usize = 192;
/// Largest number of moving joints; the largest real hands have about 40.
const MAX_JOINTS: usize = 64;
/// Largest number of colliders: about a hundred already slow a simulation down to some trials per second.
const MAX_COLLIDERS: usize = 1024;
/// Largest coordinate, angle or limit, in metres or radians: no hand is 10 m long.
const MAX_COORDINATE: f64 = 10.0;
/// Largest other number (mass in kg, inertia, ratio): no hand weighs a tonne.
const MAX_NUMBER: f64 = 1000.0;
/// Largest effort, speed or scale; programs write huge ones for "no limit".
const MAX_PLACEHOLDER: f64 = 1e12;

/// Links and joints in tree order, and the lines of their names.
pub(crate) struct Tree {
    /// Links, the base first, parents before children.
    pub links: Vec<Link>,
    /// Joint `i` moves link `i + 1`.
    pub joints: Vec<Joint>,
    /// Line of each joint, by its index.
    pub joint_lines: Vec<usize>,
    /// Shapes that are meshes; a sphere is in their place.
    pub meshes: Vec<MeshShape>,
    /// Bytes at which shapes beside meshes get a name, and these names.
    pub unnamed: Vec<(usize, String)>,
}

impl Tree {
    /// For each link the first link of its rigid body, if joints move as `moves` says.
    fn carriers_by(&self, moves: impl Fn(usize) -> bool) -> Vec<usize> {
        let mut carriers = vec![0; self.links.len()];
        for (index, joint) in self.joints.iter().enumerate() {
            carriers[joint.child] = if moves(index) { joint.child } else { carriers[joint.parent] };
        }
        carriers
    }

    /// For each link the first link of its rigid body.
    fn carriers(&self) -> Vec<usize> {
        self.carriers_by(|joint| !self.joints[joint].is_fixed())
    }
}

/// The links and joints of a file, in its order.
struct Parts<'e> {
    links: Vec<&'e Element>,
    joints: Vec<&'e Element>,
    /// Name of the elements that are collision shapes.
    shapes: &'static str,
}

/// Reads links and joints; `None` where problems prevent building a tree.
///
/// A tree with impossible numbers is returned too, so that the other file can be checked in the same run.
pub(crate) fn read(text: &str, report: &mut Report<'_>) -> Option<Tree> {
    let robot = element::parse(text, report)?;
    check_format(&robot, report)?;
    let parts = parts(&robot);
    check_names("link", &parts.links, report);
    check_names("joint", &parts.joints, report);
    parts.links.iter().for_each(|link| check_link(link, parts.shapes, report));
    parts.joints.iter().for_each(|joint| check_joint(joint, report));
    if !report.problems.is_empty() {
        return None;
    }
    check_counts(&parts, report);
    if !report.problems.is_empty() {
        return None;
    }
    if parts.shapes == "visual"
        && let Some(first) = parts.links.iter().find_map(|link| link.child("visual"))
    {
        report.assume(first.line, AssumptionKind::Visuals);
    }
    let order = tree_order(&parts, report)?;
    Some(build(&parts, &order, report))
}

/// Reads links and joints of a file with wrong numbers, as far as they can be read; `None` where no tree can be built.
pub(crate) fn read_anyway(text: &str) -> Option<Tree> {
    let mut ignored = Report::default();
    let robot = element::parse(text, &mut ignored)?;
    let parts = parts(&robot);
    let mut structure = Report::default();
    check_counts(&parts, &mut structure);
    if !structure.problems.is_empty() {
        return None;
    }
    let order = tree_order(&parts, &mut structure)?;
    Some(build(&parts, &order, &mut ignored))
}

/// The name of a link or a joint.
fn names_of(element: &Element) -> &str {
    element.attribute("name").unwrap_or_default()
}

fn parts(robot: &Element) -> Parts<'_> {
    let links: Vec<_> = robot.all("link").collect();
    let has = |element: &str| links.iter().any(|link| link.child(element).is_some());
    let shapes = if !has("collision") && has("visual") { "visual" } else { "collision" };
    Parts { joints: robot.all("joint").collect(), shapes, links }
}

/// Refuses files of other formats, with the program that reads them.
fn check_format(root: &Element, report: &mut Report<'_>) -> Option<()> {
    let macros = root.children.iter().find(|child| child.name.starts_with("xacro:"));
    let (line, what, remedy) = match (root.name.as_str(), macros) {
        ("robot", None) => return Some(()),
        ("robot", Some(first)) => (
            first.line,
            "the file is a xacro",
            "expand it: `xacro hand.urdf.xacro > hand.urdf`, or install graspbox[urdf], which does so",
        ),
        ("mujoco", _) => {
            let remedy = "`graspbox hand convert` makes the two files of a hand from it";
            (root.line, "the file is an MJCF file", remedy)
        }
        ("sdf", _) => (root.line, "the file is an SDF file", "give the URDF or the MJCF file of this hand"),
        (name, _) => {
            let what = format!("the file is no URDF: its root element is <{name}>");
            report.add(root.line, ProblemKind::OtherFormat { what, remedy: "a URDF has <robot>" });
            return None;
        }
    };
    report.add(line, ProblemKind::OtherFormat { what: what.to_owned(), remedy });
    None
}

/// Every link and joint has a name of its own.
fn check_names(what: &'static str, elements: &[&Element], report: &mut Report<'_>) {
    let mut names = BTreeMap::new();
    for element in elements {
        let name = names_of(element).to_owned();
        if name.is_empty() {
            report.add(element.line, ProblemKind::Missing { item: what, name, missing: "name" });
        } else if names.insert(name.clone(), element.line).is_some() {
            report.add(element.line, ProblemKind::Duplicate { what, name });
        }
    }
}

fn check_link(link: &Element, shapes: &str, report: &mut Report<'_>) {
    for child in link.children.iter().filter(|child| child.name == "inertial" || child.name == shapes) {
        check_numbers(child, report);
    }
    check_once("link", link, &["inertial"], report);
}

fn check_joint(joint: &Element, report: &mut Report<'_>) {
    const READ: [&str; 4] = ["origin", "axis", "limit", "mimic"];
    let continuous = joint.attribute("type") == Some("continuous");
    // The range of a joint that turns without end is not read unless it is one.
    let read = |child: &&Element| READ.contains(&child.name.as_str()) && !(continuous && child.name == "limit");
    joint.children.iter().filter(read).for_each(|child| check_numbers(child, report));
    check_once("joint", joint, &["origin", "parent", "child", "axis", "limit", "mimic"], report);
}

/// Elements of which others than the first are not used.
fn check_once(item: &'static str, owner: &Element, elements: &[&'static str], report: &mut Report<'_>) {
    for element in elements {
        if let Some(second) = owner.all(element).nth(1) {
            report.assume(second.line, AssumptionKind::Twice { item, name: names_of(owner).to_owned(), element });
        }
    }
}

/// Checks that all numbers of an element, and of those in it, are finite and within the bounds.
fn check_numbers(element: &Element, report: &mut Report<'_>) {
    for (attribute, text) in element.attributes() {
        let (count, limit) = match (element.name.as_str(), attribute) {
            (_, "xyz" | "rpy" | "size") => (3, MAX_COORDINATE),
            ("mesh", "scale") => (3, MAX_PLACEHOLDER),
            ("limit", "effort" | "velocity") => (1, MAX_PLACEHOLDER),
            (_, "radius" | "length" | "lower" | "upper") => (1, MAX_COORDINATE),
            ("mass", "value") | ("inertia", _) | ("mimic", "multiplier" | "offset") => (1, MAX_NUMBER),
            _ => continue,
        };
        let numbers: Vec<_> = text.split_whitespace().map(str::parse::<f64>).collect();
        let good = numbers.len() == count && numbers.iter().all(|n| n.as_ref().is_ok_and(|x| x.abs() <= limit));
        if !good {
            let text = text.chars().take(60).collect();
            report.add(element.line, ProblemKind::Attribute { attribute: attribute.to_owned(), text, count, limit });
        }
    }
    element.children.iter().for_each(|child| check_numbers(child, report));
}

fn check_counts(parts: &Parts<'_>, report: &mut Report<'_>) {
    let colliders = parts.links.iter().map(|link| link.all(parts.shapes).count()).sum();
    let moving = parts.joints.iter().filter(|joint| joint.attribute("type") != Some("fixed")).count();
    for (what, count, limit) in [
        ("links", parts.links.len(), MAX_LINKS),
        ("joints", parts.joints.len(), MAX_LINKS),
        ("moving joints", moving, MAX_JOINTS),
        ("collision shapes", colliders, MAX_COLLIDERS),
    ] {
        if count > limit {
            report.add(1, ProblemKind::TooMany { what, count, limit });
        }
    }
}

/// For each link in tree order (depth first, in the order of the file): its index in the file and that of its parent joint.
type Order = Vec<(usize, Option<usize>)>;

fn tree_order(parts: &Parts<'_>, report: &mut Report<'_>) -> Option<Order> {
    let count = parts.links.len();
    let index: BTreeMap<&str, usize> = parts.links.iter().enumerate().map(|(i, link)| (names_of(link), i)).collect();
    let mut parent_joint = vec![None; count];
    let mut children = vec![Vec::new(); count];
    for (j, joint) in parts.joints.iter().enumerate() {
        let [Some(parent), Some(child)] = ["parent", "child"].map(|end| link_of(joint, end, &index, parts, report))
        else {
            continue;
        };
        if parent_joint[child].replace(j).is_some() {
            report.add(joint.line, ProblemKind::TwoParents(names_of(parts.links[child]).to_owned()));
        }
        children[parent].push((j, child));
    }
    let Some(root) = parent_joint.iter().position(Option::is_none) else {
        report.add(1, if count == 0 { ProblemKind::Empty("links") } else { ProblemKind::NoRoot });
        return None;
    };
    if !report.problems.is_empty() {
        return None;
    }
    let mut order = Vec::with_capacity(count);
    let mut seen = vec![false; count];
    let mut stack = vec![(root, None)];
    while let Some((link, joint)) = stack.pop() {
        seen[link] = true;
        order.push((link, joint));
        stack.extend(children[link].iter().rev().map(|&(j, child)| (child, Some(j))));
    }
    for (link, _) in parts.links.iter().zip(&seen).filter(|(_, seen)| !**seen) {
        report.add(link.line, ProblemKind::Unreachable(names_of(link).to_owned()));
    }
    report.problems.is_empty().then_some(order)
}

/// The link at one end of a joint.
fn link_of(
    joint: &Element,
    end: &'static str,
    index: &BTreeMap<&str, usize>,
    parts: &Parts<'_>,
    report: &mut Report<'_>,
) -> Option<usize> {
    let Some(name) = joint.child(end).and_then(|element| element.attribute("link")) else {
        let kind = ProblemKind::Missing { item: "joint", name: names_of(joint).to_owned(), missing: end };
        report.add(joint.line, kind);
        return None;
    };
    let found = index.get(name).copied();
    if found.is_none() {
        let known = parts.links.iter().map(|link| names_of(link).to_owned()).collect();
        report.add(joint.line, ProblemKind::Unknown { what: "link", name: name.to_owned(), known });
    }
    found
}

fn build(parts: &Parts<'_>, order: &Order, report: &mut Report<'_>) -> Tree {
    let position: BTreeMap<&str, usize> =
        order.iter().enumerate().map(|(i, &(l, _))| (names_of(parts.links[l]), i)).collect();
    let mut shapes = links::ShapeReader::new(parts.shapes, report);
    let links: Vec<Link> = order.iter().map(|&(link, _)| shapes.link(parts.links[link])).collect();
    let (meshes, unnamed) = (shapes.meshes, shapes.unnamed);
    let mut tree = Tree { links, joints: Vec::new(), joint_lines: Vec::new(), meshes, unnamed };
    let inertials: Vec<_> =
        order.iter().map(|&(l, _)| inertia::read(parts.links[l], names_of(parts.links[l]), report)).collect();
    let (mut written, mut ranges) = (Vec::new(), Vec::new());
    for (child, joint) in order.iter().enumerate().filter_map(|(i, &(_, joint))| Some((i, parts.joints[joint?]))) {
        let parent = joint.child("parent").and_then(|parent| parent.attribute("link"));
        let parent = parent.and_then(|name| position.get(name).copied()).unwrap_or(0);
        let (read, range) = joints::read(joint, parent, child, report);
        tree.joints.push(read);
        tree.joint_lines.push(joint.line);
        written.push(joint);
        ranges.push(range);
    }
    joints::settle_free(&tree, &written, report);
    joints::set_mimics(&mut tree, &written, &ranges, report);
    inertia::set(&mut tree, &inertials, report);
    tree
}
