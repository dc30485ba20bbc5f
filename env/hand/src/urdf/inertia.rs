//! Masses and inertias: as a URDF states them, else from the collision shapes.

use nalgebra::{Matrix3, Point3, SymmetricEigen, Vector3};

use super::Tree;
use super::assumption::AssumptionKind;
use super::element::Element;
use super::links::isometry;
use crate::error::{ProblemKind, Report};
use crate::model::{Collider, Shape};

/// Density of links that state no mass, kg/m3: that of MuJoCo and Isaac Sim, a plastic part or a hollow one of metal.
const DENSITY: f64 = 1000.0;
/// Mass of a body without mass and shapes, kg: it weighs nothing beside any part of a hand, and its joint can be simulated.
const SMALL_MASS: f64 = 1e-3;
/// Share by which principal moments may break the triangle inequality: rounding of written numbers.
const ROUNDING: f64 = 1e-3;

/// Mass, centre of mass and inertia about it.
type Body = (f64, Point3<f64>, Matrix3<f64>);

/// The `<inertial>` of a link, with 0 for what is not there.
pub(super) struct Inertial {
    line: usize,
    /// What is missing, if it has no mass.
    why: Option<&'static str>,
    body: Body,
}

/// Reads the inertial of a link; a negative mass is a problem.
pub(super) fn read(link: &Element, name: &str, report: &mut Report<'_>) -> Inertial {
    let Some(inertial) = link.child("inertial") else {
        let body = (0.0, Point3::origin(), Matrix3::zeros());
        return Inertial { line: link.line, why: Some("has no <inertial>"), body };
    };
    let mass = inertial.child("mass").map_or(0.0, |mass| mass.number("value", 0.0));
    if mass < 0.0 {
        let (name, must) = (name.to_owned(), "greater than 0 kg");
        report.add(inertial.line, ProblemKind::Value { item: "link", name, quantity: "mass", value: mass, must });
    }
    let moment = |name| inertial.child("inertia").map_or(0.0, |inertia| inertia.number(name, 0.0));
    let [ixx, ixy, ixz] = ["ixx", "ixy", "ixz"].map(moment);
    let [iyy, iyz, izz] = ["iyy", "iyz", "izz"].map(moment);
    let own = Matrix3::new(ixx, ixy, ixz, ixy, iyy, iyz, ixz, iyz, izz);
    let pose = isometry(inertial);
    let turn = pose.rotation.to_rotation_matrix();
    let inertia = turn.matrix() * own * turn.matrix().transpose();
    let why = (mass == 0.0).then_some("has no mass");
    Inertial { line: inertial.line, why, body: (mass, Point3::from(pose.translation.vector), inertia) }
}

/// Sets masses and inertias of all links: those that are stated, those of shapes, or none for what is fixed to others.
pub(super) fn set(tree: &mut Tree, inertials: &[Inertial], report: &mut Report<'_>) {
    let carriers = tree.carriers();
    for (link, inertial) in inertials.iter().enumerate() {
        let others = || (0..carriers.len()).filter(|other| *other != link && carriers[*other] == carriers[link]);
        let massive = others().any(|other| inertials[other].why.is_none());
        let shaped = !tree.links[link].colliders.is_empty();
        let shapes_beside = others().any(|other| !tree.links[other].colliders.is_empty());
        let name = tree.links[link].name.clone();
        let (body, assumed) = match inertial.why {
            None => sound(&tree.links[link].colliders, &inertial.body, name),
            Some(why) if shaped && (link == carriers[link] || !massive) => {
                let body = of_shapes(&tree.links[link].colliders);
                (body, Some(AssumptionKind::FromShapes { link: name, why, density: DENSITY, mass: body.0 }))
            }
            Some(why) if link != carriers[link] => {
                let parent = tree.links[tree.joints[link - 1].parent].name.clone();
                (NOTHING, Some(AssumptionKind::Massless { link: name, why, parent }))
            }
            Some(why) if massive || shapes_beside => (NOTHING, Some(AssumptionKind::Carried { link: name, why })),
            Some(why) => {
                let body = (SMALL_MASS, Point3::origin(), ball(SMALL_MASS));
                (body, Some(AssumptionKind::SmallMass { link: name, why, density: DENSITY, mass: SMALL_MASS }))
            }
        };
        if let Some(kind) = assumed {
            report.assume(inertial.line, kind);
        }
        let link = &mut tree.links[link];
        (link.mass, link.center_of_mass, link.inertia) = body;
    }
}

