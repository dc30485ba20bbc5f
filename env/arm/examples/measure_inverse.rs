//! The rate at which reachable poses are found, and its time:
//! `cargo run --release -p graspbox-arm --example measure_inverse [-- ARM [POSES [STARTS]]]`.
//!
//! Poses are those of the flange in random postures within the limits, so that each has a solution.

use graspbox_arm::Inverse;
use graspbox_arm::inverse::Unsolved;
use graspbox_hand::arm::assets::{ARMS, arm_asset};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::ops::ControlFlow;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let names: Vec<&str> = words.first().map_or_else(|| ARMS.map(|arm| arm.name).to_vec(), |name| vec![name.as_str()]);
    let poses: usize = words.get(1).map_or(Ok(10_000), |text| text.parse())?;
    let starts: usize = words.get(2).map_or(Ok(32), |text| text.parse())?;
    println!("arm    found %  beyond limits  not met  too far | first us  4 solutions us  solutions | not reached us");
    for name in names {
        let arm = arm_asset(name)?.read()?;
        let inverse = Inverse::new(&arm);
        let limits: Vec<[f64; 2]> = arm.axis_joints().map(|joint| joint.limits).collect();
        let mut random = ChaCha8Rng::seed_from_u64(1);
        let mut targets = Vec::new();
        for _ in 0..poses {
            let q: Vec<f64> = limits.iter().map(|[low, high]| low + (high - low) * random.random::<f64>()).collect();
            targets.push(arm.forward_kinematics(&q)?[arm.flange]);
        }
        let (mut found, mut beyond, mut unmet, mut far) = (0, 0, 0, 0);
        let begin = Instant::now();
        for target in &targets {
            let solved = inverse.solve(target, starts, 1e-5, |solution| {
                let q = solution.values(arm.axes.len());
                beyond += usize::from(q.iter().zip(&limits).any(|(x, [low, high])| !(low..=high).contains(&x)));
                let met = arm.forward_kinematics(q).is_ok_and(|poses| {
                    let at = poses[arm.flange];
                    (at.translation.vector - target.translation.vector).norm() < 2e-6
                        && at.rotation.angle_to(&target.rotation) < 2e-5
                });
                unmet += usize::from(!met);
                ControlFlow::Break(())
            });
            found += usize::from(solved.is_ok());
            far += usize::from(solved == Err(Unsolved::TooFar));
        }
        let first = begin.elapsed().as_secs_f64() / poses as f64;
        let (begin, mut count) = (Instant::now(), 0);
        for target in targets.iter().take(poses / 10) {
            let mut own = 0;
            let _ = inverse.solve(target, starts, 1e-5, |_| {
                own += 1;
                if own >= 4 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            });
            count += own;
        }
        let four = begin.elapsed().as_secs_f64() / (poses / 10) as f64;
        // The same poses 10 cm outwards and turned: many cannot be reached.
        let (begin, mut unsolved, mut time) = (Instant::now(), 0, 0.0);
        for target in targets.iter().take(poses / 10) {
            let mut moved = *target;
            moved.translation.vector *= 1.3;
            let before = begin.elapsed();
            let solved = inverse.solve(&moved, starts, 1e-5, |_| ControlFlow::Break(()));
            if matches!(solved, Err(Unsolved::AtLimit(_) | Unsolved::NotFound)) {
                unsolved += 1;
                time += (begin.elapsed() - before).as_secs_f64();
            }
        }
        println!(
            "{name:6} {:7.2} {beyond:14} {unmet:8} {far:8} | {:8.0} {:15.0} {:10.2} | {:8.0} of {unsolved}",
            100.0 * found as f64 / poses as f64,
            1e6 * first,
            1e6 * four,
            count as f64 / (poses / 10) as f64,
            1e6 * time / f64::from(unsolved.max(1)),
        );
    }
    Ok(())
}
