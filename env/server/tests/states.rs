//! States that a client changed and sealed again: the checksum has no key, so behind it everything must be checked too.

#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_agent::source::Source;
use graspbox_agent::{AgentConfig, EnvPool, Objects, ResetOptions};
use graspbox_hand::Hand;
use graspbox_mesh::checksum;
use graspbox_objects::Family;
use graspbox_sim::PhysicsConfig;
use proptest::test_runner::{RngAlgorithm, TestRng};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Bytes before the body: the magic number and the checksum.
const HEAD: usize = 8 + 32;
const STATE: &[u8; 8] = b"gbagenta";
const WORLD: &[u8; 8] = b"gbworld5";

fn below(rng: &mut TestRng, end: usize) -> usize {
    use proptest::prelude::Rng;
    (rng.next_u64() % end.max(1) as u64) as usize
}

/// The state with a changed byte; the world inside and the whole have right checksums.
fn forged(rng: &mut TestRng, state: &[u8]) -> Vec<u8> {
    let mut body = state[HEAD..].to_vec();
    let world = body.windows(8).position(|part| part == WORLD).unwrap();
    for _ in 0..=below(rng, 3) {
        let at = below(rng, body.len());
        body[at] = [0, 1, 0x7f, 0x80, 0xf0, 0xff, body[at] ^ (1 << below(rng, 8))][below(rng, 7)];
    }
    // The world's length is the varint in front of it.
    let length = usize::from(body[world - 2] & 0x7f) | usize::from(body[world - 1]) << 7;
    if body.get(world..world + 8) == Some(WORLD)
        && let Some(inner) = body.get(world + HEAD..world + length)
    {
        let sealed = checksum::seal(WORLD, inner);
        body[world..world + length].copy_from_slice(&sealed);
    }
    checksum::seal(STATE, &body)
}

/// `GRASPBOX_FUZZ` changes the number of states.
#[test]
fn forged_states_are_refused_or_run() {
    let ball = Source::Procedural { name: "ball".into(), family: Family::Ball, seed: 0, scale: 1.0, mass: None };
    let hand = Arc::new(Hand::reflex().unwrap().clone());
    let objects = Arc::new(Objects::new(vec![ball], hand, PhysicsConfig::default(), None).unwrap());
    let pool = EnvPool::new(objects, AgentConfig::default(), 1).unwrap();
    pool.reset(&[Some(0)], None, &ResetOptions::default()).unwrap();
    let saved = pool.env(0).unwrap().save(pool.spec(), 0).unwrap();
    let actions = vec![0.1; pool.spec().action];
    let count = std::env::var("GRASPBOX_FUZZ").map_or(400, |text| text.parse().unwrap());
    let mut rng = TestRng::from_seed(RngAlgorithm::ChaCha, &[3; 32]);
    let (mut taken, mut broken) = (0, Vec::new());
    for _ in 0..count {
        let state = forged(&mut rng, &saved);
        let started = Instant::now();
        let ran = catch_unwind(AssertUnwindSafe(|| {
            if pool.restore(0, &state).is_ok() {
                taken += 1;
                // What comes of it may be an error.
                (0..3).for_each(|_| drop(pool.step(&actions)));
            }
        }));
        if ran.is_err() || started.elapsed() > Duration::from_secs(5) {
            broken.push(state);
        }
    }
    println!("{taken} of {count} forged states were taken");
    assert!(taken > 0, "the forgery reaches nothing");
    assert!(broken.is_empty(), "{} of {count} states panic or hang", broken.len());
    pool.restore(0, &saved).unwrap();
    pool.step(&actions).unwrap();
}
