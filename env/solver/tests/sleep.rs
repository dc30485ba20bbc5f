//! Truths about sleep: what rests stays where it is, keeps its contacts, and wakes when it must.

#![allow(clippy::unwrap_used)]

#[allow(dead_code, reason = "shared with `many_objects`")]
mod common;

use common::{DT, GRAVITY, Scene, at, ball, cuboid};
use graspbox_solver::{FrameMotion, StepInput};
use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

const HALF: f64 = 0.025;

/// Two stacks of two boxes, and a ball that is thrown at the second after it has fallen asleep.
fn stacks() -> Scene {
    let cube = || cuboid([HALF; 3], 0.2, 0.8);
    let mut objects: Vec<_> =
        [-0.2, 0.2].into_iter().flat_map(|x| [(cube(), at(x, 0.0, HALF)), (cube(), at(x, 0.0, 3.0 * HALF))]).collect();
    objects.push((ball(0.02, 0.3, 0.5), at(0.0, 0.4, 0.02)));
    Scene::new(objects)
}

fn asleep(scene: &Scene) -> Vec<bool> {
    scene.solver.state().objects.iter().map(|object| object.asleep.is_some()).collect()
}

fn contacts(scene: &Scene) -> Vec<(usize, usize, f64)> {
    let mut found = Vec::new();
    scene
        .solver
        .contacts(|_, _| true, |contact| found.push((contact.sides[0].body, contact.sides[1].body, contact.force)));
    found.sort_by(|a, b| (a.0, a.1).cmp(&(b.0, b.1)).then(a.2.total_cmp(&b.2)));
    found
}

/// Steps while the base moves and turns, and returns the greatest way of an object in the world.
fn run_with_moving_base(scene: &mut Scene, steps: usize) -> f64 {
    let before = scene.centers();
    for step in 0..steps {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.1, 0.2, 0.3) * (step as f64 + 1.0) * DT);
        let next = Isometry3::from_parts(Translation3::new(0.0, 0.05 * (step as f64 + 1.0) * DT, 1.0), turn);
        let omega = turn.inverse() * Vector3::new(0.1, 0.2, 0.3);
        let gravity = next.rotation.inverse() * Vector3::new(0.0, 0.0, -GRAVITY);
        scene.solver.step(&StepInput {
            dt: DT,
            base_from_world: scene.world_from_base.inverse(),
            base_from_world_after: next.inverse(),
            frame: FrameMotion { gravity, omega, alpha: Vector3::zeros() },
            forces: &[],
            driven: &[],
            cables: &[],
            idle: 0,
        });
        scene.world_from_base = next;
    }
    scene.centers().iter().zip(&before).map(|(now, before)| (now - before).norm()).fold(0.0, f64::max)
}

/// A bug here: sleepers that creep, or that stay where they are in the hand's frame.
#[test]
fn sleepers_keep_their_place_in_the_world() {
    let mut scene = stacks();
    scene.run(1.0);
    assert_eq!(asleep(&scene), [true; 5]);
    let moved = run_with_moving_base(&mut scene, 200);
    assert!(moved < 1e-12, "a sleeper moved by {moved} m");
    assert_eq!(asleep(&scene), [true; 5]);
}

/// A bug here: sleeping objects that `carried_by_scenery` reports as hanging in the air.
#[test]
fn sleepers_keep_their_contacts() {
    let mut scene = stacks();
    scene.run(0.15);
    let before = contacts(&scene);
    scene.run(1.0);
    assert_eq!(asleep(&scene), [true; 5]);
    let after = contacts(&scene);
    assert_eq!(before.len(), after.len());
    let weight: f64 =
        after.iter().filter(|(_, other, _)| *other == scene.solver.model().scenery_body()).map(|c| c.2).sum();
    assert!((weight - 1.1 * GRAVITY).abs() < 0.01 * GRAVITY, "the table carries {weight} N");
    for (one, other) in before.iter().zip(&after) {
        assert_eq!((one.0, one.1), (other.0, other.1));
    }
}

/// The ball wakes the stack that it hits; the other one sleeps on.
#[test]
fn what_is_touched_wakes() {
    let mut scene = stacks();
    scene.run(1.0);
    // It rolls towards the second stack. Setting its state wakes all, which then fall asleep again before it arrives.
    let state = &mut scene.solver.state_mut().objects[4];
    (state.linear, state.angular) = (Vector3::new(0.3, -0.6, 0.0), Vector3::new(30.0, 15.0, 0.0));
    scene.run(0.35);
    assert_eq!(asleep(&scene), [true, true, true, true, false]);
    let before = scene.center(2);
    scene.run(0.4);
    assert!((scene.center(2) - before).norm() > 1e-3, "the stack was not pushed");
    assert_eq!(asleep(&scene)[..2], [true, true]);
    scene.run(3.0);
    assert_eq!(asleep(&scene)[..4], [true; 4]);
}

