//! The equations of a step and their derivative.

use nalgebra::Matrix3;

use super::*;

const STICK: f64 = 2e-5;

/// A ball of 0.2 kg over a table that moves, on two points that press.
fn ball() -> (Model, Problem) {
    let model = Model::of_ball(0.2, 7e-5);
    let point = |arm: Vector3<f64>, normal: Vector3<f64>| Point {
        arm,
        normal,
        moment: arm.cross(&normal),
        target: 0.03,
        stiffness: 2.4,
        friction: 0.5,
        impulse: 0.0,
        bound: 0.0,
        normal_speed: 0.0,
        slip: Vector3::zeros(),
        slip_speed: 0.0,
    };
    let points = vec![
        point(Vector3::new(0.01, 0.0, -0.028), -Vector3::z()),
        point(Vector3::new(-0.012, 0.005, -0.027), Vector3::new(0.1, 0.2, -1.0).normalize()),
    ];
    let prescribed = Twist { linear: Vector3::new(0.01, -0.02, 0.0), angular: Vector3::new(0.0, 0.0, 0.1) };
    let patch = Patch { sides: [BodyKind::Object(0), BodyKind::Scenery], first: 0, last: points.len(), prescribed };
    let object = ObjectTerms { mass: 0.2, inertia: Matrix3::identity() * 7e-5, ..ObjectTerms::default() };
    let mut problem = Problem {
        dt: 0.002,
        stick_speed: STICK,
        objects: vec![object],
        points,
        patches: vec![patch],
        ..Problem::new(&model)
    };
    problem.enter(&model, &Kinematics::default(), (true, &[0], &[0]));
    (model, problem)
}

/// The contact impulses of the module's documentation, on the second body, point by point.
#[test]
fn impulses_follow_the_documented_laws() {
    let (model, mut problem) = ball();
    let kinematics = Kinematics::default();
    problem.v.copy_from_slice(&[0.05, 0.0, -0.004, 0.3, -0.2, 0.1]);
    problem.evaluate(&model, &kinematics, Bounds::Follow);
    let twist = problem.touching[0].relative_twist(&problem.patches[0].prescribed, &kinematics, &problem.v);
    let mut force = Vector3::zeros();
    for point in &problem.points {
        let u = twist.at(&point.arm);
        let normal_speed = point.normal.dot(&u);
        let slip = u - point.normal * normal_speed;
        let g = (point.stiffness * (point.target - normal_speed)).max(0.0);
        assert!((point.impulse - g).abs() < 1e-12 && g > 0.0, "{point:?}");
        force += point.normal * g - slip * (point.friction * g / slip.norm().max(STICK));
    }
    // The residual of the object has minus J^T c, whose sign for the first body is minus.
    for i in 0..3 {
        let expected = 0.2 * problem.v[i] + force[i];
        assert!((problem.residual[i] - expected).abs() < 1e-12, "axis {i}");
    }
}

/// Asserts that the derivative at `v` is that of the residual by differences of `h`, and symmetric if the bounds are frozen.
fn check_derivative(problem: &mut Problem, model: &Model, kinematics: &Kinematics, v: &[f64], h: f64) {
    let n = problem.unknowns();
    for (bounds, slope) in [(Bounds::Follow, Slope::Follow), (Bounds::Frozen, Slope::Frozen)] {
        problem.v.copy_from_slice(v);
        problem.evaluate(model, kinematics, Bounds::Follow);
        problem.differentiate(model, kinematics, slope);
        let derivative = problem.derivative.clone();
        for j in 0..n {
            let mut residual = |step: f64| {
                problem.v.copy_from_slice(v);
                problem.evaluate(model, kinematics, Bounds::Follow);
                problem.v[j] += step;
                problem.evaluate(model, kinematics, bounds);
                problem.residual.clone()
            };
            let (after, before) = (residual(h), residual(-h));
            for i in 0..n {
                let expected = (after[i] - before[i]) / (2.0 * h);
                let found = derivative.row(i)[j];
                assert!(
                    (found - expected).abs() < 1e-4 * expected.abs().max(1.0),
                    "{bounds:?} {i} {j}: {found} {expected}"
                );
                let mirrored = derivative.row(j)[i];
                let symmetric = (found - mirrored).abs() < 1e-9 * found.abs().max(1.0);
                assert!(symmetric || bounds == Bounds::Follow, "{i} {j}: {found} {mirrored}");
            }
        }
    }
}

