//! Observers see every step of a trial up to the end of the hold, and delay early stops only where the config requires it.
#![allow(clippy::unwrap_used)]

use graspbox_episode::{
    Body, Episode, ObjectSpec, Observer, Progress, Scene, ShakeConfig, Study, TrialConfig, run_observed_trials,
};
use graspbox_hand::{GraspPose, Hand};
use graspbox_mesh::convex_hull;
use graspbox_sim::PhysicsConfig;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::PI;
use std::sync::Arc;

/// Counts the calls, and waits for the end of the trial.
#[derive(Clone, Debug, Default, PartialEq)]
struct Count {
    steps: u64,
    /// Steps before the lift began.
    lifted_at: Vec<u64>,
}

impl Observer for Count {
    fn begin_lift(&mut self, _: &Episode) {
        self.lifted_at.push(self.steps);
    }

    fn observe(&mut self, episode: &Episode) {
        self.steps += 1;
        let time = self.steps as f64 * episode.world().dt();
        assert!((episode.world().time() - time).abs() < 1e-9, "a step was not observed");
    }

    fn pending(&self) -> bool {
        true
    }
}

/// A block of 6 x 6 x 10 cm at rest, and the pose of a hand above it, palm down, `aside` metres along x.
fn block(aside: f64) -> (Arc<Scene>, GraspPose) {
    let corner = |i: usize| Point3::new([-0.03, 0.03][i & 1], [-0.03, 0.03][i >> 1 & 1], [-0.05, 0.05][i >> 2]);
    let mesh = convex_hull(&(0..8).map(corner).collect::<Vec<_>>()).unwrap();
    let body = Body::prepare(&ObjectSpec { name: "block".into(), mesh, mass: Some(0.2), parts: None }, None).unwrap();
    let scene = Scene::new(&body, Arc::new(Hand::reflex().unwrap().clone()), PhysicsConfig::default(), None).unwrap();
    let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
    let object_from_hand = Isometry3::from_parts(Translation3::new(aside, 0.0, 0.07), down);
    (Arc::new(scene), GraspPose { object_from_hand, preshape: 0.0 })
}

/// A bug here: an observer that misses a step or sees the shake, a lift that is announced late, an early stop that does not wait.
#[test]
fn observers_see_a_trial_to_the_end_of_its_hold() {
    let run = |aside: f64, config: TrialConfig| {
        let (scene, pose) = block(aside);
        let count = |_: &Episode| Count::default();
        let found =
            run_observed_trials(&scene, &[pose], &[[1.0, 1.0]], config, &Progress::default(), count).unwrap().remove(0);
        (found.outcome, found.observer.unwrap())
    };
    let whole = Count { steps: 1650, lifted_at: vec![650] };
    let shaken = TrialConfig { shake: Some(ShakeConfig::default()), ..TrialConfig::default() };
    let (outcome, count) = run(0.0, shaken);
    assert!(outcome.success && outcome.time > 3.5, "{outcome:?}");
    assert_eq!(count, whole, "the shake is not observed");

    let (outcome, count) = run(0.3, TrialConfig::default());
    assert!(!outcome.success && count.steps < 1650 && count.lifted_at == [650], "a miss ends early: {count:?}");
    let waiting = TrialConfig { await_observer: true, ..TrialConfig::default() };
    assert_eq!(run(0.3, waiting).1, whole, "the trial waits for its observer");
}

/// A bug here: a reading of the study before or after its time, or one that an early stop cuts off although the trial waits.
#[test]
fn the_study_reads_once_after_two_and_a_half_seconds() {
    let (scene, pose) = block(0.3);
    for (await_observer, early_stop, time) in [(true, true, 2.5), (false, false, 3.3)] {
        let config = TrialConfig { await_observer, early_stop, ..TrialConfig::default() };
        let found =
            run_observed_trials(&scene, &[pose], &[[1.0, 1.0]], config, &Progress::default(), Study::new).unwrap();
        let measures = found[0].observer.as_ref().unwrap().measures();
        // The hand rises 0.2 m, the block stays: it did not follow, and the distance changes by the rise of the hand.
        let reading = measures.reading.unwrap();
        assert!(!reading.success && reading.kindness > 5.0, "{measures:?}");
        assert!((found[0].outcome.time - time).abs() < 0.02, "{}", found[0].outcome.time);
    }
    let found =
        run_observed_trials(&scene, &[pose], &[[1.0, 1.0]], TrialConfig::default(), &Progress::default(), Study::new);
    assert_eq!(found.unwrap()[0].observer.as_ref().unwrap().measures().reading, None, "cut off by the early stop");
}
