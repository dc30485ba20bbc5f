//! Memory of worlds and size of snapshots, with bounds; the times of a reset and of a snapshot are printed and never asserted, since
//! they depend on the machine (`graspbox bench` reports them).
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

/// Most bytes of a world that is spawned and not stepped, of one whose hand presses on the object, and of a snapshot.
const FRESH: f64 = 1e5;
const PRESSED: f64 = 4e5;
const SNAPSHOT: usize = 200_000;
/// Worlds that are kept to measure the memory of one.
const KEPT: usize = 100;

/// Memory of one of [`KEPT`] worlds that `make` returns, bytes. They stay in `kept`: memory freed by one family would hide
/// that of the next.
fn memory_of(kept: &mut Vec<World>, make: impl Fn() -> World) -> Option<f64> {
    let before = resident();
    kept.extend((0..KEPT).map(|_| make()));
    resident().zip(before).map(|(after, before)| (after - before) / KEPT as f64)
}

/// A bug here: a reset that builds shapes anew instead of sharing them, a world that keeps its workspaces or its own copy of
/// the object's shape, a snapshot that contains more than the state.
#[test]
fn worlds_and_snapshots_are_small() {
    let mut kept: Vec<World> = Vec::new();
    for family in [Family::Can, Family::Mug] {
        let body = procedural(family, 0);
        let scene = scene(&body, PhysicsConfig::default());
        let height = body.mesh().transformed(scene.world_from_object()).aabb().max.z;
        let start = palm_down(0.0, 0.0, (height + 0.01).max(0.11));
        let spawn = || scene.template().spawn(&start, scene.world_from_object(), 0.0);
        let close = closing(scene.template().hand(), 0.0);
        let pressed = || -> World {
            let mut world = spawn();
            run(&mut world, &start, &close, 0.8);
            world
        };
        let first = pressed();
        assert!(!first.contacts().links.is_empty(), "the hand does not touch {}", body.name());
        let bytes = first.snapshot().unwrap();
        let (fresh, in_contact) = (memory_of(&mut kept, spawn), memory_of(&mut kept, pressed));
        let reset = median(2001, || drop(std::hint::black_box(spawn())));
        let save = median(21, || drop(std::hint::black_box(first.snapshot().unwrap())));
        let load = median(21, || drop(std::hint::black_box(scene.template().restore(&bytes).unwrap())));
        let kilobytes = |bytes: Option<f64>| bytes.map_or("?".to_owned(), |b| format!("{:.0}", b / 1e3));
        println!(
            "{} ({} parts): reset {:.1} us (goal 50); memory of a fresh world {} kB, of one in contact {} kB (goal 300); \
             snapshot {:.0} kB, taken in {:.2} ms, restored in {:.2} ms",
            body.name(),
            body.parts().len(),
            1e6 * reset,
            kilobytes(fresh),
            kilobytes(in_contact),
            bytes.len() as f64 / 1e3,
            1e3 * save,
            1e3 * load
        );
        assert!(fresh.is_none_or(|m| m < FRESH), "a fresh world takes {fresh:?} bytes");
        assert!(in_contact.is_none_or(|m| m < PRESSED), "a world in contact takes {in_contact:?} bytes");
        assert!(bytes.len() < SNAPSHOT, "a snapshot has {} bytes", bytes.len());
    }
    assert_eq!(kept.len(), 4 * KEPT);
}
