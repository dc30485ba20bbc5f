//! Invalid inputs are refused with an error that names them, and simulations that diverge are labelled unstable.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_episode::{
    Body, EpisodeError, FailureKind, ObjectSpec, Progress, Scene, SuccessCriterion, TrialConfig, TrialOutcome,
    run_trials,
};
use graspbox_hand::{GraspPose, Hand};
use graspbox_mesh::convex_hull;
use graspbox_sim::PhysicsConfig;
use graspbox_sim::config::EngineKind;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};
use std::sync::Arc;

fn reflex() -> Hand {
    Hand::reflex().unwrap().clone()
}

/// A box of the given sides (metres) and mass (kg).
fn block(sides: [f64; 3], mass: Option<f64>) -> Body {
    let corner = |i: usize| Point3::from(Vector3::from_fn(|k, _| sides[k] * (f64::from((i >> k & 1) as u8) - 0.5)));
    let mesh = convex_hull(&(0..8).map(corner).collect::<Vec<_>>()).unwrap();
    Body::prepare(&ObjectSpec { name: "block".into(), mesh, mass, parts: None }, None).unwrap()
}

fn scene(body: &Body, hand: Hand) -> Result<Arc<Scene>, EpisodeError> {
    Ok(Arc::new(Scene::new(body, Arc::new(hand), PhysicsConfig::default(), None)?))
}

/// A hand above a block of 6 x 6 x 10 cm, palm down.
fn from_above(preshape: f64) -> GraspPose {
    let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
    GraspPose { object_from_hand: Isometry3::from_parts(Translation3::new(0.0, 0.0, 0.07), down), preshape }
}

fn small() -> Body {
    block([0.06, 0.06, 0.10], Some(0.2))
}

fn attempt(hand: Hand, pose: GraspPose, config: TrialConfig) -> Result<TrialOutcome, EpisodeError> {
    let outcomes = run_trials(&scene(&small(), hand).unwrap(), &[pose], config, &Progress::default())?;
    Ok(outcomes.into_iter().next().unwrap())
}

/// A bug here: preshapes beyond the joint limits that are simulated, above all those in degrees: 30 gave a lift of 22.8 m.
#[test]
fn preshapes_beyond_the_hand_are_refused() {
    for value in [-1.0, 2.0, 30.0, 180.0, f64::NAN] {
        let error = attempt(reflex(), from_above(value), TrialConfig::default()).unwrap_err();
        assert!(matches!(error, EpisodeError::BadPreshape { index: 0, .. }), "{error}");
    }
    let message = |value| attempt(reflex(), from_above(value), TrialConfig::default()).unwrap_err().to_string();
    assert_eq!(
        message(30.0),
        "preshape[0] is 30 rad, but the hand's range is 0 to 1.5707963267948966 rad; 30 looks like degrees: give 0.5236 rad"
    );
    assert!(!message(180.0).contains("degrees"), "pi is beyond the hand as well");
    assert!(attempt(reflex(), from_above(FRAC_PI_2 + 5e-8), TrialConfig::default()).is_ok(), "pi/2 as a float32");
}

/// A bug here: poses in millimetres, or with NaN, that are simulated far away from the object.
#[test]
fn poses_far_away_are_refused() {
    let mut pose = from_above(0.0);
    pose.object_from_hand.translation.vector *= 1000.0;
    let error = attempt(reflex(), pose, TrialConfig::default()).unwrap_err().to_string();
    assert!(error.starts_with("poses[0] is 70 m from the object's origin"), "{error}");
    pose.object_from_hand.translation.vector.x = f64::NAN;
    assert!(matches!(attempt(reflex(), pose, TrialConfig::default()), Err(EpisodeError::BadPose { .. })));
}

/// A bug here: files in another unit, or masses in grams, that are simulated.
#[test]
fn sizes_and_masses_of_another_unit_are_refused() {
    let refused = |sides, mass| scene(&block(sides, mass), reflex()).map(|_| ()).unwrap_err().to_string();
    let message = refused([60.0, 60.0, 100.0], Some(0.2));
    assert!(
        message.contains("60 x 60 x 100 m") && message.contains("the open hand 0.") && message.contains("by 0.001 "),
        "{message}"
    );
    assert!(refused([0.8, 0.8, 0.8], Some(0.2)).contains("the open hand is"));
    let message = refused([0.6, 0.6, 0.8], Some(20.0));
    assert!(
        message.contains("measures 0.6 x 0.6 x 0.8 m, but")
            && message.contains("the object's narrowest part is 0.60 m"),
        "{message}"
    );
    assert!(refused([6e-5, 6e-5, 1e-4], Some(0.2)).contains("multiply `scale=` by 1000 "));
    assert!(refused([0.06, 0.06, 0.1], Some(118.0)).contains("weighs 118 kg"));
    assert!(refused([0.06, 0.08, 0.3], Some(0.06 * 0.08 * 0.3 * 8e4)).contains("weighs 115.2 kg"));
    assert!(refused([0.01, 0.01, 0.01], Some(0.118)).contains("osmium"));
    assert!(scene(&block([1.1, 0.05, 0.05], Some(1.0)), reflex()).is_ok(), "a long stick is no mistake");
}

