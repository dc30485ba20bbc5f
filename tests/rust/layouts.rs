//! Layouts of several objects: they follow VGN's generators, lie still where they were made, in the workspace, and follow from the seed.

#![allow(clippy::unwrap_used)]

use graspbox_episode::layout::PACKED_ATTEMPTS;
use graspbox_episode::{Arrangement, Body, Draw, EpisodeError, Layout};
use graspbox_hand::Hand;
use graspbox_objects::Family;
use graspbox_sim::{ObjectModel, PhysicsConfig, Template, Wall, World};
use graspbox_tests::scenes::{cuboid, procedural};
use nalgebra::{Isometry3, Point3, Vector3};
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime};

const FAMILIES: [Family; 5] = [Family::Can, Family::Box, Family::Bowl, Family::Bottle, Family::Mug];
const BIN: Layout = Layout::Bin { inside: [0.3, 0.25, 0.15] };

fn hand() -> Arc<Hand> {
    Arc::new(Hand::reflex().unwrap().clone())
}

fn bodies(count: usize) -> Vec<Body> {
    (0..count).map(|i| procedural(FAMILIES[i % FAMILIES.len()], i as u64)).collect()
}

fn arrange(layout: Layout, bodies: &[Body], seed: u64) -> Arrangement {
    layout.arrange(&refs(bodies), &Draw::seeded(seed), &hand(), PhysicsConfig::default(), None).unwrap()
}

/// A scene of `most` of the bodies, each of which is one attempt.
fn drawn(layout: Layout, bodies: &[Body], most: usize, seed: u64) -> Arrangement {
    let draw = Draw { most: Some(most), ..Draw::seeded(seed) };
    layout.arrange(&refs(bodies), &draw, &hand(), PhysicsConfig::default(), None).unwrap()
}

fn refs(bodies: &[Body]) -> Vec<&Body> {
    bodies.iter().collect()
}

fn cubes(count: usize, side: f64) -> Vec<Body> {
    (0..count).map(|_| cuboid("cube", [side / 2.0; 3], 0.1)).collect()
}

/// The world of `bodies` at `poses`, the hand out of the way, after `seconds`.
fn simulated(bodies: &[Body], poses: &[Isometry3<f64>], walls: &[Wall], seconds: f64) -> World {
    let models: Vec<ObjectModel> = bodies.iter().map(|body| body.model().clone()).collect();
    let template = Template::of_objects(hand(), &models, walls, PhysicsConfig::default()).unwrap();
    let away = Isometry3::translation(0.0, 0.0, 2.0);
    let mut world = template.spawn_objects(&away, poses, 0.0).unwrap();
    for _ in 0..(seconds / world.dt()).ceil() as usize {
        world.step(&away, &[]).unwrap();
    }
    world
}

/// Greatest depth of points on the surface of one cube inside of another one, metres.
fn greatest_overlap(poses: &[Isometry3<f64>], side: f64) -> f64 {
    let (half, steps) = (side / 2.0, 8);
    let ticks = || (0..=steps).map(move |i| side * f64::from(i) / f64::from(steps) - half);
    let face = |axis: usize| {
        ticks().flat_map(move |a| {
            ticks().flat_map(move |b| {
                let mut low = Point3::new(a, b, -half);
                low.coords.swap_rows(axis, 2);
                let mut high = Point3::new(a, b, half);
                high.coords.swap_rows(axis, 2);
                [low, high]
            })
        })
    };
    let surface: Vec<Point3<f64>> = (0..3).flat_map(face).collect();
    let depth = |one: &Isometry3<f64>, other: &Isometry3<f64>| {
        let inside = |point: &Point3<f64>| half - (other.inverse() * one * point).coords.amax();
        surface.iter().map(inside).fold(0.0, f64::max)
    };
    let pairs = (0..poses.len()).flat_map(|i| (0..poses.len()).filter(move |j| *j != i).map(move |j| (i, j)));
    pairs.map(|(i, j)| depth(&poses[i], &poses[j])).fold(0.0, f64::max)
}

/// Greatest shift of an object's centre of mass within half a second, metres.
fn greatest_shift(found: &Arrangement, bodies: &[Body]) -> f64 {
    let kept: Vec<Body> = found.objects.iter().map(|index| bodies[*index].clone()).collect();
    let world = simulated(&kept, &found.world_from_objects, &found.walls, 0.5);
    let shift = |(index, (before, after)): (usize, (&Isometry3<f64>, Isometry3<f64>))| {
        let center = kept[index].model().center_of_mass();
        (before * center - after * center).norm()
    };
    found.world_from_objects.iter().zip(world.world_from_objects()).enumerate().map(shift).fold(0.0, f64::max)
}

