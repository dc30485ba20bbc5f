//! Grasps among other objects: the filter refuses what touches them, the approach pushes them aside, and the judges know what carries what.

#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_episode::{
    Approach, Body, Episode, FailureKind, Progress, Scene, SuccessCriterion, Trial, TrialConfig, approach, run_trials,
    trace_trial,
};
use graspbox_hand::assets::asset;
use graspbox_hand::{GraspPose, Hand};
use graspbox_plan::{Feasibility, PlanParams};
use graspbox_sim::PhysicsConfig;
use graspbox_tests::scenes::{cuboid, hull};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;

fn hand() -> Arc<Hand> {
    Arc::new(asset("panda_gripper").unwrap().read().unwrap())
}

/// Radius of [`roll`], metres.
const ROLL: f64 = 0.015;

/// A cylinder that lies along y.
fn roll() -> Body {
    let ring = |y: f64| {
        (0..32).map(move |i| {
            let angle = f64::from(i) * std::f64::consts::TAU / 32.0;
            Point3::new(ROLL * angle.cos(), y, ROLL * angle.sin())
        })
    };
    hull("roll", &ring(-0.03).chain(ring(0.03)).collect::<Vec<_>>(), 0.05)
}

/// A low box and four rolls.
fn bodies() -> Vec<Body> {
    std::iter::once(cuboid("inner", [0.015, 0.02, 0.02], 0.15)).chain((0..4).map(|_| roll())).collect()
}

/// The rolls around the box, their axes at a distance of `reach` from its own.
fn hemmed_in(bodies: &[Body], reach: f64, target: Option<usize>) -> Arc<Scene> {
    let rolls = (0..4).map(|quarter| {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), f64::from(quarter) * FRAC_PI_2);
        Isometry3::from_parts((turn * Vector3::new(reach, 0.0, ROLL)).into(), turn)
    });
    let poses: Vec<_> = std::iter::once(Isometry3::translation(0.0, 0.0, 0.02)).chain(rolls).collect();
    let all: Vec<&Body> = bodies.iter().collect();
    Arc::new(Scene::of_objects(&all, &poses, &[], target, hand(), PhysicsConfig::default()).unwrap())
}

/// The best planned grasp of the box from above, as if it stood alone, and a reach at which rolls are a little in the way of its fingers, metres.
fn from_above(bodies: &[Body]) -> (GraspPose, f64) {
    let pose = Isometry3::translation(0.0, 0.0, 0.02);
    let alone = Scene::of_objects(&[&bodies[0]], &[pose], &[], None, hand(), PhysicsConfig::default()).unwrap();
    let plan = alone.plan(&bodies[0], &PlanParams::default()).unwrap();
    let down = |grasp: &GraspPose| (grasp.object_from_hand * Vector3::z()).z < -0.999;
    let grasp = plan.ranked().iter().map(|candidate| candidate.grasp).find(down).unwrap();
    let free =
        |reach: &f64| hemmed_in(bodies, *reach, None).check(&[grasp], 0.0, 0.1).unwrap() == [Feasibility::Feasible];
    (grasp, (0..40).map(|i| 0.05 + 0.002 * f64::from(i)).find(free).unwrap() - 0.004)
}

#[test]
fn an_approach_pushes_neighbours_aside() {
    let bodies = bodies();
    let (grasp, reach) = from_above(&bodies);
    let scene = hemmed_in(&bodies, reach, None);
    assert_eq!((scene.target(), scene.is_any_target()), (0, true), "the box is the highest");
    assert_eq!(scene.check(&[grasp], 0.0, 0.1).unwrap(), [Feasibility::HitsNeighbour]);
    let tried = |scene: &Arc<Scene>| {
        run_trials(scene, &[grasp], TrialConfig::default(), &Progress::default()).unwrap().remove(0)
    };
    assert!(tried(&scene).success, "{:?}", tried(&scene));
    // With a target, as with a single object, nothing may be touched.
    assert_eq!(tried(&hemmed_in(&bodies, reach, Some(0))).failure, Some(FailureKind::Infeasible));
    // With room for the fingers nothing is pushed.
    let roomy = hemmed_in(&bodies, 0.15, None);
    assert_eq!(roomy.check(&[grasp], 0.0, 0.1).unwrap(), [Feasibility::Feasible]);
    assert!(tried(&roomy).success);
}

