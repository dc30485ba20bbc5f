//! Assembles the contact points of a step's equations from the candidates of the search.
//!
//! A point with signed distance `d` (negative where the bodies overlap) gets the constants of `problem`'s contact law:
//!
//! ```text
//! tau    = relaxation if d <= 0, else 0
//! k      = max(contact stiffness, m * support stiffness)   if an object rests on table or palm, m its mass
//!        = contact stiffness                               otherwise
//! depth  = min(-d, cap) + BEYOND_CAP * max(-d - cap, 0)
//! target = depth / (dt + tau)                              m/s
//! stiffness = dt k (dt + tau)                              N s per m/s
//! ```
//!
//! Across a gap the relaxation is 0. The normal impulse is then `dt k max(0, -d - dt u_n)`: a spring on the penetration at the end of the step,
//! without damping. Bodies that approach but do not touch within the step feel no force.

use nalgebra::{Matrix3, Vector3};

use crate::kinematics::{Kinematics, Twist};
use crate::model::{BodyKind, Model, Pair};
use crate::problem::{Patch, Point, Problem};
use crate::scenery::Surface;
use crate::search::{Candidate, Opposite, PairCache, Situation};
use crate::solver::sleep::rests;

/// Poses and motion at the beginning of the step.
pub(crate) struct Scene<'a> {
    pub now: Situation<'a>,
    /// Reference point of all twists, frame of the base.
    pub reference: Vector3<f64>,
    /// Twist of the scenery at the reference point.
    pub scenery: Twist,
    /// Factor on the friction of each object.
    pub friction_factors: &'a [f64],
}

/// A candidate at the present poses; frame of the base.
struct ContactGeometry {
    /// Midway between the two surfaces.
    middle: Vector3<f64>,
    /// Unit normal from the first to the second body.
    normal: Vector3<f64>,
    /// Signed distance along the normal, metres; negative where the bodies overlap.
    distance: f64,
}

/// The candidate behind a contact point.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PointSource {
    pub pair: u32,
    pub candidate: u32,
    /// At the beginning of the step, metres.
    pub distance: f64,
}

/// Writes the points and patches of `problem`, and the candidate behind each point to `sources`.
pub(crate) fn collect(
    model: &Model,
    scene: &Scene,
    kinematics: &Kinematics,
    (pairs, asleep): (&[PairCache], &[bool]),
    problem: &mut Problem,
    sources: &mut Vec<PointSource>,
) {
    problem.points.clear();
    problem.patches.clear();
    sources.clear();
    for (index, (pair, cache)) in model.pairs.iter().zip(pairs).enumerate() {
        let first = problem.points.len();
        if cache.candidates.is_empty() || rests(&pair.sides, |object| asleep[object]) {
            continue;
        }
        let sides = pair.sides;
        let factor = friction_factor(scene, sides);
        let support = support_stiffness(model, problem, sides);
        let relative = Relative::new(&scene.now, pair);
        for (within, candidate) in cache.candidates.iter().enumerate() {
            if relative.distance(candidate) <= cache.reach {
                let measured = measure(scene, pair, candidate);
                let friction = candidate.friction * factor;
                problem.points.push(point(model, scene, &measured, (support, friction), problem.dt));
                let (pair, candidate) = (index as u32, within as u32);
                sources.push(PointSource { pair, candidate, distance: measured.distance });
            }
        }
        let last = problem.points.len();
        if last > first {
            let [of_a, of_b] = sides.map(|side| prescribed_twist(scene, kinematics, side, asleep));
            problem.patches.push(Patch { sides, first, last, prescribed: of_b - of_a });
        }
    }
}

/// A sleeper that the hand may touch in this step.
pub(crate) fn touched_sleeper(model: &Model, scene: &Scene, pairs: &[PairCache], asleep: &[bool]) -> Option<usize> {
    if !asleep.contains(&true) {
        return None;
    }
    model.pairs.iter().zip(pairs).find_map(|(pair, cache)| match pair.sides {
        [BodyKind::Object(object), BodyKind::Hand(_)] if asleep[object] => {
            (!none_in_reach(&scene.now, pair, cache)).then_some(object)
        }
        _ => None,
    })
}

/// True if no candidate of a pair may touch in this step.
pub(crate) fn none_in_reach(now: &Situation, pair: &Pair, cache: &PairCache) -> bool {
    cache.candidates.is_empty() || {
        let relative = Relative::new(now, pair);
        cache.candidates.iter().all(|candidate| relative.distance(candidate) > cache.reach)
    }
}

/// The part of a body's twist that is prescribed: the motion of the scenery, with the sleepers, and that of driven coordinates.
fn prescribed_twist(scene: &Scene, kinematics: &Kinematics, body: BodyKind, asleep: &[bool]) -> Twist {
    match body {
        BodyKind::Object(object) if asleep[object] => scene.scenery,
        BodyKind::Object(_) => Twist::default(),
        BodyKind::Hand(body) => kinematics.prescribed[body],
        BodyKind::Scenery => scene.scenery,
    }
}

/// Factor on the friction of a pair: the product of those of its objects.
fn friction_factor(scene: &Scene, sides: [BodyKind; 2]) -> f64 {
    match sides {
        [BodyKind::Object(a), BodyKind::Object(b)] => scene.friction_factors[a] * scene.friction_factors[b],
        [BodyKind::Object(a), _] => scene.friction_factors[a],
        _ => 1.0,
    }
}

