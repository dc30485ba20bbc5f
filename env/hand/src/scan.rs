//! A strict walk over the URDF's XML: numbers that are numbers, unique names, and the line of everything named.

use std::collections::BTreeMap;

use xml::reader::{EventReader, XmlEvent};

use crate::error::{Problem, ProblemKind};

/// Largest nesting depth; a URDF needs 5 (robot, link, collision, geometry, box).
const MAX_DEPTH: usize = 16;
/// Largest coordinate, angle or limit, in metres or radians: no hand is 10 m long.
const MAX_COORDINATE: f64 = 10.0;
/// Largest other number (mass in kg, effort, velocity, inertia): no hand weighs a tonne.
const MAX_NUMBER: f64 = 1000.0;

/// Lines of named elements, and which of them have the children that `urdf-rs` would otherwise default.
#[derive(Default)]
pub(crate) struct Scan {
    links: BTreeMap<String, usize>,
    joints: BTreeMap<String, usize>,
    /// `(link or joint, child element)` pairs that exist.
    children: BTreeMap<(String, String), usize>,
    pub colliders: BTreeMap<String, usize>,
}

/// Collects the problems of one file.
pub(crate) struct Report<'a> {
    pub file: &'a str,
    /// Problems so far.
    pub problems: Vec<Problem>,
}

impl Report<'_> {
    /// Records a problem at a line.
    pub fn add(&mut self, line: usize, kind: ProblemKind) {
        self.problems.push(Problem { file: self.file.to_owned(), line, kind });
    }
}

/// A message without line breaks.
pub(crate) fn one_line(text: &str) -> String {
    text.lines().map(str::trim).collect::<Vec<_>>().join("; ")
}

/// Walks the XML once: bounded depth, strict numbers, unique names, line of each link and joint.
pub(crate) fn scan(text: &str, report: &mut Report<'_>) -> Option<Scan> {
    if let Some(at) = text.find("<!DOCTYPE").or_else(|| text.find("<!ENTITY")) {
        report.add(1 + text[..at].matches('\n').count(), ProblemKind::Doctype);
        return None;
    }
    let mut scan = Scan::default();
    let mut owner: Option<String> = None;
    let mut depth = 0usize;
    let mut reader = EventReader::new(text.as_bytes());
    loop {
        let event = reader.next();
        let line = line_of(&reader);
        match event {
            Ok(XmlEvent::StartElement { name, attributes, .. }) => {
                depth += 1;
                if depth > MAX_DEPTH {
                    report.add(line, ProblemKind::TooDeep(MAX_DEPTH));
                    return None;
                }
                let element = name.local_name.as_str();
                let label = attributes.iter().find(|a| a.name.local_name == "name").map(|a| a.value.clone());
                match (depth, &owner) {
                    (2, _) => owner = scan.enter(element, label, line, report),
                    (3, Some(owner)) => scan.child(owner, element, label, line),
                    _ => {}
                }
                for attribute in &attributes {
                    check_attribute(element, &attribute.name.local_name, &attribute.value, line, report);
                }
            }
            Ok(XmlEvent::EndElement { .. }) => depth = depth.saturating_sub(1),
            Ok(XmlEvent::EndDocument) => return Some(scan),
            Ok(_) => {}
            Err(error) => {
                report.add(line, ProblemKind::Xml(one_line(error.msg())));
                return None;
            }
        }
    }
}

fn line_of(reader: &EventReader<&[u8]>) -> usize {
    use xml::common::Position;
    usize::try_from(reader.position().row).unwrap_or(usize::MAX).saturating_add(1)
}

impl Scan {
    /// Records a link or a joint; returns the key of its children.
    fn enter(&mut self, element: &str, name: Option<String>, line: usize, report: &mut Report<'_>) -> Option<String> {
        let (what, names) = match element {
            "link" => ("link", &mut self.links),
            "joint" => ("joint", &mut self.joints),
            _ => return None,
        };
        let Some(name) = name.filter(|n| !n.is_empty()) else {
            report.add(line, ProblemKind::Missing { item: what, name: String::new(), missing: "name" });
            return None;
        };
        if names.insert(name.clone(), line).is_some() {
            report.add(line, ProblemKind::Duplicate { what, name: name.clone() });
        }
        Some(format!("{what} {name}"))
    }

    /// Records a child element of a link or a joint.
    fn child(&mut self, owner: &str, element: &str, name: Option<String>, line: usize) {
        self.children.insert((owner.to_owned(), element.to_owned()), line);
        if let Some(name) = name.filter(|_| element == "collision") {
            self.colliders.insert(name, line);
        }
    }

    pub fn link_line(&self, name: &str) -> usize {
        self.links.get(name).copied().unwrap_or(1)
    }

    pub fn joint_line(&self, name: &str) -> usize {
        self.joints.get(name).copied().unwrap_or(1)
    }

    /// Line of a child element of a link or joint, where there is one.
    pub fn child_line(&self, what: &str, name: &str, child: &str) -> Option<usize> {
        self.children.get(&(format!("{what} {name}"), child.to_owned())).copied()
    }
}

/// Checks that all numbers are finite and within the bounds.
fn check_attribute(element: &str, attribute: &str, text: &str, line: usize, report: &mut Report<'_>) {
    let (count, limit) = match (element, attribute) {
        (_, "xyz" | "rpy" | "size") => (3, MAX_COORDINATE),
        (_, "radius" | "length" | "lower" | "upper") => (1, MAX_COORDINATE),
        ("mass", "value") => (1, MAX_NUMBER),
        ("inertia", _) | ("limit", _) | ("mimic", "multiplier" | "offset") => (1, MAX_NUMBER),
        _ => return,
    };
    let numbers: Vec<_> = text.split_whitespace().map(str::parse::<f64>).collect();
    let good = numbers.len() == count && numbers.iter().all(|n| n.as_ref().is_ok_and(|x| x.abs() <= limit));
    if !good {
        let text = text.chars().take(60).collect();
        report.add(line, ProblemKind::Attribute { attribute: attribute.to_owned(), text, count, limit });
    }
}
