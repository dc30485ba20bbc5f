//! Shapes that pass through each other: those that the file names, and links that overlap in the open hand.
//!
//! A pair that overlaps where a trial begins would push its joints apart or lock them: in such files a shape is larger than the part, such as a
//! box around a mesh.

use std::collections::BTreeSet;

use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use parry3d_f64::math::{Pose, Rotation, Vector};
use parry3d_f64::query::contact;
use parry3d_f64::shape::SharedShape;
use toml::Spanned;

use crate::error::ProblemKind;
use crate::model::{Hand, NoContact, Shape, ShapeIndex};
use crate::table::{HandTable, Reader};

use super::is_named;

/// Depth from which shapes overlap, metres; less is within the rounding of a drawing.
const OVERLAP: f64 = 1e-4;

type Pairs = BTreeSet<[ShapeIndex; 2]>;

/// Reads `no_contact`, and finds the links that overlap in the open hand.
pub(super) fn read(hand: &mut Hand, table: &HandTable, reader: &mut Reader<'_, '_>) {
    let mut apart = Pairs::new();
    for names in &table.no_contact {
        read_list(hand, names, &mut apart, reader);
    }
    let overlapping = overlapping(hand, &apart);
    for [a, b] in &overlapping {
        add_all(&hand.shapes_of_body(*a).collect::<Vec<_>>(), &hand.shapes_of_body(*b).collect::<Vec<_>>(), &mut apart);
    }
    hand.no_contact = NoContact { shapes: apart.into_iter().collect(), overlapping };
}

fn read_list(hand: &Hand, names: &Spanned<Vec<Spanned<String>>>, apart: &mut Pairs, reader: &mut Reader<'_, '_>) {
    if names.get_ref().len() < 2 {
        reader.add(names, ProblemKind::TooFewApart(names.get_ref().len()));
    }
    let mut listed: Vec<Vec<ShapeIndex>> = Vec::new();
    for (index, name) in names.get_ref().iter().enumerate() {
        if names.get_ref()[..index].iter().any(|other| other.get_ref() == name.get_ref()) {
            let (name_again, by) = (name.get_ref().clone(), "a list of `no_contact`");
            reader.add(name, ProblemKind::UsedTwice { what: "link or collider", name: name_again, by });
            continue;
        }
        let shapes = named(hand, name, reader);
        listed.iter().for_each(|others| add_all(others, &shapes, apart));
        listed.push(shapes);
    }
}

/// Shapes of the link of a name, else the collider of that name.
fn named(hand: &Hand, name: &Spanned<String>, reader: &mut Reader<'_, '_>) -> Vec<ShapeIndex> {
    let links = || hand.links.iter().enumerate();
    let all = links().flat_map(|(link, l)| l.colliders.iter().enumerate().map(move |(shape, c)| ((link, shape), c)));
    if let Some((link, own)) = links().find(|(_, link)| link.name == *name.get_ref()) {
        return (0..own.colliders.len()).map(|shape| (link, shape)).collect();
    }
    let found: Vec<ShapeIndex> =
        all.filter(|(_, collider)| is_named(&collider.name, name.get_ref())).map(|(index, _)| index).collect();
    if found.is_empty() {
        let known = hand.links.iter().map(|link| link.name.clone()).collect();
        reader.add(name, ProblemKind::Unknown { what: "link or collider", name: name.get_ref().clone(), known });
    }
    found
}

fn add_all(some: &[ShapeIndex], others: &[ShapeIndex], apart: &mut Pairs) {
    apart.extend(some.iter().flat_map(|a| others.iter().map(move |b| [*a.min(b), *a.max(b)])));
}

/// A shape of the open hand.
struct Placed {
    shape: SharedShape,
    pose: Pose,
    /// Radius of a sphere about its origin that contains it, metres.
    radius: f64,
}

/// Bodies that overlap in the open hand with any preshape, but for shapes that are `apart` already.
fn overlapping(hand: &Hand, apart: &Pairs) -> Vec<[usize; 2]> {
    let meeting = hand.meeting_bodies();
    let bodies: Vec<Vec<ShapeIndex>> =
        (0..hand.links.len()).map(|first| hand.shapes_of_body(first).collect()).collect();
    let mut found = BTreeSet::new();
    let named = hand.preshapes().iter().map(|preshape| preshape.value);
    for preshape in named.chain(hand.preshape_limits()) {
        let placed = placed(hand, preshape);
        let overlap = |[a, b]: &&[usize; 2]| {
            let pairs = bodies[*a].iter().flat_map(|one| bodies[*b].iter().map(move |two| (*one, *two)));
            pairs
                .filter(|(one, two)| !apart.contains(&[*one.min(two), *one.max(two)]))
                .any(|((l, s), (m, t))| placed[l][s].overlaps(&placed[m][t]))
        };
        found.extend(meeting.iter().filter(overlap));
    }
    found.into_iter().collect()
}

/// The shapes of each link of the open hand.
fn placed(hand: &Hand, preshape: f64) -> Vec<Vec<Placed>> {
    let mut placed: Vec<Vec<Placed>> = hand.links.iter().map(|_| Vec::new()).collect();
    // A wrong number in a file, which is reported, makes poses that are not finite.
    let shapes = hand.shapes_at(&hand.open_configuration(preshape)).unwrap_or_default();
    for each in shapes {
        placed[each.link].push(Placed::new(&each.collider.shape, &each.hand_from_shape));
    }
    placed
}

impl Placed {
    fn new(shape: &Shape, at: &Isometry3<f64>) -> Self {
        let radius = shape.half_extents(&UnitQuaternion::identity()).norm();
        let (shape, turn) = match *shape {
            Shape::Cuboid(half) => (SharedShape::cuboid(half.x, half.y, half.z), UnitQuaternion::identity()),
            Shape::Sphere { radius } => (SharedShape::ball(radius), UnitQuaternion::identity()),
            // The library's cylinders are about y.
            Shape::Cylinder { radius, half_length } => (
                SharedShape::cylinder(half_length, radius),
                UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2),
            ),
        };
        let (at, q) = (at.translation.vector, (at.rotation * turn).coords);
        let pose = Pose::from_parts(Vector::new(at.x, at.y, at.z), Rotation::from_xyzw(q.x, q.y, q.z, q.w));
        Self { shape, pose, radius }
    }

    fn overlaps(&self, other: &Self) -> bool {
        let apart = (self.pose.translation - other.pose.translation).length();
        // Unsupported pairs do not occur: all shapes are convex.
        apart < self.radius + other.radius
            && contact(&self.pose, &*self.shape, &other.pose, &*other.shape, 0.0)
                .ok()
                .flatten()
                .is_some_and(|contact| contact.dist < -OVERLAP)
    }
}
