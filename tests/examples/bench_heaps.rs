//! Time to make and settle piles, one thread: `cargo run --release -p graspbox-tests --example bench_heaps -- [OBJECTS] [PILES]`.
#![allow(clippy::unwrap_used)]

use graspbox_episode::{Body, Draw, Layout};
use graspbox_hand::assets::asset;
use graspbox_objects::Family;
use graspbox_sim::PhysicsConfig;
use graspbox_tests::scenes::procedural;
use std::sync::Arc;
use std::time::Instant;

fn main() {
    let mut numbers = std::env::args().skip(1).map(|text| text.parse::<usize>().expect("a number"));
    let (count, piles) = (numbers.next().unwrap_or(5), numbers.next().unwrap_or(4));
    let hand = Arc::new(asset("panda_gripper").unwrap().read().unwrap());
    let mut times = Vec::new();
    for pile in 0..piles {
        let bodies: Vec<Body> = (0..count)
            .map(|i| procedural(Family::ALL[(7 * i + 3 * pile) % Family::ALL.len()], (pile * count + i) as u64))
            .collect();
        let all: Vec<&Body> = bodies.iter().collect();
        let begin = Instant::now();
        let draw = Draw::seeded(pile as u64);
        let found = Layout::Pile.arrange(&all, &draw, &hand, PhysicsConfig::default(), None).unwrap();
        times.push(begin.elapsed().as_secs_f64());
        println!("pile {pile}: {:.3} s, {} of {count} objects stay", times[pile], found.objects.len());
    }
    times.sort_by(f64::total_cmp);
    println!(
        "{count} objects: median {:.3} s, mean {:.3} s",
        times[piles / 2],
        times.iter().sum::<f64>() / piles as f64
    );
}