/// Where the object slides and where it sticks, with bounds that follow and that are frozen: the derivative is that of the residual, and
/// symmetric if the bounds are frozen. A bug here: a lost coupling of friction to the normal speed, a wrong sign.
#[test]
fn the_derivative_is_that_of_the_residual() {
    let (model, mut problem) = ball();
    // The table's velocity at the points, for the object that sticks.
    let sticks = [0.01, -0.02, 4e-6, 0.0, 0.0, 0.1];
    let slides = [0.05, 0.0, -0.004, 0.3, -0.2, 0.1];
    for (v, h) in [(slides, 1e-7), (sticks, 1e-9)] {
        check_derivative(&mut problem, &model, &Kinematics::default(), &v, h);
    }
}

/// The secant is at least as steep as the derivative in every direction, and steeper where the object slides. A bug here: a step that overshoots.
#[test]
fn the_secant_is_steeper_than_the_derivative() {
    let (model, mut problem) = ball();
    let kinematics = Kinematics::default();
    problem.v.copy_from_slice(&[0.05, 0.0, -0.004, 0.3, -0.2, 0.1]);
    problem.evaluate(&model, &kinematics, Bounds::Follow);
    let mut along = |slope: Slope, direction: &[f64; 6]| {
        problem.differentiate(&model, &kinematics, slope);
        let row = |i: usize| problem.derivative.row(i).iter().zip(direction).map(|(d, x)| d * x).sum::<f64>();
        (0..6).map(|i| direction[i] * row(i)).sum::<f64>()
    };
    let forward = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert!(along(Slope::Secant, &forward) > 1.2 * along(Slope::Frozen, &forward));
    for k in 0..20 {
        let direction = std::array::from_fn(|i| f64::from(7 * k + 5 * i as i32 + k * i as i32).sin());
        let (secant, derivative) = (along(Slope::Secant, &direction), along(Slope::Frozen, &direction));
        assert!(secant >= derivative - 1e-9 * derivative.abs(), "{direction:?}: {secant} {derivative}");
    }
}

/// Two balls against each other, the table and a finger. A bug here: a lever to the reference point with the wrong sign, or on one side only.
#[test]
fn objects_and_hand_are_coupled_by_the_derivative() {
    let model = Model::of_balls_and_finger();
    let mut kinematics = Kinematics::default();
    kinematics.place(&model, &[0.4, -0.7]);
    kinematics.differentiate(&model, &Vector3::new(0.02, 0.01, 0.05), &[]);
    let (_, one) = ball();
    let mut points = Vec::new();
    let mut patches = Vec::new();
    let touching = [
        [BodyKind::Object(0), BodyKind::Scenery],
        [BodyKind::Object(0), BodyKind::Object(1)],
        [BodyKind::Object(1), BodyKind::Hand(2)],
        [BodyKind::Hand(1), BodyKind::Scenery],
    ];
    for (index, sides) in touching.into_iter().enumerate() {
        let first = points.len();
        points.extend(one.points.iter().map(|point| {
            let arm = point.arm + Vector3::new(0.02 * index as f64, -0.01, 0.015);
            Point { arm, moment: arm.cross(&point.normal), target: 2.0, ..*point }
        }));
        patches.push(Patch { sides, first, last: points.len(), prescribed: Twist::default() });
    }
    let mut problem = Problem { dt: 0.002, stick_speed: STICK, points, patches, ..Problem::new(&model) };
    let inertia = Matrix3::identity() * 7e-5;
    problem.objects[0] = ObjectTerms { mass: 0.2, inertia, ..ObjectTerms::default() };
    let lever = Some(Vector3::new(0.05, -0.03, 0.02));
    problem.objects[1] = ObjectTerms { mass: 0.3, inertia, lever, ..ObjectTerms::default() };
    for i in 0..2 {
        problem.hand.mass.row_mut(i)[i] = 1e-3;
    }
    problem.enter(&model, &kinematics, (true, &[0, 1], &[0, 1, 2, 3]));
    let v: Vec<f64> = (0..problem.unknowns()).map(|i| 0.1 * (1.7 * i as f64 + 0.3).sin()).collect();
    check_derivative(&mut problem, &model, &kinematics, &v, 1e-7);
}
