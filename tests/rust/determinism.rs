//! The same bits on every run, and snapshots that are refused where they cannot be restored.
//!
//! A mismatch is always a bug: something iterates in an order that is not fixed, shares state between worlds, or is missing
//! from a clone or snapshot.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_episode::{
    Body, Draw, Finished, Layout, Progress, Sample, Scene, Study, Trial, TrialConfig, run_observed_trials,
};
use graspbox_hand::{ActuatorCommand, GraspPose};
use graspbox_objects::Family;
use graspbox_sim::{Geometry, PhysicsConfig, SimError, Template, World};
use graspbox_tests::bench::{at, bits, closing, in_pool, palm_down, reflex, template};
use graspbox_tests::scenes::{planned, procedural, scene};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use rayon::prelude::*;
use std::sync::Arc;

/// A can with a hand over it; the trial closes, lifts with a turn, and holds.
struct Case {
    template: Template,
    start: Isometry3<f64>,
    object: Isometry3<f64>,
    close: Vec<ActuatorCommand>,
}

impl Case {
    fn new(geometry: &Geometry, height: f64) -> Self {
        let hand = reflex();
        let close = closing(&hand, 0.3);
        Self {
            template: template(hand, geometry, 0.2, PhysicsConfig::default()),
            start: palm_down(0.0, 0.0, height + 0.02),
            object: at(0.0, 0.0, height / 2.0),
            close,
        }
    }

    fn all() -> [Self; 2] {
        let can = Geometry::Cylinder { radius: 0.034, half_length: 0.05 };
        [Self::new(&can, 0.10), Self::new(&Geometry::Cuboid(Vector3::new(0.025, 0.04, 0.05)), 0.10)]
    }

    fn spawn(&self) -> World {
        self.template.spawn(&self.start, &self.object, 0.3)
    }

    /// Step `i` of the script: close for 0.8 s, then rise and turn.
    fn step(&self, world: &mut World, i: usize) {
        let t = (i as f64 * world.dt() - 0.8).max(0.0);
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.4 * t, 0.2 * t, t));
        let target = Isometry3::from_parts(
            Translation3::from(self.start.translation.vector + Vector3::new(0.0, 0.0, 0.2 * t)),
            turn * self.start.rotation,
        );
        world.step(&target, &self.close).unwrap();
    }

    /// The bits after every step from `from` to `to`.
    fn run(&self, world: &mut World, from: usize, to: usize) -> Vec<Vec<u64>> {
        let step = |i| {
            self.step(world, i);
            bits(world)
        };
        (from..to).map(step).collect()
    }
}

/// Steps at which a run is cut: before any contact, while fingers close in, pressed, in the air, turning.
const CUTS: [usize; 5] = [50, 300, 399, 500, 640];
const END: usize = 700;

#[test]
fn a_run_can_be_repeated_and_carries_on_from_snapshot_and_clone() {
    for case in Case::all() {
        let whole = case.run(&mut case.spawn(), 0, END);
        assert_eq!(whole, case.run(&mut case.spawn(), 0, END), "the same run twice");
        let mut touched = false;
        for cut in CUTS {
            let mut world = case.spawn();
            case.run(&mut world, 0, cut);
            touched |= world.contacts().links.len() > 2;
            let bytes = world.snapshot().unwrap();
            let mut copy = world.clone();
            // The original continues first: a clone that shares state with it would differ.
            assert_eq!(whole[cut..], case.run(&mut world, cut, END), "after taking a snapshot at {cut}");
            let mut back = case.template.restore(&bytes).unwrap();
            assert_eq!(bytes, back.snapshot().unwrap(), "a snapshot of what was restored at {cut}");
            assert_eq!(whole[cut..], case.run(&mut back, cut, END), "restored at {cut}");
            assert_eq!(whole[cut..], case.run(&mut copy, cut, END), "cloned at {cut}");
            // Another template of the same object, hand and settings, as another process would build it.
            let mut elsewhere = Case::all().into_iter().find_map(|c| c.template.restore(&bytes).ok()).unwrap();
            assert_eq!(whole[cut..], case.run(&mut elsewhere, cut, END), "restored elsewhere at {cut}");
        }
        assert!(touched, "no cut was in the middle of contact");
        assert!(case.spawn().contacts().links.is_empty());
    }
}

