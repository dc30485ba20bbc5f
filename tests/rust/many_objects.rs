//! Worlds of several objects, on both engines: stacks stand, one object is the target, snapshots continue.

#![allow(clippy::unwrap_used)]

use graspbox_hand::Hand;
use graspbox_sim::{EngineKind, Geometry, ObjectModel, PhysicsConfig, SimError, Template, Wall, World, bin};
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use std::sync::Arc;

const HALF: f64 = 0.025;
const ENGINES: [EngineKind; 2] = [EngineKind::Implicit, EngineKind::Rapier];

fn cube() -> ObjectModel {
    ObjectModel::solid(&Geometry::Cuboid(Vector3::repeat(HALF)), 0.2).unwrap()
}

fn template(engine: EngineKind, count: usize) -> Result<Template, SimError> {
    with_walls(engine, &vec![cube(); count], &[])
}

fn with_walls(engine: EngineKind, objects: &[ObjectModel], walls: &[Wall]) -> Result<Template, SimError> {
    let config = PhysicsConfig { engine, ..PhysicsConfig::default() };
    Template::of_objects(Arc::new(Hand::reflex().unwrap().clone()), objects, walls, config)
}

fn away() -> Isometry3<f64> {
    Isometry3::translation(0.0, 0.0, 1.5)
}

/// Boxes on top of each other.
fn stack(engine: EngineKind, count: usize) -> World {
    let places: Vec<_> = (0..count).map(|i| Isometry3::translation(0.05, 0.1, HALF * (2 * i + 1) as f64)).collect();
    template(engine, count).unwrap().spawn_objects(&away(), &places, 0.0).unwrap()
}

fn run(world: &mut World, seconds: f64) {
    let end = world.time() + seconds;
    while world.time() < end - 1e-9 {
        world.step(&away(), &[]).unwrap();
    }
}

fn places(world: &World) -> Vec<Isometry3<f64>> {
    world.world_from_objects().collect()
}

#[test]
fn a_stack_stands_in_both_engines() {
    for engine in ENGINES {
        let mut world = stack(engine, 3);
        run(&mut world, 1.0);
        for (i, pose) in places(&world).iter().enumerate() {
            let expected = Vector3::new(0.05, 0.1, HALF * (2 * i + 1) as f64);
            let off = (pose.translation.vector - expected).norm();
            assert!(off < 2e-3, "{engine:?}: box {i} is {off} m away from its place");
        }
        assert!(!world.has_diverged());
    }
}

#[test]
fn contacts_name_the_other_objects() {
    for engine in ENGINES {
        let mut world = stack(engine, 3);
        run(&mut world, 0.5);
        for (target, others, on_scenery) in [(0, vec![1], true), (1, vec![0, 2], false), (2, vec![1], false)] {
            world.set_target(target);
            let found = world.contacts();
            assert_eq!((found.objects, found.scenery), (others, on_scenery), "{engine:?}: box {target}");
            assert_eq!(world.object_on_scenery(), on_scenery, "{engine:?}: box {target}");
        }
        assert_eq!(world.carried_by_scenery(), [true; 3], "{engine:?}: the table carries the whole stack");
        assert_eq!(world.most_pressed(), None);
    }
}

/// A force and a factor on the target leave the other object alone.
#[test]
fn one_object_is_the_target() {
    for engine in ENGINES {
        let start = [Isometry3::translation(-0.2, 0.0, HALF), Isometry3::translation(0.2, 0.0, HALF)];
        let mut world = template(engine, 2).unwrap().spawn_objects(&away(), &start, 0.0).unwrap();
        assert_eq!((world.object_count(), world.target()), (2, 0));
        world.set_target(7); // there is no such object
        assert_eq!(world.target(), 0);
        world.set_target(1);
        assert!((world.object_center().x - 0.2).abs() < 1e-9);
        world.scale_object(1.0, 2.0);
        assert!((world.object_mass() - 0.4).abs() < 1e-12);
        world.set_object_force(&Vector3::new(4.0, 0.0, 0.0));
        run(&mut world, 0.3);
        assert!(world.object_center().x > 0.25, "{engine:?}: the pushed box stays");
        world.set_target(0);
        assert!((world.object_center().x + 0.2).abs() < 1e-3, "{engine:?}: the other box moves");
        assert!((world.object_mass() - 0.2).abs() < 1e-12);
    }
}

