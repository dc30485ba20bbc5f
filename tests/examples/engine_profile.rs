//! TEMPORARY
use graspbox_episode::{Progress, TrialConfig, run_trials};
use graspbox_objects::Family;
use graspbox_sim::{PhysicsConfig, config::EngineKind};
use graspbox_tests::scenes::{planned, procedural, scene};
use std::sync::atomic::Ordering::Relaxed;

fn cpu() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/schedstat").unwrap();
    let _ = stat;
    let t = std::fs::read_to_string("/proc/self/stat").unwrap();
    let f: Vec<&str> = t.rsplit(')').next().unwrap().split_whitespace().collect();
    (f[11].parse::<f64>().unwrap() + f[12].parse::<f64>().unwrap()) / 100.0
}

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let rounds: usize = args.get(1).map_or(1, |s| s.parse().unwrap());
    let kinds: Vec<&str> = args.get(2).map_or(vec!["graspbox"], |s| s.split(',').collect());
    let dt: f64 = args.get(3).map_or(0.002, |s| s.parse().unwrap());
    let families = [Family::ALL[0], Family::ALL[1], Family::ALL[2], Family::ALL[3], Family::ALL[5], Family::ALL[7]];
    for kind in kinds {
        let engine = if kind == "rapier" { EngineKind::Rapier } else { EngineKind::Graspbox };
        let physics = PhysicsConfig { engine, dt, ..PhysicsConfig::default() };
        let mut work = Vec::new();
        for (i, family) in families.iter().enumerate() {
            let body = procedural(*family, i as u64);
            let scene = scene(&body, physics);
            let poses = planned(&body, &scene, 12, 0);
            work.push((scene, poses));
        }
        for c in &graspbox_solver::solver::COUNTS {
            c.store(0, Relaxed);
        }
        let (mut trials, mut time, mut won) = (0, 0.0, 0);
        let t = cpu();
        for _ in 0..rounds {
            for (scene, poses) in &work {
                let out = run_trials(scene, poses, TrialConfig::default(), &Progress::default()).unwrap();
                trials += out.len();
                time += out.iter().map(|o| o.time).sum::<f64>();
                won += out.iter().filter(|o| o.success).count();
            }
        }
        let t = cpu() - t;
        let c: Vec<u64> = graspbox_solver::solver::COUNTS.iter().map(|c| c.load(Relaxed)).collect();
        let steps = c[0].max(1) as f64;
        println!(
            "{kind}: {trials} trials, {won} succeed, {:.1} trials/s, {:.0} sim s/s, {:.1} us/step; per step: iterations {:.2}, evaluations {:.2}, points {:.1}; fallbacks {:.3} %, unconverged {:.3} %, convex {:.3} %",
            trials as f64 / t,
            time / t,
            t / steps * 1e6,
            c[1] as f64 / steps,
            c[2] as f64 / steps,
            c[3] as f64 / steps,
            100.0 * c[4] as f64 / steps,
            100.0 * c[5] as f64 / steps,
            100.0 * c[6] as f64 / steps
        );
    }
}