/// A fresh world does not depend on the worlds that were spawned and stepped before it.
#[test]
fn a_reset_forgets_what_was_before() {
    let [case, _] = Case::all();
    let first = case.run(&mut case.spawn(), 0, 300);
    for steps in [1, 37, 250] {
        let mut other = case.spawn();
        case.run(&mut other, 0, steps);
        assert_eq!(first, case.run(&mut case.spawn(), 0, 300));
    }
}

fn objects(families: &[Family]) -> Vec<(Arc<Scene>, Vec<GraspPose>)> {
    let one = |(i, family): (usize, Family)| {
        let body = procedural(family, i as u64);
        let scene = scene(&body, PhysicsConfig::default());
        let poses = planned(&body, &scene, 4, 1);
        assert!(!poses.is_empty(), "{} has no pose", body.name());
        (scene, poses)
    };
    families.iter().copied().enumerate().map(one).collect()
}

/// Trials of the poses with the study's observer.
fn observed(scene: &Arc<Scene>, poses: &[GraspPose], config: TrialConfig) -> Vec<Finished<Study>> {
    let factors = vec![[1.0, 1.0]; poses.len()];
    run_observed_trials(scene, poses, &factors, config, &Progress::default(), Study::new).unwrap()
}

fn outcome_bits(trial: &Finished<Study>) -> Vec<u64> {
    let o = &trial.outcome;
    let measures = trial.observer.as_ref().map(Study::measures).unwrap_or_default();
    let label = [o.success, o.secure].map(u64::from);
    let kindness = measures.reading.map_or(-1.0, |reading| reading.kindness);
    let numbers = [o.lift, measures.kindness_rate, o.time, kindness].map(f64::to_bits);
    let why = o.failure.map_or(0, |f| 1 + f as u64);
    label.into_iter().chain(numbers).chain([why]).collect()
}

fn trace_bits(trace: &[Sample]) -> Vec<u64> {
    let one = |s: &Sample| {
        let pose = s.world_from_object;
        let mut numbers = vec![s.time, s.distance, s.hand_force];
        numbers.extend(pose.translation.vector.iter().chain(pose.rotation.coords.iter()));
        numbers.extend(s.joints.iter().chain(&s.actuators).chain(&s.loads).chain(&s.tensions));
        numbers
    };
    trace.iter().flat_map(one).map(f64::to_bits).collect()
}

fn traced(scene: &Arc<Scene>, pose: &GraspPose) -> Vec<u64> {
    let trial = Trial::new(scene, pose, [1.0, 1.0], TrialConfig::default(), Study::new, true);
    let trial = trial.run(&|| false).unwrap().unwrap();
    assert!(!trial.trace.is_empty());
    let mut all = outcome_bits(&trial);
    all.extend(trace_bits(&trial.trace));
    all
}

#[test]
fn trials_do_not_depend_on_threads_or_company() {
    let config = TrialConfig::default();
    for (scene, poses) in objects(&[Family::Can, Family::Box, Family::Mug]) {
        let batch = |poses: &[GraspPose]| -> Vec<Vec<u64>> {
            observed(&scene, poses, config).iter().map(outcome_bits).collect()
        };
        let whole = in_pool(1, || batch(&poses));
        for threads in [2, 5] {
            assert_eq!(whole, in_pool(threads, || batch(&poses)), "{}: {threads} threads", scene.name());
        }
        let mut backwards: Vec<_> = poses.clone();
        backwards.reverse();
        let mut mirrored = in_pool(2, || batch(&backwards));
        mirrored.reverse();
        assert_eq!(whole, mirrored, "{}: in another order", scene.name());
        for (pose, expected) in poses.iter().zip(&whole) {
            assert_eq!(&batch(std::slice::from_ref(pose))[0], expected, "{}: alone", scene.name());
        }
        let alone: Vec<_> = poses.iter().map(|p| traced(&scene, p)).collect();
        let together = in_pool(3, || poses.par_iter().map(|p| traced(&scene, p)).collect::<Vec<_>>());
        assert_eq!(alone, together, "{}: traces", scene.name());
    }
}