#[test]
fn objects_lie_in_the_workspace() {
    let bodies = bodies(5);
    let (mut kept, mut rolling) = ([0; 3], 0);
    for seed in 0..4 {
        for (layout, kept) in [Layout::Packed, Layout::Pile, BIN].into_iter().zip(&mut kept) {
            let found = arrange(layout, &bodies, seed);
            *kept += found.objects.len();
            assert!(found.objects.windows(2).all(|pair| pair[0] < pair[1]), "{layout:?} {seed}: {:?}", found.objects);
            assert_eq!(found.walls.len(), if layout == BIN { 4 } else { 0 });
            for (index, pose) in found.objects.iter().zip(&found.world_from_objects) {
                let center = pose * bodies[*index].model().center_of_mass();
                let within = center.x.abs() <= 0.15 && center.y.abs() <= 0.15 && (0.0..=0.25).contains(&center.z);
                assert!(within, "{layout:?} {seed}: object {index} at {center}");
            }
            let shift = greatest_shift(&found, &bodies);
            assert!(shift < 0.1, "{layout:?} {seed}: an object moves by {shift} m");
            rolling += u32::from(shift >= 0.03);
        }
    }
    // A can may still roll.
    assert!(rolling <= 1, "in {rolling} of 12 scenes an object moves by 3 cm");
    assert!(kept.iter().all(|kept| *kept >= 12), "of 20 objects each {kept:?} stayed");
}

#[test]
fn packed_objects_stand_upright() {
    let bodies = bodies(5);
    for seed in 0..3 {
        let found = arrange(Layout::Packed, &bodies, seed);
        for (index, pose) in found.objects.iter().zip(&found.world_from_objects) {
            let start = graspbox_mesh::default_pose(bodies[*index].mesh());
            let up = pose * start.inverse() * Vector3::z();
            assert!(up.z > 0.98, "seed {seed}: object {index} tilts, {up}");
        }
    }
}

/// Drawn objects have 12 attempts together, however many are wanted; objects that a caller names have 12 each.
#[test]
fn a_packed_scene_has_twelve_attempts() {
    let small = cubes(20, 0.015);
    let found = drawn(Layout::Packed, &small, 20, 0);
    assert!(found.objects.len() >= 6, "only {:?} stand", found.objects);
    assert!(found.objects.iter().all(|index| *index < PACKED_ATTEMPTS), "{:?}", found.objects);
    let all = arrange(Layout::Packed, &small, 0).objects;
    assert_eq!(all, (0..20).collect::<Vec<_>>());
    // Two of these do not fit beside each other: the second stands in no attempt.
    let large = cubes(3, 0.2);
    assert_eq!(drawn(Layout::Packed, &large, 3, 0).objects, [0]);
    assert_eq!((Layout::Packed.draws(5), Layout::Pile.draws(5), BIN.draws(5)), (PACKED_ATTEMPTS, 5, 5));
}

/// Once the wanted number stands, no other object is tried.
#[test]
fn no_more_objects_than_wanted_are_placed() {
    let small = cubes(12, 0.015);
    for (layout, first) in [(Layout::Packed, false), (Layout::Pile, true), (BIN, true)] {
        let found = drawn(layout, &small, 3, 1);
        assert_eq!(found.objects.len(), 3, "{layout:?}");
        assert!(!first || found.objects == [0, 1, 2], "{layout:?}: {:?}", found.objects);
    }
}

/// Objects that rest are simulated for a quarter of a second; what still rolls then, for longer.
#[test]
fn a_scene_is_simulated_until_it_rests() {
    let settle = |bodies: &[Body], poses: &[Isometry3<f64>]| {
        Layout::Pile.settle(&refs(bodies), poses.to_vec(), [1.0; 2], &hand(), PhysicsConfig::default()).unwrap()
    };
    let poses_after = |bodies: &[Body], poses: &[Isometry3<f64>], seconds: f64| -> Vec<Isometry3<f64>> {
        simulated(bodies, poses, &[], seconds).world_from_objects().collect()
    };
    let at = |x: f64, z: f64| Isometry3::translation(x, 0.0, z);
    let cubes = cubes(2, 0.04);
    let (rests, falls) = ([at(-0.05, 0.02), at(0.05, 0.02)], [at(-0.05, 0.02), at(0.05, 0.52)]);
    assert_eq!(settle(&cubes, &rests).world_from_objects, poses_after(&cubes, &rests, 0.25));
    let speed = |world: &World, object| {
        let (linear, angular) = world.velocity_in_hand(object);
        linear.norm().hypot(angular.norm())
    };
    let calm = (1..=8).map(|periods| 0.25 * f64::from(periods)).find(|seconds| {
        let world = simulated(&cubes, &falls, &[], *seconds);
        (0..2).all(|object| speed(&world, object) <= 0.01)
    });
    assert!((0.5..2.0).contains(&calm.unwrap()), "{calm:?}");
    assert_eq!(settle(&cubes, &falls).world_from_objects, poses_after(&cubes, &falls, calm.unwrap()));
}