/// Steps once with forces on the objects, N.
fn push(scene: &mut Scene, forces: &[Vector3<f64>]) {
    let base_from_world = scene.world_from_base.inverse();
    let frame = FrameMotion { gravity: scene.gravity, omega: Vector3::zeros(), alpha: Vector3::zeros() };
    scene.solver.step(&StepInput {
        dt: DT,
        base_from_world,
        base_from_world_after: base_from_world,
        frame,
        forces,
        driven: &[],
        cables: &[],
        idle: 0,
    });
}

/// With a strong force on one box of a stack both wake, in the same step; the other stack sleeps on.
#[test]
fn a_changed_load_wakes() {
    for pushed in [2, 3] {
        let mut scene = stacks();
        scene.run(1.0);
        let mut forces = [Vector3::zeros(); 5];
        forces[pushed].x = 3.0;
        push(&mut scene, &forces);
        assert_eq!(asleep(&scene), [true, true, false, false, true], "box {pushed}");
    }
}

/// The upper box of a stack is lifted off: the lower one wakes, and then sleeps with its own weight alone.
#[test]
fn a_load_that_is_taken_away_wakes() {
    let mut scene = stacks();
    scene.run(1.0);
    let mut forces = [Vector3::zeros(); 5];
    forces[3].z = 3.0;
    push(&mut scene, &forces);
    assert_eq!(asleep(&scene), [true, true, false, false, true]);
    for _ in 0..200 {
        push(&mut scene, &forces);
    }
    assert!(scene.center(3).z > 4.0 * HALF, "the upper box was not lifted");
    assert!(asleep(&scene)[2]);
    let table = scene.solver.model().scenery_body();
    let weight: f64 = contacts(&scene).iter().filter(|c| (c.0, c.1) == (2, table)).map(|c| c.2).sum();
    assert!((weight - 0.2 * GRAVITY).abs() < 0.01 * GRAVITY, "the table carries {weight} N");
}

/// A push that friction holds wakes the box alone: the one that bears it sleeps on, and both keep their places and contacts.
#[test]
fn a_small_change_leaves_what_bears_it_asleep() {
    let mut scene = stacks();
    scene.run(1.0);
    let (before, places) = (contacts(&scene), scene.centers());
    let mut forces = [Vector3::zeros(); 5];
    forces[3].x = 0.05;
    for _ in 0..200 {
        push(&mut scene, &forces);
        assert!(asleep(&scene)[2], "the lower box woke");
    }
    let after = contacts(&scene);
    assert_eq!(before.len(), after.len());
    for (one, other) in before.iter().zip(&after) {
        assert_eq!((one.0, one.1), (other.0, other.1));
    }
    let borne =
        |found: &[(usize, usize, f64)]| -> f64 { found.iter().filter(|c| (c.0, c.1) == (2, 3)).map(|c| c.2).sum() };
    assert!((borne(&after) - 0.2 * GRAVITY).abs() < 0.01 * GRAVITY, "the lower box bears {} N", borne(&after));
    for (place, now) in places.iter().zip(scene.centers()) {
        assert!((now - place).norm() < 1e-4, "an object moved from {place} to {now}");
    }
    scene.run(0.5);
    assert_eq!(asleep(&scene), [true; 5]);
}

/// A bug here: a state that forgets who sleeps, or what touches whom.
#[test]
fn snapshots_of_sleepers_continue_with_the_same_bits() {
    let mut scene = stacks();
    scene.run(1.0);
    let mut other = stacks();
    other.solver.load(scene.solver.save()).unwrap();
    assert_eq!(contacts(&scene), contacts(&other));
    for each in [&mut scene, &mut other] {
        each.run(0.01);
    }
    assert_eq!(asleep(&other), [true; 5]);
    assert_eq!(contacts(&scene), contacts(&other));
    // One box awake on a sleeper, which remembers its load.
    let mut forces = [Vector3::zeros(); 5];
    forces[3].x = 0.05;
    push(&mut scene, &forces);
    other.solver.load(scene.solver.save()).unwrap();
    assert_eq!(contacts(&scene), contacts(&other));
    for forces in [forces, [Vector3::x(); 5]] {
        for each in [&mut scene, &mut other] {
            push(each, &forces);
        }
        assert_eq!(contacts(&scene), contacts(&other));
        assert_eq!(asleep(&scene), asleep(&other));
    }
    for each in [&mut scene, &mut other] {
        each.solver.state_mut().objects[4].linear = Vector3::new(0.3, -0.6, 0.0);
        each.run(0.7);
    }
    assert_eq!(scene.centers(), other.centers());
    assert_eq!(asleep(&scene), asleep(&other));
}
