//! Worlds of several objects, on both engines: stacks stand, one object is the target, snapshots continue.

#![allow(clippy::unwrap_used)]

use graspbox_hand::Hand;
use graspbox_sim::{EngineKind, Geometry, ObjectModel, PhysicsConfig, SimError, Template, World};
use nalgebra::{Isometry3, Vector3};
use std::sync::Arc;

const HALF: f64 = 0.025;
const ENGINES: [EngineKind; 2] = [EngineKind::Newton, EngineKind::Rapier];

fn cube() -> ObjectModel {
    ObjectModel::solid(&Geometry::Cuboid(Vector3::repeat(HALF)), 0.2).unwrap()
}

fn template(engine: EngineKind, count: usize) -> Result<Template, SimError> {
    let config = PhysicsConfig { engine, ..PhysicsConfig::default() };
    Template::of_objects(Arc::new(Hand::reflex().unwrap().clone()), &vec![cube(); count], config)
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