/// Objects outside are removed, and the others come to rest again without them.
#[test]
fn objects_outside_are_removed() {
    let bodies = [
        cuboid("block", [0.04, 0.04, 0.04], 0.5),
        cuboid("on it", [0.02; 3], 0.05),
        cuboid("tall", [0.02, 0.02, 0.26], 0.2),
    ];
    // The block's middle is 1 cm outside, that of the cube on it 1 cm inside, and the column's is above the workspace.
    let poses = [(0.16, 0.04), (0.14, 0.1), (-0.05, 0.26)].map(|(x, z)| Isometry3::translation(x, 0.0, z));
    let found =
        Layout::Packed.settle(&refs(&bodies), poses.to_vec(), [1.0; 2], &hand(), PhysicsConfig::default()).unwrap();
    assert_eq!(found.objects, [1]);
    let height = found.world_from_objects[0].translation.z;
    assert!((height - 0.02).abs() < 2e-3, "the cube stays in the air, at {height} m");
    let gone =
        Layout::Packed.settle(&refs(&bodies[..1]), poses[..1].to_vec(), [1.0; 2], &hand(), PhysicsConfig::default());
    assert!(gone.unwrap().objects.is_empty());
}

/// What rests with a factor on friction, as after an attempt in a randomized episode: a cube slides farther with less.
#[test]
fn objects_rest_with_their_friction() {
    let cube = cubes(1, 0.04);
    let end = |factors: [f64; 2]| {
        let tilted = Isometry3::new(Vector3::new(0.0, 0.0, 0.04), Vector3::new(0.0, 0.6, 0.0));
        let found = Layout::Pile.settle(&refs(&cube), vec![tilted], factors, &hand(), PhysicsConfig::default());
        found.unwrap().world_from_objects[0].translation.x.abs()
    };
    let (usual, heavy, smooth) = (end([1.0; 2]), end([1.0, 3.0]), end([0.1, 1.0]));
    assert!((usual - heavy).abs() < 1e-4, "mass changes nothing by itself: {usual}, {heavy}");
    assert!((smooth - usual).abs() > 2e-3, "{usual}, {smooth}");
}

/// Neither are packed objects placed into others, nor are objects dropped into a heap that is higher than the drop.
#[test]
fn objects_do_not_overlap() {
    let (side, shaft) = (0.045, Layout::Bin { inside: [0.1, 0.1, 0.6] });
    let cubes = cubes(12, side);
    for (layout, least) in [(Layout::Packed, 3), (Layout::Pile, 8), (shaft, 12)] {
        let found = arrange(layout, &cubes, 2);
        assert!(found.objects.len() >= least, "{layout:?}: {} objects", found.objects.len());
        let overlap = greatest_overlap(&found.world_from_objects, side);
        assert!(overlap < 2e-3, "{layout:?}: {overlap} m");
        let top = found.world_from_objects.iter().map(|pose| pose.translation.z).fold(0.0, f64::max);
        assert!(layout != shaft || top > 0.2, "the heap is only {top} m high");
    }
}

#[test]
fn equal_seeds_give_equal_bits() {
    let bodies = bodies(4);
    for layout in [Layout::Packed, Layout::Pile, BIN] {
        assert_eq!(arrange(layout, &bodies, 5), arrange(layout, &bodies, 5));
        assert_ne!(arrange(layout, &bodies, 5).world_from_objects, arrange(layout, &bodies, 6).world_from_objects);
    }
}

/// The entries of a cache folder, by name, and their bytes.
fn entries(cache: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let files = fs::read_dir(cache.join("scenes")).unwrap().map(|file| file.unwrap().path());
    files.map(|path| (path.clone(), fs::read(path).unwrap())).collect()
}

