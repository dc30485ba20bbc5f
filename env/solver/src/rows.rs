//! From the points that may touch to the contact points of a step's equations.

use nalgebra::Vector3;

use crate::kinematics::{Kinematics, Twist};
use crate::model::{BASE, Model, OBJECT, Pair};
use crate::problem::{Patch, Point, Problem};
use crate::scenery::Surface;
use crate::search::{Candidate, Opposite, PairCache, Situation};
use crate::solver::Contact;

/// What the rows are made from, beside the search's results.
pub(crate) struct Scene<'a> {
    pub now: Situation<'a>,
    /// The reference: the object's centre of mass.
    pub center: Vector3<f64>,
    /// How the scenery moves, at the reference.
    pub scenery: Twist,
    /// Mass of the object, kg.
    pub mass: f64,
}

/// A candidate as it is now.
struct Measured {
    point: Vector3<f64>,
    normal: Vector3<f64>,
    distance: f64,
    /// In the second body's frame; on a plane in the frame of the base.
    on_b: Vector3<f64>,
    surface: Option<Surface>,
}

/// Writes points and patches of `problem`, and one contact per point.
pub(crate) fn collect(
    model: &Model,
    scene: &Scene,
    kinematics: &Kinematics,
    pairs: &[PairCache],
    friction_factor: f64,
    problem: &mut Problem,
    contacts: &mut Vec<Contact>,
) {
    problem.points.clear();
    problem.patches.clear();
    contacts.clear();
    for (pair, cache) in model.pairs.iter().zip(pairs) {
        let first = problem.points.len();
        let factor = if pair.a == OBJECT { friction_factor } else { 1.0 };
        for candidate in &cache.candidates {
            let measured = measure(model, scene, pair, candidate);
            if measured.distance > cache.reach {
                continue;
            }
            let friction = candidate.friction * factor;
            problem.points.push(point(model, scene, pair, &measured, friction, problem.dt));
            contacts.push(Contact {
                bodies: [pair.a, pair.b],
                shapes: candidate.shapes.map(|s| s.map(|index| model.shape_owner[usize::from(index)].1 as u16)),
                surface: measured.surface,
                points: [candidate.on_a, measured.on_b],
                point: measured.point,
                normal: measured.normal,
                friction,
                distance: measured.distance,
                force: 0.0,
            });
        }
        let last = problem.points.len();
        if last > first {
            let known = known(model, scene, kinematics, pair.b) - known(model, scene, kinematics, pair.a);
            problem.patches.push(Patch { a: pair.a, b: pair.b, first, last, known });
        }
    }
}

/// Twist that is known before the step is solved.
fn known(model: &Model, scene: &Scene, kinematics: &Kinematics, body: usize) -> Twist {
    match body {
        OBJECT => Twist::default(),
        _ if body == model.scenery_body() => scene.scenery,
        _ => kinematics.known[body - BASE],
    }
}

fn measure(model: &Model, scene: &Scene, pair: &Pair, candidate: &Candidate) -> Measured {
    let a = &scene.now.poses[pair.a];
    let on_a = a.rotation * candidate.on_a + a.translation.vector;
    match candidate.opposite {
        Opposite::Plane(surface) => {
            let plane = &scene.now.planes[usize::from(surface == Surface::Ground)];
            let distance = plane.gap(&on_a);
            let on_b = on_a - plane.up * distance;
            let point = on_a - plane.up * (0.5 * distance);
            Measured { point, normal: -plane.up, distance, on_b, surface: Some(surface) }
        }
        Opposite::Point { on_b, normal } => {
            let b = &scene.now.poses[pair.b];
            let apart = b.rotation * on_b + b.translation.vector - on_a;
            let normal = a.rotation * normal;
            let surface = (pair.b == model.scenery_body()).then_some(Surface::Table);
            Measured { point: on_a + 0.5 * apart, normal, distance: apart.dot(&normal), on_b, surface }
        }
    }
}

fn point(model: &Model, scene: &Scene, pair: &Pair, measured: &Measured, friction: f64, dt: f64) -> Point {
    let config = &model.solver;
    // What carries the object alone must carry its weight: a natural frequency, not a stiffness.
    let carries = pair.a == OBJECT && (pair.b == BASE || pair.b == model.scenery_body());
    let support = if carries { scene.mass * config.support_stiffness } else { 0.0 };
    let stiffness = config.contact_stiffness.max(support);
    // What does not touch yet is not braked: only what would be inside at the end of the step is pushed.
    let relaxation = if measured.distance > 0.0 { 0.0 } else { config.contact_relaxation };
    let time = dt + relaxation;
    Point {
        arm: measured.point - scene.center,
        normal: measured.normal,
        target: (-measured.distance).min(config.penetration_cap) / time,
        stiffness: dt * stiffness * time,
        friction,
        impulse: 0.0,
        bound: 0.0,
        approach: 0.0,
        slide: Vector3::zeros(),
        speed: 0.0,
    }
}
