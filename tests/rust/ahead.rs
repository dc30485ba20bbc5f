//! Objects prepared ahead: the next episode finds its own, and no bit depends on when it was prepared.
#![allow(clippy::unwrap_used)]

use graspbox_gym::starts::initial_samples::InitialSamples;
use graspbox_gym::starts::initial_state::InitialState;
use graspbox_gym::starts::random_stream::RandomStream;
use graspbox_gym::{Autoreset, Batch, EnvConfig, EnvPool, Objects, ResetOptions};
use graspbox_objects::Family;
use graspbox_tests::gym::objects;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

const FAMILIES: [Family; 4] = [Family::Ball, Family::Can, Family::Box, Family::Mug];
const ENVS: usize = 3;

fn pool(objects: &Arc<Objects>) -> EnvPool {
    let config = EnvConfig { autoreset: Autoreset::NextStep, max_episode_steps: Some(2), ..EnvConfig::default() };
    EnvPool::new(Arc::clone(objects), config, ENVS).unwrap()
}

/// Results of three environments in seven steps of short episodes.
fn run(objects: &Arc<Objects>) -> Vec<Batch> {
    let pool = pool(objects);
    let seeds: Vec<_> = (0..ENVS as u64).map(Some).collect();
    let mut batches = vec![pool.reset(&seeds, None, &ResetOptions::default()).unwrap()];
    let zeros = vec![0.0; ENVS * pool.spec().action];
    batches.extend((0..7).map(|_| pool.step(&zeros).unwrap().now));
    batches
}

#[test]
fn preparing_first_changes_nothing() {
    let prepared = objects(&FAMILIES);
    (0..prepared.len()).for_each(|index| prepared.prepare(index, true).unwrap());
    assert!(run(&prepared) == run(&objects(&FAMILIES)), "an episode depends on when its object was prepared");
}

#[test]
fn the_objects_of_the_next_three_episodes_are_prepared_during_this_one() {
    let objects = objects(&FAMILIES);
    let pool = pool(&objects);
    let sample = |stream: &mut RandomStream| InitialSamples::new(stream, objects.len()).object;
    // Four episodes with four objects.
    let differ = |&seed: &u64| {
        let mut stream = RandomStream::new(seed);
        BTreeSet::from([(); 4].map(|()| sample(&mut stream))).len() == 4
    };
    let seed = (0..1000).find(differ).unwrap();
    pool.reset(&[Some(seed); ENVS], None, &ResetOptions::default()).unwrap();
    let mut stream = RandomStream::new(seed);
    for _ in 0..3 {
        sample(&mut stream);
        let next = InitialState::needs(pool.spec(), &stream, &ResetOptions::default()).unwrap()[0];
        // No bound on its time: without the thread it would never be ready.
        let begun = Instant::now();
        while !objects.is_ready(&next) {
            assert!(begun.elapsed() < Duration::from_secs(120), "no thread prepares {next:?}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}