/// A pile of objects, each of them the target once, and once any of them may be, with the best poses for each.
fn pile() -> Vec<(Arc<Scene>, Vec<GraspPose>)> {
    let families = [Family::Can, Family::Box, Family::Mug, Family::Bottle];
    let bodies: Vec<Body> = families.iter().zip(0..).map(|(family, seed)| procedural(*family, seed)).collect();
    let (hand, physics) = (Arc::new(reflex()), PhysicsConfig::default());
    let heap =
        Layout::Pile.arrange(&bodies.iter().collect::<Vec<_>>(), &Draw::seeded(1), &hand, physics, None).unwrap();
    let kept: Vec<&Body> = heap.objects.iter().map(|index| &bodies[*index]).collect();
    assert!(kept.len() > 2, "only {} objects stayed", kept.len());
    let one = |target: Option<usize>| {
        let (poses, walls) = (&heap.world_from_objects, &heap.walls);
        let scene = Arc::new(Scene::of_objects(&kept, poses, walls, target, Arc::clone(&hand), physics).unwrap());
        let poses = planned(kept[scene.target()], &scene, 3, 1);
        (scene, poses)
    };
    (0..kept.len()).map(Some).chain([None]).map(one).collect()
}

#[test]
fn trials_among_several_objects_do_not_depend_on_threads() {
    let trials = || -> Vec<Vec<u64>> {
        let run = |(scene, poses): (Arc<Scene>, Vec<GraspPose>)| {
            observed(&scene, &poses, TrialConfig::default()).iter().map(outcome_bits).collect::<Vec<_>>()
        };
        pile().into_par_iter().flat_map_iter(run).collect()
    };
    let whole = in_pool(1, trials);
    let successes = whole.iter().filter(|bits| bits[0] == 1).count();
    assert!(
        successes > 0 && successes < whole.len(),
        "{successes} of {} succeed: equal labels test little",
        whole.len()
    );
    for threads in [2, 5] {
        assert_eq!(whole, in_pool(threads, trials), "{threads} threads");
    }
    let traces = |(scene, poses): &(Arc<Scene>, Vec<GraspPose>)| poses.first().map(|pose| traced(scene, pose));
    let scenes = pile();
    let alone: Vec<_> = scenes.iter().map(traces).collect();
    assert_eq!(alone, in_pool(5, || scenes.par_iter().map(traces).collect::<Vec<_>>()), "traces");
}

/// Scenes that are built anew from the same seed lead to the same bits: planning and settling are part of the promise.
#[test]
fn a_scene_built_again_gives_the_same_trials() {
    let labels = || -> Vec<Vec<u64>> {
        let run = |(scene, poses): (Arc<Scene>, Vec<GraspPose>)| {
            observed(&scene, &poses[..poses.len().min(3)], TrialConfig::default())
        };
        let objects = objects(&[Family::Mug]);
        objects.into_iter().flat_map(run).map(|o| outcome_bits(&o)).collect()
    };
    assert_eq!(labels(), labels());
}

/// A bug here: a bad command that is found after the actuators before it have moved.
#[test]
fn a_refused_command_moves_nothing() {
    let [case, _] = Case::all();
    let mut world = case.spawn();
    case.run(&mut world, 0, 50);
    let (before, hand) = (bits(&world), world.world_from_hand());
    let mut commands = case.close.clone();
    commands[2] = ActuatorCommand::Velocity(f64::NAN);
    assert_eq!(world.step(&hand, &commands), Err(SimError::BadCommand { actuator: 2 }));
    assert_eq!(before, bits(&world));
    assert_eq!(case.run(&mut case.spawn(), 0, 100)[50..], case.run(&mut world, 50, 100));
}

/// A bug here: a reported mass that lacks the factor of its world, or a factor that a snapshot forgets.
#[test]
fn a_scaled_mass_is_told_and_saved() {
    let [case, _] = Case::all();
    let mut world = case.spawn();
    let mass = world.object_mass();
    world.scale_object(1.0, 1.5);
    world.scale_object(0.5, f64::NAN);
    assert_eq!(world.object_mass(), 1.5 * mass);
    case.run(&mut world, 0, 3);
    assert_eq!(case.template.restore(&world.snapshot().unwrap()).unwrap().object_mass(), 1.5 * mass);
    assert_eq!(world.clone().object_mass(), 1.5 * mass);
}

fn refused(template: &Template, bytes: &[u8]) -> Option<String> {
    match template.restore(bytes) {
        Ok(_) => None,
        Err(SimError::BadSnapshot { why }) => Some(why),
        Err(other) => panic!("{other}"),
    }
}

