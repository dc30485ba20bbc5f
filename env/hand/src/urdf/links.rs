//! Links: their collision shapes, and the meshes that primitives must replace.

use std::collections::BTreeMap;
use std::ops::Range;

use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};

use super::assumption::AssumptionKind;
use super::element::Element;
use super::names_of;
use crate::error::{ProblemKind, Report};
use crate::model::{Collider, Link, Material, Shape};

/// A collision shape that is a mesh: primitives must replace it before a hand is made.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshShape {
    /// Name of the collider.
    pub name: String,
    /// Line of its `<mesh>`, from 1.
    pub line: usize,
    /// `filename`, as written.
    pub file: String,
    /// Factor of the coordinates in the file along each of its axes.
    pub scale: [f64; 3],
    /// Pose of the file's frame in that of the link.
    pub link_from_mesh: Isometry3<f64>,
    /// Name of its element: `collision`, or `visual` where no link has collision shapes.
    pub element: String,
    /// Bytes of this element in the text.
    pub span: Range<usize>,
}

/// Reads the shapes of a hand's links.
pub(super) struct ShapeReader<'a, 'r> {
    /// Name of the elements of collision shapes.
    pub element: &'static str,
    /// Lines of the names so far.
    names: BTreeMap<String, usize>,
    pub meshes: Vec<MeshShape>,
    /// Where an element of a link with meshes gets a name, and this name: its number changes with the shapes before it.
    pub unnamed: Vec<(usize, String)>,
    report: &'r mut Report<'a>,
}

impl<'a, 'r> ShapeReader<'a, 'r> {
    pub fn new(element: &'static str, report: &'r mut Report<'a>) -> Self {
        Self { element, names: BTreeMap::new(), meshes: Vec::new(), unnamed: Vec::new(), report }
    }

    /// A link with its shapes; mass and inertia are set later.
    pub fn link(&mut self, link: &Element) -> Link {
        let name = names_of(link);
        let (mut colliders, mut unnamed, before) = (Vec::new(), Vec::new(), self.meshes.len());
        for (number, written) in link.all(self.element).enumerate() {
            let chosen = self.name(written, format!("{name}_{number}"));
            if written.attribute("name").is_none() {
                unnamed.push((written.span.start + 1 + written.name.len(), chosen.clone()));
            }
            self.shapes(&chosen, written, &mut colliders);
        }
        if self.meshes.len() > before {
            self.unnamed.append(&mut unnamed);
        }
        let (center_of_mass, inertia) = (Point3::origin(), Matrix3::zeros());
        Link { name: name.to_owned(), mass: 0.0, center_of_mass, inertia, colliders }
    }

    /// Its own name, with a number if other shapes have it: programs write one name for all.
    fn name(&mut self, written: &Element, default: String) -> String {
        let own = written.attribute("name").filter(|own| !own.is_empty());
        let numbered = |own: &str| (2..).map(|number| format!("{own}_{number}")).find(|name| !self.is_taken(name));
        let name = match own {
            Some(own) if self.is_taken(own) => numbered(own).unwrap_or(default),
            Some(own) => own.to_owned(),
            None => default,
        };
        if self.names.insert(name.clone(), written.line).is_some() {
            self.report.add(written.line, ProblemKind::Duplicate { what: "collider", name: name.clone() });
        }
        name
    }

    /// Whether a shape has a name, or is one of several, NAME.0, NAME.1, ..., in place of a mesh of this name.
    fn is_taken(&self, name: &str) -> bool {
        self.names.contains_key(name) || self.names.contains_key(&format!("{name}.0"))
    }