#[test]
fn snapshots_continue_with_the_same_bits() {
    for engine in ENGINES {
        let mut world = stack(engine, 4);
        world.set_target(3);
        world.set_object_force(&Vector3::new(1.5, 0.5, 0.0));
        run(&mut world, 0.2);
        let bytes = world.snapshot().unwrap();
        let mut restored = template(engine, 4).unwrap().restore(&bytes).unwrap();
        assert_eq!(restored.target(), 3);
        run(&mut world, 0.2);
        run(&mut restored, 0.2);
        assert_eq!(places(&world), places(&restored), "{engine:?}");
        assert!(matches!(template(engine, 3).unwrap().restore(&bytes), Err(SimError::BadSnapshot { .. })));
    }
}

#[test]
fn wrong_counts_are_refused() {
    for engine in ENGINES {
        assert_eq!(template(engine, 0).err(), Some(SimError::NoObjects));
        assert_eq!(template(engine, 65).err(), Some(SimError::TooManyObjects { count: 65 }));
        let found = template(engine, 2).unwrap().spawn_objects(&away(), &[Isometry3::identity()], 0.0);
        assert_eq!(found.err(), Some(SimError::WrongPoses { poses: 1, objects: 2 }));
    }
}

/// Balls, cans and boxes that fall into a bin stay in it, and come to rest. A bug here: a wall that lets through, throws, or has no floor.
#[test]
fn a_bin_holds_what_falls_into_it() {
    let inside = Vector3::new(0.2, 0.16, 0.12);
    for engine in ENGINES {
        let shapes = [
            Geometry::Ball { radius: 0.025 },
            Geometry::Cylinder { radius: 0.02, half_length: 0.03 },
            Geometry::Cuboid(Vector3::new(0.03, 0.02, 0.015)),
        ];
        let objects: Vec<_> = (0..6).map(|i| ObjectModel::solid(&shapes[i % shapes.len()], 0.1).unwrap()).collect();
        let turn = |i: usize| UnitQuaternion::from_euler_angles(0.7 * i as f64, 0.3, 0.2 * i as f64);
        let start: Vec<_> = (0..6)
            .map(|i| {
                Isometry3::from_parts(Vector3::new(0.02 * (i % 3) as f64, 0.0, 0.08 + 0.08 * i as f64).into(), turn(i))
            })
            .collect();
        let template = with_walls(engine, &objects, &bin(inside, 0.02)).unwrap();
        let mut world = template.spawn_objects(&away(), &start, 0.0).unwrap();
        run(&mut world, 3.0);
        let before = places(&world);
        run(&mut world, 0.5);
        for (i, (pose, before)) in places(&world).iter().zip(&before).enumerate() {
            let place = pose.translation.vector;
            let within = place.x.abs() < 0.1 && place.y.abs() < 0.08 && place.z > 0.01 && place.z < 0.14;
            assert!(within, "{engine:?}: object {i} is at {place}");
            let drift = (place - before.translation.vector).norm();
            let rolls = i % shapes.len() < 2; // nothing brakes a ball or a can
            assert!(rolls || drift < 2e-3, "{engine:?}: object {i} still moves, {drift} m in half a second");
        }
        assert!(!world.has_diverged());
    }
}

/// Without its walls a heap is no longer the same world.
#[test]
fn walls_are_checked_and_identify_a_world() {
    let wall = |half: f64| Wall { world_from_wall: Isometry3::identity(), half: Vector3::repeat(half) };
    for engine in ENGINES {
        let walls = bin(Vector3::repeat(0.2), 0.02);
        assert_eq!(walls.len(), 4);
        let bytes =
            with_walls(engine, &[cube()], &walls).unwrap().spawn(&away(), &Isometry3::identity(), 0.0).snapshot();
        assert!(template(engine, 1).unwrap().restore(&bytes.unwrap()).is_err());
        let flat = with_walls(engine, &[cube()], &[wall(0.0)]).err().unwrap().to_string();
        assert!(flat.contains("walls.half"), "{flat}");
        let found = with_walls(engine, &[cube()], &vec![wall(0.1); 65]).err();
        assert_eq!(found, Some(SimError::TooManyWalls { count: 65 }));
    }
}