/// Scenes have the same bits from an empty, a filled, a damaged and an unusable cache.
#[test]
fn cached_scenes_have_the_same_bits() {
    let (bodies, folder) = (bodies(4), tempfile::tempdir().unwrap());
    let made = |layout: Layout, cache: Option<&Path>, seed: u64| {
        let draw = Draw { most: Some(3), ..Draw::seeded(seed) };
        layout.arrange(&refs(&bodies), &draw, &hand(), PhysicsConfig::default(), cache).unwrap()
    };
    let exact = |found: &Arrangement| format!("{found:?}");
    for (count, layout) in [Layout::Packed, Layout::Pile, BIN].into_iter().enumerate() {
        let wanted = exact(&made(layout, None, 5));
        assert_eq!(exact(&made(layout, Some(folder.path()), 5)), wanted, "{layout:?}: empty");
        let written = entries(folder.path());
        assert_eq!(written.len(), count + 1);
        // An entry that is made again is written again, and has a new age.
        let old = SystemTime::UNIX_EPOCH + Duration::from_secs(1000);
        written.keys().for_each(|path| fs::File::options().append(true).open(path).unwrap().set_modified(old).unwrap());
        assert_eq!(exact(&made(layout, Some(folder.path()), 5)), wanted, "{layout:?}: filled");
        assert!(written.keys().all(|path| fs::metadata(path).unwrap().modified().unwrap() == old), "it was not read");
        for spoil in [|bytes: &mut Vec<u8>| bytes.truncate(40), |bytes: &mut Vec<u8>| bytes[60] ^= 1] {
            for (path, bytes) in &written {
                let mut bytes = bytes.clone();
                spoil(&mut bytes);
                fs::write(path, bytes).unwrap();
            }
            assert_eq!(exact(&made(layout, Some(folder.path()), 5)), wanted, "{layout:?}: damaged");
            let mended = entries(folder.path());
            assert_eq!(written.iter().filter(|(path, bytes)| mended[*path] == **bytes).count(), 1, "it is made again");
            written.iter().for_each(|(path, bytes)| fs::write(path, bytes).unwrap());
        }
        // The folder's name is that of a file.
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        assert_eq!(exact(&made(layout, Some(&file), 5)), wanted, "{layout:?}: no folder");
    }
}

/// Whatever a scene depends on is in the name of its entry.
#[test]
fn another_scene_has_another_entry() {
    let (mut bodies, folder) = (bodies(3), tempfile::tempdir().unwrap());
    let cache = Some(folder.path());
    let panda = Arc::new(graspbox_hand::assets::asset("panda_gripper").unwrap().read().unwrap());
    let physics = PhysicsConfig::default();
    let count = |number: usize| assert_eq!(entries(folder.path()).len(), number);
    let make = |layout: Layout, bodies: &[Body], draw: Draw, hand: &Arc<Hand>, physics| {
        drop(layout.arrange(&refs(bodies), &draw, hand, physics, cache).unwrap());
    };
    let draw = Draw::seeded(0);
    make(Layout::Packed, &bodies, draw, &hand(), physics);
    make(Layout::Packed, &bodies, draw, &hand(), physics);
    count(1);
    make(Layout::Packed, &bodies, Draw::seeded(1), &hand(), physics);
    make(Layout::Packed, &bodies, Draw { most: Some(3), ..draw }, &hand(), physics);
    make(Layout::Packed, &bodies, Draw { spread: 0.9, ..draw }, &hand(), physics);
    make(BIN, &bodies, draw, &hand(), physics);
    make(Layout::Bin { inside: [0.3, 0.25, 0.16] }, &bodies, draw, &hand(), physics);
    make(Layout::Packed, &bodies, draw, &panda, physics);
    make(Layout::Packed, &bodies, draw, &hand(), PhysicsConfig { dt: 0.5 * physics.dt, ..physics });
    make(Layout::Packed, &bodies[..2], draw, &hand(), physics);
    count(9);
    bodies[0] = bodies[0].scaled(0.9).unwrap();
    make(Layout::Packed, &bodies, draw, &hand(), physics);
    count(10);
}

#[test]
fn impossible_layouts_are_refused() {
    let refused = |layout: Layout, bodies: &[Body]| {
        let found: Result<_, EpisodeError> =
            layout.arrange(&refs(bodies), &Draw::seeded(0), &hand(), PhysicsConfig::default(), None);
        found.err().unwrap().to_string()
    };
    assert!(refused(Layout::Pile, &[]).contains("there is no object"));
    let flat = Layout::Bin { inside: [0.2, 0.2, f64::NAN] };
    assert!(refused(flat, &bodies(1)).contains("inside"), "{}", refused(flat, &bodies(1)));
}

/// `cargo test --release -p graspbox-tests --test layouts -- --ignored --nocapture`: seconds to make piles, one thread.
#[test]
#[ignore = "a measurement"]
fn seconds_of_a_pile() {
    for count in [5, 15] {
        let bodies = bodies(count);
        let begun = Instant::now();
        let kept: usize = (0..10).map(|seed| arrange(Layout::Pile, &bodies, seed).objects.len()).sum();
        println!("{count} objects: {:.3} s a pile, {} stay", begun.elapsed().as_secs_f64() / 10.0, kept as f64 / 10.0);
    }
}
