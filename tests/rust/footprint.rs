//! What a reset, a world and a snapshot cost. The figures depend on the machine, so the bounds leave room for a busy one; the
//! goals are printed beside them.
#![allow(clippy::unwrap_used)]

use graspbox_objects::Family;
use graspbox_sim::{PhysicsConfig, World};
use graspbox_tests::bench::{closing, palm_down, run};
use graspbox_tests::scenes::{procedural, scene};
use std::time::Instant;

/// Resident memory of this process, bytes (Linux; none elsewhere).
fn resident() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmRSS:"))?;
    let kilobytes: f64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(1024.0 * kilobytes)
}

/// Median of the seconds that `work` takes, over `times` runs.
fn median(times: usize, mut work: impl FnMut()) -> f64 {
    let mut seconds: Vec<f64> = (0..times)
        .map(|_| {
            let clock = Instant::now();
            work();
            clock.elapsed().as_secs_f64()
        })
        .collect();
    seconds.sort_by(f64::total_cmp);
    seconds[times / 2]
}

/// A bug here: a reset that builds shapes anew instead of sharing them, a world that keeps its workspaces or its own copy of
/// the object's shape, a snapshot that takes in more than the state.
#[test]
fn resets_worlds_and_snapshots_are_small() {
    // Kept to the end: what one family frees would hide what the next one takes.
    let mut kept: Vec<World> = Vec::new();
    for family in [Family::Can, Family::Mug] {
        let body = procedural(family, 0);
        let scene = scene(&body, PhysicsConfig::default());
        let height = body.mesh().transformed(scene.world_from_object()).aabb().max.z;
        let start = palm_down(0.0, 0.0, (height + 0.01).max(0.11));
        let spawn = || scene.template().spawn(&start, scene.world_from_object(), 0.0);
        let reset = median(2001, || drop(std::hint::black_box(spawn())));
        let close = closing(scene.template().hand(), 0.0);
        let pressed = || -> World {
            let mut world = spawn();
            run(&mut world, &start, &close, 0.8);
            world
        };
        let first = pressed();
        assert!(!first.contacts().links.is_empty(), "the hand does not touch {}", body.name());
        let before = resident();
        kept.extend((0..200).map(|_| pressed()));
        let memory = resident().zip(before).map(|(after, before)| (after - before) / 200.0);
        let bytes = first.snapshot().unwrap();
        let save = median(21, || drop(std::hint::black_box(first.snapshot().unwrap())));
        let load = median(21, || drop(std::hint::black_box(scene.template().restore(&bytes).unwrap())));
        println!(
            "{} ({} parts): reset {:.1} us (goal 50); memory of a world in contact {} kB (goal 300); snapshot {:.0} kB, \
             taken in {:.2} ms, restored in {:.2} ms",
            body.name(),
            body.parts().len(),
            1e6 * reset,
            memory.map_or("?".to_owned(), |m| format!("{:.0}", m / 1e3)),
            bytes.len() as f64 / 1e3,
            1e3 * save,
            1e3 * load
        );
        assert!(reset < 5e-4, "a reset takes {reset} s");
        assert!(memory.is_none_or(|m| m < 6e5), "a world takes {memory:?} bytes");
        assert!(bytes.len() < 1_000_000);
    }
    assert_eq!(kept.len(), 400);
}