/// A block that the hand cannot span is refused; a crate of the same size is not, since it can be held by its wall.
#[test]
fn large_objects_need_a_part_that_the_hand_can_span() {
    let sides = Vector3::new(0.55, 0.55, 0.5);
    let slab = |low: Vector3<f64>, high: Vector3<f64>| -> Vec<Point3<f64>> {
        let corner = |i: usize| Point3::from(Vector3::from_fn(|k, _| if i >> k & 1 == 0 { low[k] } else { high[k] }));
        (0..8).map(corner).collect()
    };
    let wall = |axis: usize, end: bool| {
        let (mut low, mut high) = (Vector3::zeros(), sides);
        if end {
            low[axis] = sides[axis] - 0.02
        } else {
            high[axis] = 0.02
        }
        slab(low, high)
    };
    let walls = vec![wall(0, false), wall(0, true), wall(1, false), wall(1, true), wall(2, false)];
    let mesh = convex_hull(&slab(Vector3::zeros(), sides)).unwrap();
    let prepare = |parts| {
        let spec = ObjectSpec { name: "crate".into(), mesh: mesh.clone(), mass: Some(3.0), parts };
        Body::prepare(&spec, None).unwrap().check_fits(&reflex())
    };
    assert!(matches!(prepare(None), Err(EpisodeError::BadSize { .. })));
    assert!(prepare(Some(walls)).is_ok());
}

/// A bug here: a world that diverged and threw the object, reported as a hand that missed it.
#[test]
fn a_world_that_blows_up_is_unstable() {
    let mut hand = reflex();
    for tendon in &mut hand.tendons {
        tendon.stiffness = 1e9;
        tendon.max_tension = 1e9;
    }
    for joint in &mut hand.joints {
        joint.stop_stiffness = 1e9;
    }
    for actuator in &mut hand.actuators {
        actuator.load_limit = 1e9;
    }
    let under = |engine| {
        let physics = PhysicsConfig { engine, ..PhysicsConfig::default() };
        let scene = Arc::new(Scene::new(&small(), Arc::new(hand.clone()), physics, None).unwrap());
        let outcomes = run_trials(&scene, &[from_above(0.0)], TrialConfig::default(), &Progress::default()).unwrap();
        outcomes.into_iter().next().unwrap()
    };
    let outcome = under(EngineKind::Rapier);
    assert_eq!((outcome.success, outcome.failure), (false, Some(FailureKind::Unstable)), "{outcome:?}");
    // The engine `implicit` solves tendons implicitly: no stiffness makes it diverge.
    let outcome = under(EngineKind::Implicit);
    assert!(outcome.failure != Some(FailureKind::Unstable) && outcome.lift < 0.3, "{outcome:?}");
}

/// A bug here: a criterion that trials ignore, or ranges that do not follow it.
#[test]
fn the_criterion_decides() {
    let default = attempt(reflex(), from_above(0.0), TrialConfig::default()).unwrap();
    assert!(default.success, "{default:?}");
    let lifts_high = SuccessCriterion { lift_height: 0.19, ..SuccessCriterion::default() };
    let never_still = SuccessCriterion { rest_speed: 1e-4, hold_time: 1.0, ..SuccessCriterion::default() };
    let higher =
        attempt(reflex(), from_above(0.0), TrialConfig { success: lifts_high, ..TrialConfig::default() }).unwrap();
    let stiller =
        attempt(reflex(), from_above(0.0), TrialConfig { success: never_still, ..TrialConfig::default() }).unwrap();
    assert!(higher.success && !stiller.success, "{higher:?} {stiller:?}");
    assert_eq!(stiller.failure, Some(FailureKind::Unstable), "held high, but not still for a whole second");
    let low = TrialConfig { lift_height: 0.15, success: lifts_high, ..TrialConfig::default() };
    assert_eq!(low.validate().unwrap_err().to_string(), "`lift_height` is 0.15, but it must be between 0.19 and 1 m");
    let none = SuccessCriterion { rest_speed: 0.0, ..SuccessCriterion::default() };
    let message = none.validate().unwrap_err().to_string();
    assert_eq!(message, "`success.rest_speed` is 0, but it must be between 0.0001 and 1 m/s");
}