/// A bug here: a trace that leaves out a neighbour, or that ends elsewhere than the world.
#[test]
fn a_trace_has_the_motion_of_every_object() {
    let bodies = bodies();
    let (grasp, reach) = from_above(&bodies);
    let scene = hemmed_in(&bodies, reach, None);
    let (config, rest, factors) = (TrialConfig::default(), scene.world_from_object(), [1.0, 1.0]);
    let trace = trace_trial(&scene, &grasp, factors, config, &Progress::default(), |_| ()).unwrap().trace;
    let begun = approach(&scene, &grasp, rest, factors, SuccessCriterion::default(), config.standoff).unwrap();
    let Approach::Arrived(episode) = begun else { panic!("the neighbours are in the way") };
    let mut trial = Trial::of(episode, &(rest * grasp.object_from_hand), grasp.preshape, config, (), false);
    assert!(trial.close(&|| false).unwrap() && trial.lift(&|| false).unwrap());
    let ends: Vec<_> = trial.episode().world().world_from_objects().collect();
    let last = trace.last().unwrap();
    assert_eq!((last.world_from_object, &last.world_from_others[..]), (ends[0], &ends[1..]));
    assert!(last.world_from_object.translation.z > 0.1);
    let pushed = |(object, now): (usize, &Isometry3<f64>)| {
        (now.translation.vector - scene.world_from(object + 1).translation.vector).norm() > 1e-3
    };
    assert!(trace[0].world_from_others.iter().enumerate().any(pushed), "the approach pushes them aside");
}

/// A bug here: a trace that mixes up the objects once the hand has chosen another one than the scene's.
#[test]
fn a_trace_keeps_the_order_of_the_objects() {
    let bodies = bodies();
    let (grasp, _) = from_above(&bodies);
    let poses = [0.0, 0.2].map(|x| Isometry3::translation(x, 0.0, 0.02));
    let scene = Scene::of_objects(&[&bodies[0], &bodies[0]], &poses, &[], None, hand(), PhysicsConfig::default());
    let scene = Arc::new(scene.unwrap());
    assert_eq!(scene.target(), 1, "the last one of equal height");
    let first =
        GraspPose { object_from_hand: Isometry3::translation(-0.2, 0.0, 0.0) * grasp.object_from_hand, ..grasp };
    let trial = trace_trial(&scene, &first, [1.0, 1.0], TrialConfig::default(), &Progress::default(), |_| ()).unwrap();
    assert!(trial.outcome.success, "{:?}", trial.outcome);
    for sample in &trial.trace {
        let there = sample.world_from_object.translation.vector - poses[1].translation.vector;
        assert!(there.norm() < 1e-3, "nothing touches the scene's object: {there:?}");
    }
    assert!(trial.trace.last().unwrap().world_from_others[0].translation.z > 0.1);
}

#[test]
fn a_hand_stops_on_what_does_not_give_way() {
    let bodies = bodies();
    let (grasp, reach) = from_above(&bodies);
    let scene = hemmed_in(&bodies, reach, None);
    let begin = |pose: &GraspPose, standoff| {
        let object = scene.world_from_object();
        approach(&scene, pose, object, [1.0, 1.0], SuccessCriterion::default(), standoff).unwrap()
    };
    // The fingers meet the table.
    let mut deep = grasp;
    deep.object_from_hand.translation.vector.z -= 0.06;
    let Approach::Stopped(episode) = begin(&deep, 0.15) else { panic!("the table is in the way") };
    let hand_at = episode.world().world_from_hand().translation.z;
    assert!(hand_at > (scene.world_from_object() * deep.object_from_hand).translation.z, "it stopped above its goal");
    assert!(matches!(begin(&deep, 0.0), Approach::NoRoom));
    assert!(matches!(begin(&grasp, 0.1), Approach::Arrived(_)));
    let outcomes = run_trials(&scene, &[deep], TrialConfig::default(), &Progress::default()).unwrap();
    assert_eq!(outcomes[0].failure, Some(FailureKind::Infeasible));
}

#[test]
fn an_object_on_another_one_is_not_in_the_air() {
    let bodies = [cuboid("lower", [0.05, 0.05, 0.1], 0.5), cuboid("upper", [0.02, 0.02, 0.02], 0.1)];
    let poses = [Isometry3::translation(0.0, 0.0, 0.1), Isometry3::translation(0.0, 0.0, 0.22)];
    let all: Vec<&Body> = bodies.iter().collect();
    let scene = Arc::new(Scene::of_objects(&all, &poses, &[], None, hand(), PhysicsConfig::default()).unwrap());
    assert_eq!(scene.name(), "upper");
    let away = Isometry3::translation(0.0, 0.0, 1.5);
    let mut episode = Episode::reset(&scene, &away, 0.0, SuccessCriterion::default());
    for _ in 0..250 {
        episode.advance(&away, &[]).unwrap();
    }
    assert!(episode.judges().iter().all(graspbox_episode::Judge::on_scenery));
    assert_eq!(episode.held_objects().count(), 0);
    assert!(!episode.world().object_on_scenery(), "it touches only the other box");
}
