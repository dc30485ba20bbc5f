//! Holds primitives from above and prints slip, penetration, forces and speed: the quick look behind the hold suite.
#![allow(clippy::unwrap_used)]

use graspbox_episode::{Episode, Scene, TrialConfig};
use graspbox_hand::{Hand, MotorCommand, MotorKind};
use graspbox_sim::{Geometry, ObjectModel, PhysicsConfig};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use std::sync::Arc;

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let get = |k: &str, d: f64| {
        args.iter()
            .find_map(|a| a.strip_prefix(&format!("{k}=")).map(|v| v.parse().unwrap()))
            .unwrap_or(d)
    };
    let hand = Arc::new(Hand::reflex().unwrap().clone());
    let physics = PhysicsConfig {
        dt: get("dt", 0.002),
        solver_iterations: get("iters", 4.0) as usize,
        contact_frequency: get("cf", 240.0),
        contact_damping_ratio: get("cd", 2.0),
        static_contact_frequency: get("scf", 480.0),
        ..PhysicsConfig::default()
    };
    let cases: [(&str, Geometry, f64, f64); 4] = [
        ("box", Geometry::Cuboid(Vector3::new(0.03, 0.03, 0.03)), 0.2, 0.06),
        ("ball", Geometry::Ball { radius: 0.037 }, 0.2, 0.074),
        (
            "cylinder",
            Geometry::Cylinder {
                radius: 0.034,
                half_length: 0.051,
            },
            0.35,
            0.102,
        ),
        ("tall box", Geometry::Cuboid(Vector3::new(0.03, 0.045, 0.08)), 0.4, 0.16),
    ];
    for (name, geometry, mass, height) in cases {
        let object = ObjectModel::solid(&geometry, mass).unwrap();
        let pose = Isometry3::translation(0.0, 0.0, height / 2.0);
        let base = Point3::new(0.0, 0.0, -height / 2.0);
        let scene = Arc::new(Scene::settle(name, hand.clone(), &object, physics, &pose, base).unwrap());
        let down = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let palm = get("palm", (height + 0.005_f64).max(0.11));
        let start = Isometry3::from_parts(Translation3::new(0.0, 0.0, palm), down);
        let mut episode = Episode::reset(&scene, &start, get("preshape", 0.0));
        let close: Vec<_> = hand
            .motors
            .iter()
            .map(|m| {
                let target = match m.kind {
                    MotorKind::Finger(_) => m.travel[1],
                    MotorKind::Preshape => get("preshape", 0.0),
                };
                MotorCommand::Position { target, speed: None }
            })
            .collect();
        let config = TrialConfig::default();
        let clock = std::time::Instant::now();
        let mut steps = 0;
        let (mut depth, mut depth_n, mut depth_max) = (0.0, 0, 0.0f64);
        let mut held = None;
        let n = (5.3 / physics.dt) as usize;
        let (mut vmax, mut force) = (0.0f64, 0.0);
        for i in 0..n {
            let t = (i + 1) as f64 * physics.dt;
            let s = ((t - config.close_time) / config.lift_time).clamp(0.0, 1.0);
            let rise = 0.2 * s * s * s * (10.0 + s * (6.0 * s - 15.0));
            let target = Translation3::new(0.0, 0.0, rise) * start;
            episode.advance(&target, &close).unwrap();
            steps += 1;
            if args.iter().any(|a| a == "v") && i % 50 == 0 {
                let w = episode.world();
                let f: Vec<_> = (0..3)
                    .map(|k| {
                        let f = w.finger(k);
                        format!("{:.2}/{:.2} s{:.2} T{:.0}", f.proximal, f.distal, f.spool, f.tension)
                    })
                    .collect();
                println!(
                    "{t:.2} {f:?} obj {:?} {:?}",
                    w.world_from_object().translation.vector.as_slice(),
                    w.contacts()
                );
            }
            if t > 3.3 {
                let w = episode.world();
                if held.is_none() {
                    held = Some(w.hand_from_object());
                }
                if i % 5 == 0 {
                    let c = w.contacts();
                    depth += c.hand_depth;
                    depth_n += 1;
                    depth_max = depth_max.max(c.hand_depth);
                    force = c.hand_force;
                    vmax = vmax.max(w.object_velocity_in_hand().0.norm());
                }
            }
        }
        let wall = clock.elapsed().as_secs_f64();
        let then = held.unwrap();
        let now = episode.world().hand_from_object();
        let slip = (now.translation.vector - then.translation.vector).norm() / 2.0;
        println!(
            "{name:9} lift {:.3} {} slip {:.3} mm/s turn {:.3} deg/s pen mean {:.2} max {:.2} mm vmax {:.2} mm/s force {:.0} N  {:.0} steps/s",
            episode.verdict().lift,
            episode.verdict().success,
            slip * 1e3,
            (then.rotation.inverse() * now.rotation).angle().to_degrees() / 2.0,
            depth / depth_n as f64 * 1e3,
            depth_max * 1e3,
            vmax * 1e3,
            force,
            steps as f64 / wall
        );
    }
}
