//! Options of a reset and settings of environments: they change only the named values, and are refused out of range.
#![allow(clippy::unwrap_used)]

use graspbox_gym::starts::reset_options::ObjectChoice;
use graspbox_gym::{Control, EnvConfig, EnvError, EnvPool, Objects, Observation, ResetOptions};
use graspbox_objects::Family;
use graspbox_sim::PhysicsConfig;
use graspbox_tests::gym::{indices, objects, pool};
use nalgebra::Isometry3;
use std::sync::Arc;

const FAMILIES: [Family; 3] = [Family::Box, Family::Can, Family::Ball];

#[test]
fn options_fix_what_they_name_and_nothing_else() {
    let pool = pool(&objects(&FAMILIES), Control::Twist, 1);
    let start = |options: &ResetOptions| {
        pool.reset(&[Some(3)], None, options)?;
        let object = indices(&pool.now(), "object")[0];
        let env = pool.env(0)?;
        let world = env.episode().unwrap().episode().world();
        Ok::<_, EnvError>((object, world.world_from_object(), world.world_from_hand()))
    };
    let sampled = start(&ResetOptions::default()).unwrap();
    let heavier = ResetOptions { mass: Some(2.0), friction: Some(0.5), ..ResetOptions::default() };
    assert_eq!(start(&heavier).unwrap(), sampled);
    let placed = ResetOptions {
        object: Some(ObjectChoice::Name("can".into())),
        place: Some([0.02, -0.03, 0.0]),
        ..ResetOptions::default()
    };
    let (object, pose, hand) = start(&placed).unwrap();
    assert_eq!((object, hand), (1, sampled.2));
    assert!((pose.translation.vector.xy() - nalgebra::Vector2::new(0.02, -0.03)).norm() < 2e-3);
    let rows = |z: f64| Some([[1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, z], [0.0, 0.0, 0.0, 1.0]]);
    let posed = ResetOptions { world_from_hand: rows(0.4), preshape: Some(0.7), ..ResetOptions::default() };
    assert!((start(&posed).unwrap().2.translation.z - 0.4).abs() < 1e-12);
    let wrong = |change: fn(&mut ResetOptions)| {
        let mut options = ResetOptions::default();
        change(&mut options);
        start(&options).unwrap_err().to_string()
    };
    for (message, part) in [
        (wrong(|o| o.object = Some(ObjectChoice::Index(9))), "no object 9"),
        (wrong(|o| o.object = Some(ObjectChoice::Name("x".into()))), "\"x\""),
        (wrong(|o| o.resting = Some(99)), "resting poses"),
        (wrong(|o| o.preshape = Some(9.0)), "preshape"),
        (wrong(|o| o.mass = Some(0.0)), "mass"),
        (wrong(|o| o.place = Some([f64::NAN, 0.0, 0.0])), "finite"),
        (wrong(|o| o.world_from_hand = Some([[2.0; 4]; 4])), "homogeneous"),
        (
            wrong(|o| {
                o.world_from_hand =
                    Some([[1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]);
            }),
            "table",
        ),
    ] {
        assert!(message.contains(part), "{message}");
    }
}

#[test]
fn settings_out_of_range_are_refused() {
    let objects = objects(&[Family::Box]);
    let refused = |change: fn(&mut EnvConfig)| {
        let mut config = EnvConfig::default();
        change(&mut config);
        EnvPool::new(Arc::clone(&objects), config, 1).map(|_| ()).unwrap_err().to_string()
    };
    for (message, part) in [
        (refused(|c| c.max_episode_steps = Some(0)), "max_episode_steps"),
        (refused(|c| c.randomization.mass = [2.0, 1.0]), "randomization.mass"),
        (refused(|c| c.randomization.friction = [0.0, 1.0]), "randomization.friction"),
        (refused(|c| c.observations = vec![Observation::State; 2]), "state"),
    ] {
        assert!(message.contains(part), "{message}");
    }
    for count in [0, 65_537, 1_000_000_000] {
        let refused = EnvPool::new(Arc::clone(&objects), EnvConfig::default(), count).map(|_| ());
        let message = refused.unwrap_err().to_string();
        assert!(message.contains("num_envs") && message.contains("between 1 and 65536"), "{message}");
    }
    let physics = PhysicsConfig { dt: 0.003, ..PhysicsConfig::default() };
    let hand = Arc::clone(objects.hand());
    let odd = Objects::new(vec![objects.source(0).unwrap().clone()], hand, physics, None).unwrap();
    let message = EnvPool::new(Arc::new(odd), EnvConfig::default(), 1).map(|_| ()).unwrap_err().to_string();
    assert!(message.contains("physics.dt"), "{message}");
}

/// Once, an episode could begin with an object that was lost already, and ended at its first step.
#[test]
fn no_episode_begins_with_a_lost_object() {
    let pool = pool(&objects(&[Family::Ball]), Control::Twist, 1);
    let message = |options: ResetOptions| pool.reset(&[Some(0)], None, &options).unwrap_err().to_string();
    for place in [[0.6, 0.6, 0.0], [0.52, 0.0, 0.0], [-0.4, -0.4, 1.0]] {
        let refused = message(ResetOptions { place: Some(place), ..ResetOptions::default() });
        assert!(refused.contains("`place`") && refused.contains("within 0.5 m"), "{refused}");
    }
    let dropped = Isometry3::translation(0.6, 0.0, 0.1).to_homogeneous();
    let rows = std::array::from_fn(|i| std::array::from_fn(|j| dropped[(i, j)]));
    let refused = message(ResetOptions { world_from_object: Some(rows), ..ResetOptions::default() });
    assert!(refused.contains("`world_from_object`") && refused.contains("within 0.5 m"), "{refused}");
    let edge = ResetOptions { place: Some([0.45, 0.0, 0.0]), ..ResetOptions::default() };
    pool.reset(&[Some(0)], None, &edge).unwrap();
    assert!(!pool.step(&vec![0.0; pool.spec().action]).unwrap().now.terminated[0]);
}
