//! A target among other objects: which object it is, what its episodes see of it, and what its neighbours change.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_episode::Layout;
use graspbox_gym::observations::info::{INFO, InfoArray};
use graspbox_gym::{Batch, ClutterConfig, Control, EnvConfig, EnvPool, Objects, ResetOptions};
use graspbox_objects::Family;
use graspbox_tests::gym::{each_period, objects};
use std::collections::BTreeSet;
use std::sync::Arc;

const FAMILIES: [Family; 3] = [Family::Box, Family::Can, Family::Ball];

fn pool(objects: &Arc<Objects>, control: Control, layout: Option<Layout>) -> EnvPool {
    let clutter = ClutterConfig { layout, objects_per_scene: [3, 3], scale: [0.7, 0.9], ..ClutterConfig::default() };
    EnvPool::new(Arc::clone(objects), EnvConfig { control, clutter, ..each_period() }, 1).unwrap()
}

fn reset(pool: &EnvPool, seed: u64) -> Batch {
    pool.reset(&[Some(seed)], None, &ResetOptions::default()).unwrap()
}

/// An integer of the info.
fn number(batch: &Batch, name: &str) -> i64 {
    let at = INFO.iter().position(|row| row.name == name).unwrap();
    let InfoArray::Indices(values) = &batch.info[at] else { panic!("{name} is no integer") };
    values[0]
}

/// Each object of a scene is the target for some seed; the state, the labels and the info are about it, and the scene has every other sample of
/// a scene that is cleared.
#[test]
fn the_target_is_any_object_of_the_scene() {
    let objects = objects(&FAMILIES);
    let (targets, all) = (
        pool(&objects, Control::GraspPose, Some(Layout::Packed)),
        pool(&objects, Control::Clear, Some(Layout::Packed)),
    );
    let (mut places, mut twice) = (BTreeSet::new(), 0);
    for seed in 0..12 {
        let batch = reset(&targets, seed);
        reset(&all, seed);
        let (env, cleared) = (targets.env(0).unwrap(), all.env(0).unwrap());
        let (episode, other) = (env.episode().unwrap(), cleared.episode().unwrap());
        let world = episode.episode().world();
        let poses: Vec<_> = world.world_from_objects().collect();
        assert_eq!(poses, other.episode().world().world_from_objects().collect::<Vec<_>>());
        let scene: Vec<_> = episode.objects().collect();
        let different: BTreeSet<usize> = scene.iter().map(|object| object.index).collect();
        twice += usize::from(different.len() < scene.len());
        let target = world.target();
        places.insert(target);
        assert_eq!(number(&batch, "object"), scene[target].index as i64);
        assert_eq!(number(&batch, "neighbours"), scene.len() as i64 - 1);
        assert_eq!(number(&batch, "neighbours_moved"), 0);
        let mut slots: Vec<_> = scene.iter().map(|object| object.slot).collect();
        assert_eq!(slots[target], 0, "the target is first in the order of labels");
        slots.sort_unstable();
        assert!(slots.into_iter().eq(0..scene.len()));
        let state = batch.observations.last().unwrap();
        let at = poses[target].translation.vector;
        assert!((0..3).all(|axis| (f64::from(state[axis]) - at[axis]).abs() < 1e-6));
    }
    assert_eq!(places, BTreeSet::from([0, 1, 2]));
    assert!(twice > 0, "objects are drawn with replacement");
}

/// A state holds the scene and its target; environments of another layout refuse it.
#[test]
fn states_belong_to_their_layout() {
    let objects = objects(&FAMILIES);
    for control in [Control::GraspPose, Control::Twist] {
        let packed = pool(&objects, control, Some(Layout::Packed));
        let first = reset(&packed, 3);
        let state = packed.env(0).unwrap().save(packed.spec(), 0).unwrap();
        reset(&packed, 4);
        let again = packed.restore(0, &state).unwrap();
        assert_eq!(again.observations, first.observations);
        assert_eq!(again.info, first.info);
        let single = pool(&objects, control, None);
        let refused = single.restore(0, &state).unwrap_err().to_string();
        assert!(refused.contains("its layout is another one"), "{refused}");
        let bin = pool(&objects, control, Some(Layout::Bin { inside: [0.3, 0.25, 0.12] }));
        assert!(bin.restore(0, &state).is_err(), "the walls are missing");
        reset(&single, 3);
        let alone = single.env(0).unwrap().save(single.spec(), 0).unwrap();
        assert!(packed.restore(0, &alone).is_err());
    }
}

/// A single object can be cleared too: its episode begins as that of one decision.
#[test]
fn a_single_object_is_cleared() {
    let objects = objects(&FAMILIES);
    let (clear, decision) = (pool(&objects, Control::Clear, None), pool(&objects, Control::GraspPose, None));
    for seed in 0..4 {
        let (batch, other) = (reset(&clear, seed), reset(&decision, seed));
        assert_eq!(batch.observations, other.observations);
        assert_eq!((number(&batch, "remaining"), number(&batch, "object")), (1, number(&other, "object")));
        let state = clear.env(0).unwrap().save(clear.spec(), 0).unwrap();
        assert_eq!(clear.restore(0, &state).unwrap().observations, batch.observations);
    }
}