    fn shapes(&mut self, name: &str, written: &Element, colliders: &mut Vec<Collider>) {
        let place = isometry(written);
        let known = |shape: &&Element| ["box", "cylinder", "sphere", "capsule", "mesh"].contains(&shape.name.as_str());
        let Some(shape) = written.child("geometry").and_then(|geometry| geometry.children.iter().find(known)) else {
            let missing = "geometry that is a box, cylinder, sphere, capsule or mesh";
            let kind = ProblemKind::Missing { item: "collider", name: name.to_owned(), missing };
            self.report.add(written.line, kind);
            return;
        };
        if has_no_extent(shape) {
            self.report.assume(shape.line, AssumptionKind::Point { collider: name.to_owned() });
            return;
        }
        let mut add = |name: String, shape, link_from_shape| {
            colliders.push(Collider { name, shape, link_from_shape, material: Material::Bare });
        };
        match shape.name.as_str() {
            "box" => {
                let sides = Vector3::from(self.size(name, shape, "size"));
                add(name.to_owned(), Shape::Cuboid(sides / 2.0), place);
            }
            "sphere" => {
                let [radius] = self.size(name, shape, "radius");
                add(name.to_owned(), Shape::Sphere { radius }, place);
            }
            "mesh" => {
                self.mesh(name, written, shape, place);
                add(name.to_owned(), Shape::Sphere { radius: PLACEHOLDER }, place);
            }
            kind => {
                let ([radius], [length]) = (self.size(name, shape, "radius"), self.size(name, shape, "length"));
                let half_length = length / 2.0;
                let mut parts = vec![(Shape::Cylinder { radius, half_length }, 0.0)];
                if kind == "capsule" {
                    parts.extend([-half_length, half_length].map(|end| (Shape::Sphere { radius }, end)));
                }
                let several = parts.len() > 1;
                for (number, (part, end)) in parts.into_iter().enumerate() {
                    let name = if several { format!("{name}.{number}") } else { name.to_owned() };
                    add(name, part, place * Translation3::new(0.0, 0.0, end));
                }
            }
        }
    }

    /// Lengths of a shape, which must be positive.
    fn size<const N: usize>(&mut self, name: &str, shape: &Element, attribute: &'static str) -> [f64; N] {
        let name = name.to_owned();
        let Some(lengths) = shape.numbers::<N>(attribute) else {
            self.report.add(shape.line, ProblemKind::Missing { item: "collider", name, missing: attribute });
            return [PLACEHOLDER; N];
        };
        let least = lengths.iter().copied().fold(f64::INFINITY, f64::min);
        if least <= 0.0 {
            let (quantity, must) = ("least size", "greater than 0 m");
            self.report.add(shape.line, ProblemKind::Value { item: "collider", name, quantity, value: least, must });
        }
        lengths
    }

    fn mesh(&mut self, name: &str, written: &Element, mesh: &Element, place: Isometry3<f64>) {
        let Some(file) = mesh.attribute("filename").filter(|file| !file.is_empty()) else {
            let name = name.to_owned();
            self.report.add(mesh.line, ProblemKind::Missing { item: "collider", name, missing: "filename" });
            return;
        };
        let scale = mesh.numbers::<3>("scale").unwrap_or([1.0; 3]);
        if let Some(&value) = scale.iter().find(|factor| **factor == 0.0) {
            let (name, quantity, must) = (name.to_owned(), "scale", "other than 0");
            self.report.add(mesh.line, ProblemKind::Value { item: "collider", name, quantity, value, must });
        }
        self.meshes.push(MeshShape {
            name: name.to_owned(),
            line: mesh.line,
            file: file.to_owned(),
            scale,
            link_from_mesh: place,
            element: written.name.clone(),
            span: written.span.clone(),
        });
    }
}

/// Whether all sizes of a shape are 0, as of one that only marks a place.
fn has_no_extent(shape: &Element) -> bool {
    let lengths = ["radius", "length"].into_iter().filter_map(|name| shape.numbers::<1>(name)).flatten();
    let sizes: Vec<f64> = lengths.chain(shape.numbers::<3>("size").into_iter().flatten()).collect();
    shape.name != "mesh" && !sizes.is_empty() && sizes.iter().all(|size| *size == 0.0)
}

/// Size of a shape that is not known, metres.
const PLACEHOLDER: f64 = 0.01;

/// The pose of the `<origin>` of an element; identity without one.
pub(super) fn isometry(element: &Element) -> Isometry3<f64> {
    let numbers = |name| element.child("origin").and_then(|origin| origin.numbers::<3>(name)).unwrap_or_default();
    let [r, p, y] = numbers("rpy");
    Isometry3::from_parts(Translation3::from(Vector3::from(numbers("xyz"))), UnitQuaternion::from_euler_angles(r, p, y))
}