/// A link that others carry.
const NOTHING: Body = (0.0, Point3::new(0.0, 0.0, 0.0), Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0));

/// A stated body whose inertia is possible, and what was changed.
fn sound(shapes: &[Collider], &(mass, center, inertia): &Body, link: String) -> (Body, Option<AssumptionKind>) {
    let SymmetricEigen { eigenvalues: moments, eigenvectors: axes } = inertia.symmetric_eigen();
    let least = moments.min();
    if least <= 0.0 {
        let (own, _, of_own) = of_shapes(shapes);
        let (of, inertia) = if own > 0.0 {
            ("its collision shapes", of_own * (mass / own))
        } else {
            ("a ball of 1000 kg/m3", ball(mass))
        };
        return ((mass, center, inertia), Some(AssumptionKind::Moments { link, least, of }));
    }
    let most = moments.imax();
    let others = moments.sum() - moments[most];
    if moments[most] <= others * (1.0 + 2.0 * ROUNDING) {
        return ((mass, center, inertia), None);
    }
    // The nearest point, by the Frobenius norm, of the cone in which the sum of two moments is no less than the third.
    let mut changed = moments.add_scalar((moments[most] - others) / 3.0);
    changed[most] = changed.sum() - changed[most];
    let possible = axes * Matrix3::from_diagonal(&changed) * axes.transpose();
    let excess = 100.0 * (moments[most] / others - 1.0);
    let body = (mass, center, (possible + possible.transpose()) / 2.0);
    (body, Some(AssumptionKind::Balanced { link, excess }))
}

/// Inertia of a ball of a mass about its centre, kg m2.
fn ball(mass: f64) -> Matrix3<f64> {
    let radius = (3.0 * mass / (4.0 * std::f64::consts::PI * DENSITY)).cbrt();
    Matrix3::from_diagonal_element(0.4 * mass * radius * radius)
}

/// Shapes of uniform density together; where they overlap, both count.
fn of_shapes(shapes: &[Collider]) -> Body {
    let parts: Vec<(f64, Vector3<f64>, Matrix3<f64>)> = shapes.iter().map(of_shape).collect();
    let mass: f64 = parts.iter().map(|(mass, _, _)| mass).sum();
    if mass <= 0.0 {
        return NOTHING;
    }
    let center = parts.iter().map(|(mass, at, _)| at * *mass).sum::<Vector3<f64>>() / mass;
    let about = |(mass, at, inertia): &(f64, Vector3<f64>, Matrix3<f64>)| {
        let away = at - center;
        inertia + (Matrix3::identity() * away.norm_squared() - away * away.transpose()) * *mass
    };
    (mass, Point3::from(center), parts.iter().map(about).sum())
}

fn of_shape(collider: &Collider) -> (f64, Vector3<f64>, Matrix3<f64>) {
    let (volume, squares) = match collider.shape {
        Shape::Cuboid(half) => (8.0 * half.product(), half.component_mul(&half) / 3.0),
        Shape::Cylinder { radius, half_length } => {
            let across = radius * radius / 4.0;
            (
                2.0 * std::f64::consts::PI * radius * radius * half_length,
                Vector3::new(across, across, half_length * half_length / 3.0),
            )
        }
        Shape::Sphere { radius } => {
            (4.0 / 3.0 * std::f64::consts::PI * radius.powi(3), Vector3::repeat(radius * radius / 5.0))
        }
    };
    let mass = DENSITY * volume;
    // The moment about an axis is the mass times the mean squares of the two other coordinates.
    let moments = Matrix3::from_diagonal(&(Vector3::repeat(squares.sum()) - squares)) * mass;
    let turn = collider.link_from_shape.rotation.to_rotation_matrix();
    (mass, collider.link_from_shape.translation.vector, turn.matrix() * moments * turn.matrix().transpose())
}