/// Least stiffness of a point that supports an object on table or palm, N/m; 0 for other pairs.
fn support_stiffness(model: &Model, problem: &Problem, sides: [BodyKind; 2]) -> f64 {
    match sides {
        [BodyKind::Object(object), BodyKind::Scenery | BodyKind::Hand(0)] => {
            problem.objects[object].mass * model.config.support_stiffness
        }
        _ => 0.0,
    }
}

/// The second body and both planes in the frame of the first body: enough to reject the candidates that are too far away, which most are.
struct Relative {
    a_from_b: (Matrix3<f64>, Vector3<f64>),
    /// Normal of the table's and the ground's plane, and the height of the first body's origin above it.
    planes: [(Vector3<f64>, f64); 2],
}

impl Relative {
    #[inline(always)]
    fn new(now: &Situation, pair: &Pair) -> Self {
        let (poses, turns) = (now.poses, now.turns);
        let (a, origin) = (&turns[pair.a], &poses[pair.a].translation.vector);
        let apart = a.tr_mul(&(poses[pair.b].translation.vector - origin));
        Self {
            a_from_b: (a.tr_mul(&turns[pair.b]), apart),
            planes: now.planes.map(|plane| (a.tr_mul(&plane.up), plane.gap(origin))),
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

fn measure(scene: &Scene, pair: &Pair, candidate: &Candidate) -> ContactGeometry {
    let (poses, turns) = (scene.now.poses, scene.now.turns);
    let on_a = turns[pair.a] * candidate.on_a + poses[pair.a].translation.vector;
    match candidate.opposite {
        Opposite::Plane(surface) => {
            let plane = &scene.now.planes[usize::from(surface == Surface::Ground)];
            let distance = plane.gap(&on_a);
            ContactGeometry { middle: on_a - plane.up * (0.5 * distance), normal: -plane.up, distance }
        }
        Opposite::Point { on_b, normal } => {
            let apart = turns[pair.b] * on_b + poses[pair.b].translation.vector - on_a;
            let normal = turns[pair.a] * normal;
            ContactGeometry { middle: on_a + 0.5 * apart, normal, distance: apart.dot(&normal) }
        }
    }
}

fn point(model: &Model, scene: &Scene, measured: &ContactGeometry, (support, friction): (f64, f64), dt: f64) -> Point {
    let config = &model.config;
    let stiffness = config.contact_stiffness.max(support);
    let relaxation = if measured.distance > 0.0 { 0.0 } else { config.contact_relaxation };
    let time = dt + relaxation;
    let arm = measured.middle - scene.reference;
    Point {
        arm,
        normal: measured.normal,
        moment: arm.cross(&measured.normal),
        target: pushing_depth(-measured.distance, config.penetration_cap) / time,
        stiffness: dt * stiffness * time,
        friction,
        impulse: 0.0,
        bound: 0.0,
        normal_speed: 0.0,
        slip: Vector3::zeros(),
        slip_speed: 0.0,
    }
}

/// Share of the penetration beyond the cap that pushes back, dimensionless. It is above 0 so that a deeper contact carries any load, and below 1
/// so that objects that overlap at the start are not thrown.
const BEYOND_CAP: f64 = 0.2;

/// The part of a penetration that pushes back, metres; negative across a gap.
fn pushing_depth(depth: f64, cap: f64) -> f64 {
    depth.min(cap) + BEYOND_CAP * (depth - cap).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::ImplicitConfig;
    use nalgebra::Isometry3;

    const DT: f64 = 0.002;

    /// A point at signed distance `distance` between the object, or else the hand, and the table.
    fn on_table(with_object: bool, mass: f64, distance: f64) -> Point {
        let model = Model::of_ball(mass, 1.0);
        let planes = model.scenery.planes(&Isometry3::identity());
        let now = Situation { dt: DT, poses: &[], turns: &[], moving: &[], planes: &planes, idle: 0 };
        let scene = Scene { now, reference: Vector3::zeros(), scenery: Twist::default(), friction_factors: &[1.0] };
        let a = if with_object { BodyKind::Object(0) } else { BodyKind::Hand(0) };
        let mut problem = Problem::new(&model);
        problem.objects[0].mass = mass;
        let support = support_stiffness(&model, &problem, [a, BodyKind::Scenery]);
        let measured = ContactGeometry { middle: Vector3::x(), normal: -Vector3::z(), distance };
        point(&model, &scene, &measured, (support, 0.5), DT)
    }

    /// The equations of the module's documentation, with numbers. A bug here: a damped gap, a penetration that throws or sinks in, a light
    /// object on a soft table.
    #[test]
    fn points_follow_the_documented_law() {
        let tau = ImplicitConfig::default().contact_relaxation;
        // Object or hand, mass, distance; depth that pushes, relaxation, stiffness.
        let cases = [
            (true, 0.2, 1e-4, -1e-4, 0.0, 1.2e5),
            (true, 0.2, -2e-4, 2e-4, tau, 1.2e5),
            (true, 0.2, -1.5e-3, 5e-4 + 0.2 * 1e-3, tau, 1.2e5),
            (true, 3.0, -2e-4, 2e-4, tau, 3e5),
            (false, 3.0, -2e-4, 2e-4, tau, 1.2e5),
        ];
        for (with_object, mass, distance, depth, tau, k) in cases {
            let point = on_table(with_object, mass, distance);
            let near = |found: f64, expected: f64| (found - expected).abs() <= 1e-12 * expected.abs();
            assert!(near(point.target, depth / (DT + tau)), "{mass} kg at {distance} m: {point:?}");
            assert!(near(point.stiffness, DT * k * (DT + tau)), "{mass} kg at {distance} m: {point:?}");
        }
    }
}
