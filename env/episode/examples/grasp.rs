//! Plans and tries grasps on every mesh of a folder: the developer's view of `graspbox grasp`.
#![allow(clippy::unwrap_used)]
use graspbox_episode::{Body, ObjectSpec, Progress, Scene, TrialConfig, run_trials};
use graspbox_hand::Hand;
use graspbox_plan::PlanParams;
use graspbox_sim::PhysicsConfig;
use std::collections::BTreeMap;
use std::sync::Arc;

fn main() {
    let folder = std::env::args().nth(1).unwrap();
    let only = std::env::args().nth(2).filter(|o| o != "all");
    let env = |k: &str, d: f64| std::env::var(k).map_or(d, |v| v.parse().unwrap());
    let poses = env("POSES", 20.0) as usize;
    let physics = PhysicsConfig {
        dt: env("DT", 0.002),
        solver_iterations: env("ITERS", 4.0) as usize,
        ..PhysicsConfig::default()
    };
    let hand = Arc::new(Hand::reflex().unwrap().clone());
    let masses: BTreeMap<String, f64> = std::fs::read_to_string(std::env::var("MASSES").unwrap_or_default())
        .unwrap_or_default()
        .lines()
        .filter_map(|l| {
            let mut f = l.split(',');
            Some((f.next()?.to_owned(), f.next()?.parse().ok()?))
        })
        .collect();
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|f| f.unwrap().path()).collect();
    files.sort();
    let mut labels = String::new();
    let (mut ok_all, mut tried, mut wall_all, mut any, mut first, mut n) = (0, 0, 0.0, 0, 0, 0);
    for file in files {
        let name = file.file_stem().unwrap().to_string_lossy().to_string();
        if only.as_ref().is_some_and(|o| !o.split(',').any(|o| name.contains(o))) {
            continue;
        }
        n += 1;
        let mesh = graspbox_mesh::load(&file, &graspbox_mesh::io::LoadOptions::default()).unwrap();
        let mass = masses.get(&name).copied();
        let spec = ObjectSpec {
            name: name.clone(),
            mesh,
            mass,
            parts: None,
        };
        let body = Body::prepare(&spec, Some(std::path::Path::new("/tmp/gbcache"))).unwrap();
        let scene = Arc::new(Scene::new(&body, hand.clone(), physics, None).unwrap());
        let clock = std::time::Instant::now();
        let plan = scene.plan(&body, &PlanParams::default()).unwrap();
        let planning = clock.elapsed().as_secs_f64();
        let grasps: Vec<_> = plan.ranked().iter().take(poses).map(|c| c.grasp).collect();
        if let Ok(which) = std::env::var("TRACE") {
            for i in which.split(',').map(|i| i.parse::<usize>().unwrap()) {
                let config = TrialConfig {
                    early_stop: false,
                    ..TrialConfig::default()
                };
                let (outcome, trace) = graspbox_episode::Trial::new(&scene, &grasps[i], config, true)
                    .run(&|| false)
                    .unwrap()
                    .unwrap();
                println!("{i} {outcome:?} preshape {:.2}", grasps[i].preshape);
                let trace = trace.unwrap();
                for w in trace.windows(2).step_by(10) {
                    let d = |s: &graspbox_episode::Sample| {
                        (s.world_from_hand.inverse() * s.world_from_object) * scene.center_of_mass()
                    };
                    let v = (d(&w[1]) - d(&w[0])).norm() / (w[1].time - w[0].time);
                    println!(
                        "  {:.2} z {:.3} v {:.1} mm/s d {:.3} q {:.2?} T {:.0?} F {:.0}",
                        w[1].time,
                        w[1].world_from_object.translation.z,
                        v * 1e3,
                        w[1].distance,
                        w[1].fingers,
                        w[1].tensions,
                        w[1].hand_force
                    );
                }
            }
            continue;
        }
        let clock = std::time::Instant::now();
        let out = run_trials(&scene, &grasps, TrialConfig::default(), &Progress::default()).unwrap();
        let wall = clock.elapsed().as_secs_f64();
        labels.extend(out.iter().map(|o| if o.success { '1' } else { '0' }));
        let ok = out.iter().filter(|o| o.success).count();
        let mut why: BTreeMap<String, usize> = BTreeMap::new();
        for o in out.iter().filter_map(|o| o.failure) {
            *why.entry(format!("{o:?}")).or_default() += 1;
        }
        if std::env::var("LIST").is_ok() {
            for (i, o) in out.iter().enumerate() {
                let c = &plan.ranked()[i];
                let hand = scene.world_from_object() * c.grasp.object_from_hand;
                let z = hand.rotation * nalgebra::Vector3::z();
                let y = hand.rotation * nalgebra::Vector3::y();
                let com = scene.world_from_object() * scene.center_of_mass();
                println!(
                    "  {i}: {} {:?} lift {:.3} pre {:.2} z {:.2} {:.2} {:.2} y {:.1} {:.1} {:.1} palm z {:.3} com z {:.3} box {} score {:.2}",
                    u8::from(o.success),
                    o.failure,
                    o.lift,
                    c.grasp.preshape,
                    z.x,
                    z.y,
                    z.z,
                    y.x,
                    y.y,
                    y.z,
                    hand.translation.z,
                    com.z,
                    c.box_index,
                    c.score
                );
            }
        }
        let lucky = out.first().is_some_and(|o| o.success);
        (ok_all, tried, wall_all) = (ok_all + ok, tried + out.len(), wall_all + wall);
        (any, first) = (any + usize::from(ok > 0), first + usize::from(lucky));
        println!(
            "{name:28} {ok:2}/{:2} first {} cand {} feas {} plan {planning:.2} s, {:.1} trials/s {why:?}",
            out.len(),
            u8::from(lucky),
            plan.candidates.len(),
            plan.feasible,
            out.len() as f64 / wall
        );
    }
    println!("LABELS {labels}");
    println!(
        "rate {ok_all}/{tried} = {:.3}, objects {any}/{n}, first {first}/{n} = {:.3}, {:.1} trials/s",
        ok_all as f64 / tried as f64,
        first as f64 / n as f64,
        tried as f64 / wall_all
    );
}
