//! The bodies of the fuzz targets over their seeds, and over mutations of them: `GRASPBOX_FUZZ=1000000 cargo test --release -p
//! graspbox-server --test fuzz_bodies` makes a million of each.

#![allow(clippy::unwrap_used, clippy::panic)]

#[path = "../fuzz/bodies.rs"]
mod bodies;

use proptest::test_runner::{RngAlgorithm, TestRng};
use std::path::Path;
use std::process::Command;

/// Mutations of each target where the environment does not say otherwise.
const MUTATIONS: usize = 20_000;
/// Address space in which hostile frames are read, KiB: the needs of the test itself, and 100 MB.
const SPACE: usize = 300_000;

fn seeds() -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/seeds");
    let mut paths: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    paths.iter().map(|path| std::fs::read(path).unwrap()).collect()
}

fn below(rng: &mut TestRng, end: usize) -> usize {
    use proptest::prelude::Rng;
    (rng.next_u64() % end.max(1) as u64) as usize
}

/// Bit flips, bytes that mean something to msgpack, cuts, doublings, and splices with another seed.
fn mutate(rng: &mut TestRng, data: &mut Vec<u8>, other: &[u8]) {
    const MARKS: [u8; 12] = [0x00, 0x7f, 0x80, 0xc0, 0xc1, 0xc6, 0xcf, 0xd3, 0xdb, 0xdd, 0xdf, 0xff];
    let at = below(rng, data.len());
    match below(rng, 6) {
        0 if !data.is_empty() => data[at] ^= 1 << below(rng, 8),
        1 if !data.is_empty() => data[at] = MARKS[below(rng, MARKS.len())],
        2 => data.truncate(at),
        3 => {
            let part: Vec<u8> = data[at..].iter().take(below(rng, 64)).copied().collect();
            data.splice(at..at, part);
        }
        4 => data.splice(at.., other[below(rng, other.len())..].iter().copied()).for_each(drop),
        _ => {
            let length = [0, 0xff_u8][below(rng, 2)];
            data.iter_mut().skip(at).take(4).for_each(|byte| *byte = length);
        }
    }
}

fn attack(target: fn(&[u8])) {
    let seeds = seeds();
    assert!(seeds.len() > 10);
    seeds.iter().for_each(|seed| target(seed));
    let count = std::env::var("GRASPBOX_FUZZ").map_or(MUTATIONS, |text| text.parse().unwrap());
    let mut rng = TestRng::from_seed(RngAlgorithm::ChaCha, &[7; 32]);
    for round in 0..count {
        let mut data = seeds[round % seeds.len()].clone();
        for _ in 0..=below(&mut rng, 4) {
            let other = below(&mut rng, seeds.len());
            mutate(&mut rng, &mut data, &seeds[other]);
        }
        target(&data);
    }
}

#[test]
fn frames_are_read_or_refused() {
    attack(bodies::decode);
}

#[test]
fn commands_are_read_or_refused() {
    attack(bodies::request);
}

#[test]
fn a_request_without_the_token_is_refused() {
    attack(bodies::gate);
}

/// Lists in lists, each of which says that it holds 2^32 - 1 values, before many bytes: room for all of them at every level would be
/// 400 MB. And an array of bytes where numbers belong, whose entries would be as much.
#[test]
#[ignore = "needs an address space of its own; `memory_is_bounded` runs it"]
fn hostile_frames() {
    for marker in [0xdd_u8, 0xdf] {
        let mut frame = Vec::new();
        for _ in 0..32 {
            frame.push(marker);
            frame.extend([0xff; 4]);
            if marker == 0xdf {
                frame.extend([0xa1, b'x']);
            }
        }
        frame.extend([0xc0; 190_000]);
        assert!(graspbox_server::decode(&frame).is_err());
    }
    let mut frame = graspbox_server::Encoder::default();
    frame.map(3);
    for (key, value) in [("id", "1"), ("command", "render"), ("env_ids", "")] {
        frame.text(key);
        match value {
            "1" => frame.integer(1),
            "" => frame.array(&vec![1_u8; 8 << 20], &[8 << 20]),
            text => frame.text(text),
        }
    }
    bodies::request(&frame.into_bytes());
}

/// The frames of `hostile_frames` were read with up to 100 times their memory.
#[test]
fn memory_is_bounded() {
    let run = format!("ulimit -v {SPACE} && exec \"$0\" --exact hostile_frames --ignored --test-threads=1");
    let me = std::env::current_exe().unwrap();
    let ran = Command::new("sh").arg("-c").arg(run).arg(me).env("RUST_MIN_STACK", "1048576").output().unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    assert!(String::from_utf8_lossy(&ran.stdout).contains("1 passed"));
}
