//! The rate at which reachable poses are found, and its time:
//! `cargo run --release -p graspbox-arm --example measure_inverse [-- ARM [POSES [STARTS]]]`.
//!
//! Poses are those of the flange in random postures within the limits, so that each has a solution. The last column is for poses moved outwards by
//! 30 %, of those that no test rules out and that are not reached.

use graspbox_arm::inverse::Unsolved;
use graspbox_arm::{Inverse, Solution};
use graspbox_hand::arm::assets::{ARMS, arm_asset};
use graspbox_hand::{Arm, HandError};
use nalgebra::Isometry3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::ops::ControlFlow;
use std::time::Instant;

/// Angle to which five axes must meet a rotation, rad.
const ANGLE: f64 = 1e-5;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let names: Vec<&str> = words.first().map_or_else(|| ARMS.map(|arm| arm.name).to_vec(), |name| vec![name.as_str()]);
    let poses: usize = words.get(1).map_or(Ok(10_000), |text| text.parse())?;
    let starts: usize = words.get(2).map_or(Ok(32), |text| text.parse())?;
    println!("arm    found %  beyond limits  not met  too far | first us  4 solutions us  solutions | not reached us");
    for name in names {
        let arm = arm_asset(name)?.read()?;
        let inverse = Inverse::new(&arm);
        let targets = targets(&arm, poses)?;
        println!("{name:6} {} | {}", found(&arm, &inverse, &targets, starts), times(&inverse, &targets, starts));
    }
    Ok(())
}

/// Poses of the flange in random postures.
fn targets(arm: &Arm, count: usize) -> Result<Vec<Isometry3<f64>>, HandError> {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut pose = || {
        let joints = arm.axis_joints().map(|joint| joint.limits);
        let q: Vec<f64> = joints.map(|[low, high]| low + (high - low) * random.random::<f64>()).collect();
        Ok(arm.forward_kinematics(&q)?[arm.flange])
    };
    (0..count).map(|_| pose()).collect()
}

/// Share of the poses with a solution, and wrong solutions.
fn found(arm: &Arm, inverse: &Inverse, targets: &[Isometry3<f64>], starts: usize) -> String {
    let (mut found, mut beyond, mut unmet, mut far) = (0, 0, 0, 0);
    let begin = Instant::now();
    for target in targets {
        let solved = inverse.solve(target, starts, ANGLE, |solution: Solution| {
            let q = solution.values(arm.axes.len());
            let mut within = q.iter().zip(arm.axis_joints()).map(|(x, j)| (j.limits[0]..=j.limits[1]).contains(x));
            beyond += usize::from(!within.all(|within| within));
            let met = arm.forward_kinematics(q).is_ok_and(|poses| {
                let at = poses[arm.flange];
                let apart = (at.translation.vector - target.translation.vector).norm();
                apart < 2e-6 && at.rotation.angle_to(&target.rotation) < 2.0 * ANGLE
            });
            unmet += usize::from(!met);
            ControlFlow::Break(())
        });
        found += usize::from(solved.is_ok());
        far += usize::from(solved == Err(Unsolved::TooFar));
    }
    let count = targets.len() as f64;
    let time = 1e6 * begin.elapsed().as_secs_f64() / count;
    format!("{:7.2} {beyond:14} {unmet:8} {far:8} | {time:8.0}", 100.0 * found as f64 / count)
}

/// Time for four solutions, and for a pose without one.
fn times(inverse: &Inverse, targets: &[Isometry3<f64>], starts: usize) -> String {
    let part = &targets[..targets.len().div_ceil(10)];
    let (begin, mut count) = (Instant::now(), 0);
    for target in part {
        let mut own = 0;
        let _ = inverse.solve(target, starts, ANGLE, |_| {
            own += 1;
            if own >= 4 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        count += own;
    }
    let four = 1e6 * begin.elapsed().as_secs_f64() / part.len() as f64;
    let (mut unsolved, mut time) = (0, 0.0);
    for target in part {
        let mut moved = *target;
        moved.translation.vector *= 1.3;
        let begin = Instant::now();
        let solved = inverse.solve(&moved, starts, ANGLE, |_| ControlFlow::Break(()));
        if solved.is_err_and(|why| why != Unsolved::TooFar) {
            unsolved += 1;
            time += 1e6 * begin.elapsed().as_secs_f64();
        }
    }
    let each = f64::from(count) / part.len() as f64;
    format!("{four:15.0} {each:10.2} | {:8.0} of {unsolved}", time / f64::from(unsolved.max(1)))
}
