//! From the points that may touch to the contact points of a step's equations.

use nalgebra::{Matrix3, Vector3};

use crate::kinematics::{Kinematics, Twist};
use crate::model::{BASE, Model, OBJECT, Pair};
use crate::problem::{Patch, Point, Problem};
use crate::scenery::Surface;
use crate::search::{Candidate, Opposite, PairCache, Situation};

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
    /// On the first body, and midway between the bodies; frame of the base.
    middle: Vector3<f64>,
    normal: Vector3<f64>,
    distance: f64,
}

/// Where a contact point comes from.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Origin {
    pub pair: u32,
    pub candidate: u32,
    /// At the beginning of the step, metres.
    pub distance: f64,
}

/// Writes points and patches of `problem`, and where each point comes from.
pub(crate) fn collect(
    model: &Model,
    scene: &Scene,
    kinematics: &Kinematics,
    pairs: &[PairCache],
    friction_factor: f64,
    problem: &mut Problem,
    origins: &mut Vec<Origin>,
) {
    problem.points.clear();
    problem.patches.clear();
    origins.clear();
    for (index, (pair, cache)) in model.pairs.iter().zip(pairs).enumerate() {
        let first = problem.points.len();
        if cache.candidates.is_empty() {
            continue;
        }
        let factor = if pair.a == OBJECT { friction_factor } else { 1.0 };
        let relative = Relative::new(scene, pair);
        for (within, candidate) in cache.candidates.iter().enumerate() {
            if relative.distance(candidate) <= cache.reach {
                let measured = measure(scene, pair, candidate);
                problem.points.push(point(model, scene, pair, &measured, candidate.friction * factor, problem.dt));
                let (pair, candidate) = (index as u32, within as u32);
                origins.push(Origin { pair, candidate, distance: measured.distance });
            }
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

/// The second body and both planes as the first body sees them: most candidates are too far away, which is found out from these alone.
struct Relative {
    a_from_b: (Matrix3<f64>, Vector3<f64>),
    /// Direction and height of the table's and the ground's plane.
    planes: [(Vector3<f64>, f64); 2],
}

impl Relative {
    fn new(scene: &Scene, pair: &Pair) -> Self {
        let (poses, turns) = (scene.now.poses, scene.now.turns);
        let (a, origin) = (&turns[pair.a], &poses[pair.a].translation.vector);
        let apart = a.tr_mul(&(poses[pair.b].translation.vector - origin));
        Self {
            a_from_b: (a.tr_mul(&turns[pair.b]), apart),
            planes: scene.now.planes.map(|plane| (a.tr_mul(&plane.up), plane.gap(origin))),
        }
    }

    #[inline]
    fn distance(&self, candidate: &Candidate) -> f64 {
        match candidate.opposite {
            Opposite::Plane(surface) => {
                let (up, gap) = &self.planes[usize::from(surface == Surface::Ground)];
                up.dot(&candidate.on_a) + gap
            }
            Opposite::Point { on_b, normal } => {
                (self.a_from_b.0 * on_b + self.a_from_b.1 - candidate.on_a).dot(&normal)
            }
        }
    }
}

fn measure(scene: &Scene, pair: &Pair, candidate: &Candidate) -> Measured {
    let (poses, turns) = (scene.now.poses, scene.now.turns);
    let on_a = turns[pair.a] * candidate.on_a + poses[pair.a].translation.vector;
    match candidate.opposite {
        Opposite::Plane(surface) => {
            let plane = &scene.now.planes[usize::from(surface == Surface::Ground)];
            let distance = plane.gap(&on_a);
            Measured { middle: on_a - plane.up * (0.5 * distance), normal: -plane.up, distance }
        }
        Opposite::Point { on_b, normal } => {
            let apart = turns[pair.b] * on_b + poses[pair.b].translation.vector - on_a;
            let normal = turns[pair.a] * normal;
            Measured { middle: on_a + 0.5 * apart, normal, distance: apart.dot(&normal) }
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
    let arm = measured.middle - scene.center;
    Point {
        arm,
        normal: measured.normal,
        moment: arm.cross(&measured.normal),
        target: pushing_depth(-measured.distance, config.penetration_cap) / time,
        stiffness: dt * stiffness * time,
        friction,
        impulse: 0.0,
        bound: 0.0,
        approach: 0.0,
        slide: Vector3::zeros(),
        speed: 0.0,
    }
}

/// Share of a penetration beyond the cap that pushes back too: enough to carry any load, too little to throw what starts overlapped.
const BEYOND_CAP: f64 = 0.2;

/// The depth that pushes back, metres; negative while the bodies are apart.
fn pushing_depth(depth: f64, cap: f64) -> f64 {
    depth.min(cap) + BEYOND_CAP * (depth - cap).max(0.0)
}