/// A small generator of test bytes (Steele and others, splitmix64), so that the mutations are the same everywhere.
fn next(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

fn mutate(bytes: &[u8], state: &mut u64) -> Vec<u8> {
    let mut out = bytes.to_vec();
    let place = |state: &mut u64, n: usize| (next(state) % n as u64) as usize;
    match next(state) % 5 {
        0 => out.truncate(place(state, bytes.len())),
        1 => {
            for _ in 0..=next(state) % 8 {
                let i = place(state, out.len());
                out[i] ^= 1 << (next(state) % 8);
            }
        }
        2 => {
            let (i, n) = (place(state, out.len()), 1 + place(state, 64));
            let end = (i + n).min(out.len());
            out.drain(i..end);
        }
        3 => {
            let i = place(state, out.len());
            let extra: Vec<u8> = (0..=next(state) % 40).map(|_| next(state) as u8).collect();
            out.splice(i..i, extra);
        }
        _ => {
            let i = place(state, out.len());
            let end = (i + 9).min(out.len());
            out[i..end].fill(0xff);
        }
    }
    out
}

/// Length of the header of a snapshot: magic number and checksum.
const HEAD: usize = 8 + 32;

/// Damage is found by the checksum; and where someone made the checksum fit, reading still ends in an error or a world, never
/// in a panic.
/// A bug here: a length or an index that is not checked.
#[test]
fn a_damaged_snapshot_is_refused() {
    let [case, _] = Case::all();
    let mut world = case.spawn();
    case.run(&mut world, 0, 420);
    let good = world.snapshot().unwrap();
    assert_eq!(refused(&case.template, &good), None);
    for (bytes, why) in [
        (&good[..0], "it is of another kind or version"),
        (&good[..7], "it is of another kind or version"),
        (&good[..20], "it is too short"),
        (&good[..good.len() - 1], "its checksum does not match; it was cut off or changed"),
    ] {
        assert_eq!(refused(&case.template, bytes).as_deref(), Some(why));
    }
    let mut state = 7;
    let mut reasons = std::collections::BTreeMap::new();
    for _ in 0..500 {
        let bad = mutate(&good, &mut state);
        if bad != good {
            *reasons.entry(refused(&case.template, &bad).expect("damage was accepted")).or_insert(0) += 1;
        }
    }
    println!("500 damaged snapshots: {reasons:?}");
    let mut forged = std::collections::BTreeMap::new();
    for _ in 0..500 {
        let body = mutate(&good[HEAD..], &mut state);
        let mut bad = good[..8].to_vec();
        bad.extend_from_slice(blake3::hash(&body).as_bytes());
        bad.extend_from_slice(&body);
        *forged.entry(refused(&case.template, &bad).unwrap_or_else(|| "restored".into())).or_insert(0) += 1;
    }
    println!("500 snapshots with forged checksums: {forged:?}");
    assert!(forged.len() > 1 && forged.contains_key("restored"), "the mutations do not reach the reader: {forged:?}");
}

/// A snapshot belongs to its hand, its object and its settings.
#[test]
fn a_snapshot_of_another_world_is_refused() {
    let [case, other_object] = Case::all();
    let mut world = case.spawn();
    case.run(&mut world, 0, 100);
    let bytes = world.snapshot().unwrap();
    let can = Geometry::Cylinder { radius: 0.034, half_length: 0.05 };
    let mut fewer = reflex();
    fewer.tendons.pop();
    fewer.actuators.remove(2);
    fewer.grasp.closing.pop();
    fewer.grasp.coordinate = None;
    let mut softer = reflex();
    softer.tendons[0].stiffness *= 0.5;
    let mut smoother = reflex();
    smoother.friction.pad *= 0.5;
    let slower = PhysicsConfig { dt: 0.001, ..PhysicsConfig::default() };
    for (what, template) in [
        ("another hand", template(fewer, &can, 0.2, PhysicsConfig::default())),
        ("another tendon", template(softer, &can, 0.2, PhysicsConfig::default())),
        ("other pads", template(smoother, &can, 0.2, PhysicsConfig::default())),
        ("another object", other_object.template),
        ("another mass", template(reflex(), &can, 0.3, PhysicsConfig::default())),
        ("another time step", template(reflex(), &can, 0.2, slower)),
    ] {
        let why = Some("it belongs to another hand, object or physics setting");
        assert_eq!(refused(&template, &bytes).as_deref(), why, "a snapshot was restored into {what}");
    }
}
