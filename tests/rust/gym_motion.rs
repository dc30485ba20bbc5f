//! Effects of an agent on the world, and their bounds: limits of the arm, table, protective stop, endings, success.
//!
//! A bug here: a hand that jerks the held object, that is driven into the table or crushes an object; an ending that is missed.
#![allow(clippy::unwrap_used)]

use graspbox_episode::approach::STOP_FORCE;
use graspbox_gym::actions::action::OPEN_SHARE;
use graspbox_gym::actions::arm_controller::{
    ANGULAR_ACCELERATION, ANGULAR_SPEED, ArmController, Goal, LINEAR_ACCELERATION, LINEAR_SPEED,
};
use graspbox_gym::actions::control::CONTROL_PERIOD;
use graspbox_gym::actions::guard::{Guard, TABLE_CLEARANCE};
use graspbox_gym::actions::workspace::{LOST_DISTANCE, WORKSPACE_HIGH, WORKSPACE_LOW};
use graspbox_gym::observations::info::failure_names;
use graspbox_gym::rewards::reward::TERMS;
use graspbox_gym::starts::reset_options::ObjectChoice;
use graspbox_gym::{Control, EnvPool, Observation, ResetOptions};
use graspbox_objects::Family;
use graspbox_sim::{Geometry, HandLoad, PhysicsConfig};
use graspbox_tests::bench::{at, palm_down, reflex, template, turn_rate};
use graspbox_tests::gym::{flags, follow, indices, numbers, objects, pool, seeds};
use graspbox_tests::scenes::{planned, procedural};
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

const DT: f64 = 0.002;
const NO_LOAD: HandLoad =
    HandLoad { force: Vector3::new(0.0, 0.0, 0.0), at: Point3::new(0.0, 0.0, 0.0), object: false, scenery: false };

/// Extremes of a motion: speeds and accelerations, linear and angular; and the lowest point of the base.
#[derive(Debug, Default)]
struct Worst {
    speed: [f64; 2],
    acceleration: [f64; 2],
    lowest: f64,
}

/// Drives an arm through `goals`, one a control period, and measures every step.
fn drive(arm: &mut ArmController, guard: &Guard, goals: impl Iterator<Item = Goal>) -> Worst {
    let mut worst = Worst { lowest: f64::INFINITY, ..Worst::default() };
    let mut before = (Vector3::zeros(), Vector3::zeros());
    for goal in goals {
        let motion = arm.begin(&goal, CONTROL_PERIOD);
        for i in 0..25 {
            let from = arm.world_from_hand();
            let to = arm.advance(&motion, f64::from(i) * DT, DT, guard, &NO_LOAD);
            let now = ((to.translation.vector - from.translation.vector) / DT, turn_rate(&from, &to, DT));
            for (k, (a, b)) in [(now.0, before.0), (now.1, before.1)].into_iter().enumerate() {
                worst.speed[k] = worst.speed[k].max(a.norm());
                worst.acceleration[k] = worst.acceleration[k].max((a - b).norm() / DT);
            }
            before = now;
            worst.lowest = worst.lowest.min(guard.lowest(&to));
            for axis in 0..3 {
                let at = to.translation.vector[axis];
                assert!((WORKSPACE_LOW[axis] - 1e-5..=WORKSPACE_HIGH[axis] + 1e-5).contains(&at), "axis {axis}: {at}");
            }
        }
    }
    worst
}

/// Numbers in [-1, 1), the same everywhere.
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed;
    move || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

fn random_goals(seed: u64) -> impl Iterator<Item = Goal> {
    let mut unit = noise(seed);
    (0..400).map(move |i| {
        let mut three = |size: f64| Vector3::new(unit(), unit(), unit()) * size;
        // Each mode for a while, jumping between its extremes.
        match i / 20 % 3 {
            0 => Goal::Twist(three(2.0 * LINEAR_SPEED), three(2.0 * ANGULAR_SPEED)),
            1 => Goal::Delta(Isometry3::new(three(0.05), three(0.2))),
            _ => Goal::Pose(Isometry3::new(three(0.5) + Vector3::new(0.0, 0.0, 0.3), three(2.0))),
        }
    })
}

/// In free space the limits hold to the digit.
#[test]
fn the_arm_keeps_its_limits() {
    let guard = Guard::new(&reflex()).unwrap();
    let high = palm_down(0.0, 0.0, 0.4);
    for seed in 0..20 {
        let mut arm = ArmController::new(&high, &Isometry3::identity());
        let free = random_goals(seed).map(|goal| match goal {
            Goal::Pose(pose) => Goal::Pose(Isometry3::from_parts(
                Translation3::from(pose.translation.vector * 0.2 + Vector3::new(0.0, 0.0, 0.34)),
                pose.rotation,
            )),
            // Towards the middle, so that no wall is met.
            _ => Goal::Pose(high),
        });
        let worst = drive(&mut arm, &guard, free);
        assert!(worst.speed[0] <= LINEAR_SPEED + 1e-9 && worst.speed[1] <= ANGULAR_SPEED + 1e-6, "{worst:?}");
        assert!(worst.speed[0] > 0.5 * LINEAR_SPEED && worst.speed[1] > 0.9 * ANGULAR_SPEED, "{worst:?}");
        assert!(worst.acceleration[0] <= LINEAR_ACCELERATION + 1e-6, "{worst:?}");
        assert!(worst.acceleration[1] <= ANGULAR_ACCELERATION + 1e-3, "{worst:?}");
    }
}

/// For any commands, the base stays off the table and the hand inside its box.
#[test]
fn the_palm_never_meets_the_table() {
    let guard = Guard::new(&reflex()).unwrap();
    let mut lowest = f64::INFINITY;
    for seed in 0..40 {
        let error = Isometry3::new(Vector3::new(0.005, -0.005, 0.005), Vector3::new(0.03, 0.02, -0.03));
        let mut arm = ArmController::new(&palm_down(0.1, 0.0, 0.2), &error);
        let sinking = random_goals(seed).map(|goal| match goal {
            Goal::Pose(mut pose) => {
                pose.translation.vector.z -= 0.3;
                Goal::Pose(pose)
            }
            other => other,
        });
        let worst = drive(&mut arm, &guard, sinking);
        lowest = lowest.min(worst.lowest);
        println!("{worst:?}");
        assert!(worst.acceleration[0] < 4.0 * LINEAR_ACCELERATION, "{worst:?}");
    }
    assert!((TABLE_CLEARANCE - 1e-9..TABLE_CLEARANCE + 0.001).contains(&lowest), "{lowest}");
}

/// A goal that moves smoothly is followed without lag; one that jumps is reached and kept.
#[test]
fn goals_are_reached_and_followed() {
    let guard = Guard::new(&reflex()).unwrap();
    let start = palm_down(0.0, 0.0, 0.2);
    let mut arm = ArmController::new(&start, &Isometry3::identity());
    for i in 1..=20 {
        let s = f64::from(i) * CONTROL_PERIOD;
        let rise = 0.2 * s * s * s * (10.0 + s * (6.0 * s - 15.0));
        let goal = Translation3::new(0.0, 0.0, rise) * start;
        drive(&mut arm, &guard, std::iter::once(Goal::Pose(goal)));
        let lag = (arm.world_from_hand().translation.vector - goal.translation.vector).norm();
        assert!(lag < 1.5e-3, "{lag} m behind at {s} s");
    }
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.5, -1.0, 2.0));
    let goal = Isometry3::from_parts(Translation3::new(0.2, -0.2, 0.5), turn * start.rotation);
    let here = arm.world_from_hand();
    drive(&mut arm, &guard, std::iter::repeat_n(Goal::Pose(here), 10));
    let worst = drive(&mut arm, &guard, std::iter::repeat_n(Goal::Pose(goal), 50));
    let at = arm.world_from_hand();
    assert!((at.translation.vector - goal.translation.vector).norm() < 1e-5, "{at}");
    assert!(at.rotation.angle_to(&goal.rotation) < 1e-4, "{at}");
    assert!(worst.acceleration[0] <= LINEAR_ACCELERATION + 1e-6, "{worst:?}");
    // Steps add up, and a hand that stands still stays where it is.
    let step = Isometry3::new(Vector3::new(0.0, 0.0, 0.01), Vector3::zeros());
    drive(&mut arm, &guard, std::iter::repeat_n(Goal::Delta(step), 10));
    drive(&mut arm, &guard, std::iter::repeat_n(Goal::Delta(Isometry3::identity()), 20));
    let moved = goal.inverse() * arm.world_from_hand();
    assert!((moved.translation.vector - Vector3::new(0.0, 0.0, 0.1)).norm() < 1e-4, "{moved}");
}

/// An action of a pool in twist mode: velocity along z of the world at full speed, the fingers as they are.
fn vertical(pool: &EnvPool, up: f32) -> Vec<f32> {
    let mut action = vec![0.0; pool.spec().action];
    // The palm faces down: hand z is against the world's.
    action[2] = -up;
    action
}

/// Pressed down on an object, the hand stops, backs off to the limit of its force, and can rise again.
#[test]
fn an_object_under_the_palm_is_not_crushed() {
    let pool = pool(&objects(&[Family::Box, Family::Can, Family::Kettle]), Control::Twist, 1);
    for (object, resting) in [(0, 0), (1, 0), (2, 0)] {
        let hand = palm_down(0.0, 0.0, 0.45).to_homogeneous();
        let options = ResetOptions {
            object: Some(ObjectChoice::Index(object)),
            resting: Some(resting),
            place: Some([0.0, 0.0, 0.4]),
            world_from_hand: Some(std::array::from_fn(|i| std::array::from_fn(|j| hand[(i, j)]))),
            ..ResetOptions::default()
        };
        pool.reset(&[Some(1)], None, &options).unwrap();
        let (mut stopped, mut pressed, mut peak, mut late, mut deepest) = (0, 0, 0.0_f64, 0.0_f64, 0.0_f64);
        for i in 0..80 {
            let batch = pool.step(&vertical(&pool, -1.0)).unwrap().now;
            if batch.terminated[0] {
                break;
            }
            stopped += usize::from(flags(&batch, "protective_stop")[0]);
            let env = pool.env(0).unwrap();
            let episode = env.episode().unwrap();
            let force = episode.arm().stop.force();
            peak = peak.max(force);
            pressed += usize::from(force > STOP_FORCE);
            deepest = deepest.max(episode.episode().world().contacts().hand_depth);
            late = if i >= 60 { late.max(force) } else { late };
        }
        let low = pool.env(0).unwrap().episode().unwrap().arm().estimated_pose().translation.z;
        println!(
            "object {object}: stopped in {stopped} steps, force {peak:.0} N at most, {late:.0} N late, depth {deepest:.4} m, hand at {low:.3} m"
        );
        assert!(stopped > 10, "the stop was never needed: the hand missed the object");
        // A collision at full speed takes the object's momentum within a step or two; after that, nothing above the limit.
        assert!(peak < 15.0 * STOP_FORCE && pressed <= 3 && late < STOP_FORCE, "{peak} N, {pressed} steps, {late} N");
        // The arm brakes over some 4 mm, which palm and table share.
        assert!(deepest < 0.0025, "{deepest} m");
        for _ in 0..10 {
            pool.step(&vertical(&pool, 1.0)).unwrap();
        }
        let high = pool.env(0).unwrap().episode().unwrap().arm().estimated_pose().translation.z;
        assert!(high > low + 0.1, "the hand is caught at {high}");
    }
}

/// Grasps that the planner ranks first succeed through actions; the terms follow the grasp.
#[test]
fn a_planned_grasp_succeeds_by_actions_alone() {
    for family in [Family::Box, Family::Can, Family::Ball] {
        let objects = objects(&[family]);
        let pool = pool(&objects, Control::TargetPose, 1);
        let (_, scene) = objects.scene(&objects.prepared(0).unwrap(), 0).unwrap();
        let options = ResetOptions { resting: Some(0), ..ResetOptions::default() };
        for (seed, grasp) in planned(&procedural(family, 0), &scene, 2, 0).iter().enumerate() {
            let driven = follow(&pool, &options, seed as u64, grasp);
            assert!(driven.success, "{family:?} {seed}: {driven:?}");
            assert_eq!((driven.failure, driven.stopped), (0, 0));
            let sum = |name: &str| driven.terms[TERMS.iter().position(|term| term.name == name).unwrap()];
            println!(
                "{family:?} {seed}: {:?}",
                TERMS.iter().zip(driven.terms).map(|(term, t)| (term.name, t)).collect::<Vec<_>>()
            );
            assert_eq!((sum("success"), sum("failure"), sum("stop")), (1.0, 0.0, 0.0));
            assert!((sum("hold") - 1.0).abs() < 1e-5 && (sum("lift") - 1.0).abs() < 1e-5);
            assert!((0.0..=1.0).contains(&sum("reach")) && (0.5..1.00001).contains(&sum("contact")), "{driven:?}");
            let state = pool.now();
            assert!(flags(&state, "is_success")[0] && flags(&state, "touches")[0] && numbers(&state, "lift")[0] > 0.15);
        }
    }
}

/// Pushed out of the workspace, a ball is lost; if nothing moves, none is.
#[test]
fn a_lost_object_ends_the_episode() {
    let pool = pool(&objects(&[Family::Ball]), Control::Twist, 1);
    let hand = palm_down(0.15, 0.15, 0.1).to_homogeneous();
    let options = ResetOptions {
        place: Some([0.3, 0.3, 0.0]),
        world_from_hand: Some(std::array::from_fn(|i| std::array::from_fn(|j| hand[(i, j)]))),
        ..ResetOptions::default()
    };
    pool.reset(&[Some(0)], None, &options).unwrap();
    let mut push = vec![0.0; pool.spec().action];
    // The hand's y axis is against the world's.
    (push[0], push[1]) = (1.0, -1.0);
    let ended = (0..200).find_map(|_| {
        let batch = pool.step(&push).unwrap().now;
        batch.terminated[0].then_some(batch)
    });
    let batch = ended.unwrap();
    let env = pool.env(0).unwrap();
    let center = env.episode().unwrap().episode().world().object_center();
    assert!(center.coords.xy().norm() > LOST_DISTANCE, "{center}");
    assert!(!flags(&batch, "is_success")[0]);
    assert_eq!(failure_names()[indices(&batch, "failure")[0] as usize], "slipped");
    assert_eq!(batch.terms[TERMS.iter().position(|term| term.name == "failure").unwrap()], -1.0);
    drop(env);
    pool.reset(&[Some(0)], None, &ResetOptions::default()).unwrap();
    for _ in 0..40 {
        assert!(!pool.step(&vertical(&pool, 0.0)).unwrap().now.terminated[0]);
    }
}

/// Numbers stay in the bounds that the tables promise, also when everything is thrown about.
#[test]
fn observations_and_terms_stay_in_their_bounds() {
    for control in Control::CLOSED_LOOP {
        let pool = pool(&objects(&[Family::Ball, Family::Bottle, Family::Hammer]), control, 4);
        pool.reset(&seeds(&pool), None, &ResetOptions::default()).unwrap();
        let mut unit = noise(9);
        for _ in 0..120 {
            let actions: Vec<f32> = (0..4 * pool.spec().action).map(|_| (2.0 * unit()) as f32).collect();
            let batch = pool.step(&actions).unwrap().now;
            for (spec, values) in pool.spec().observations.iter().zip(&batch.observations) {
                let bounds = spec.columns.iter().map(|c| std::iter::repeat_n((c.low as f32, c.high as f32), c.size));
                let bounds: Vec<(f32, f32)> = bounds.flatten().collect();
                assert_eq!(values.len(), 4 * bounds.len());
                for (i, value) in values.iter().enumerate() {
                    let (low, high) = bounds[i % bounds.len()];
                    assert!((low..=high).contains(value), "{} {i}: {value}", spec.observation.name());
                }
            }
            // An object that the hand never touched stays in place.
            let mut lost = batch.terminated.iter().zip(indices(&batch, "failure"));
            assert!(lost.all(|(ended, code)| !ended || failure_names()[*code as usize] != "no_contact"));
            for (i, value) in batch.terms.iter().enumerate() {
                let term = &TERMS[i % TERMS.len()];
                let range = term.step.low as f32 - 1e-6..=term.step.high as f32 + 1e-6;
                assert!(range.contains(value), "{}: {value}", term.name);
            }
        }
    }
}

/// A world whose object is scaled at its start is one whose object was made so.
#[test]
fn a_varied_object_weighs_and_slides_as_it_was_told() {
    let half = Vector3::new(0.03, 0.03, 0.03);
    let cube = template(reflex(), &Geometry::Cuboid(half), 0.2, PhysicsConfig::default());
    let palm_up = at(0.0, 0.0, 0.5);
    for factor in [0.5, 1.0, 2.5] {
        let mut world = cube.spawn(&palm_up, &at(0.0, 0.0, 0.5305), 0.0);
        world.scale_object(1.0, factor);
        for _ in 0..400 {
            world.step(&palm_up, &[]).unwrap();
        }
        let weight = 0.2 * factor * 9.81;
        let force = world.hand_load().force.norm();
        assert!((force - weight).abs() < 0.02 * weight, "{force} N instead of {weight} N");
    }
    // The table's friction is 0.5 times the object's factor; the slope is 0.36.
    let slope = 20f64.to_radians();
    for (factor, slides) in [(1.0, false), (0.5, true), (0.8, false)] {
        let mut world = cube.spawn(&palm_up, &at(0.0, 0.0, 0.03), 0.0);
        world.scale_object(factor, 1.0);
        world.set_gravity(&Vector3::new(9.81 * slope.sin(), 0.0, -9.81 * slope.cos()));
        for _ in 0..250 {
            world.step(&palm_up, &[]).unwrap();
        }
        let moved = world.object_center().x;
        assert_eq!(moved > 0.02, slides, "moved by {moved} m at a factor of {factor}");
    }
}

/// Measurements of a real robot do not reveal where the object is, but for milliradians of fingers that swing: where one object sleeps earlier, the
/// hand takes long steps earlier.
#[test]
fn proprioception_and_touch_know_nothing_of_an_object_out_of_reach() {
    let objects = objects(&[Family::Can, Family::Banana]);
    let pool = pool(&objects, Control::Twist, 1);
    let sensed = |object: usize, place: [f64; 3]| {
        let object = Some(ObjectChoice::Index(object));
        let options = ResetOptions { object, place: Some(place), ..ResetOptions::default() };
        pool.reset(&[Some(5)], None, &options).unwrap();
        let moved = pool.step(&vertical(&pool, 0.3)).unwrap().now;
        let of = |name| pool.spec().observations.iter().position(|spec| spec.observation == name).unwrap();
        [Observation::Proprio, Observation::Tactile, Observation::State]
            .map(|name| moved.observations[of(name)].clone())
    };
    let (a, b) = (sensed(0, [0.05, 0.0, 0.0]), sensed(1, [-0.05, 0.02, 1.0]));
    assert!(a[0].iter().zip(&b[0]).all(|(a, b)| (a - b).abs() < 2e-3), "{:?} and {:?}", a[0], b[0]);
    assert_eq!(a[1], b[1]);
    assert_ne!(a[2], b[2]);
}

/// Once, the force of the step in which a turn ended stayed on the object, and drove it off the table.
#[test]
fn a_hand_that_stops_turning_leaves_the_object_alone() {
    let cube = template(reflex(), &Geometry::Cuboid(Vector3::repeat(0.03)), 0.2, PhysicsConfig::default());
    for rate in [0.5, 2.0] {
        let mut world = cube.spawn(&palm_down(0.2, 0.0, 0.3), &at(0.0, 0.0, 0.03), 0.0);
        let start = palm_down(0.2, 0.0, 0.3);
        for i in 0..500 {
            let angle = rate * DT * f64::from(i.min(100));
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle);
            let hand = Isometry3::from_parts(start.translation, turn * start.rotation);
            world.step(&hand, &[]).unwrap();
        }
        let moved = (world.object_center() - Point3::new(0.0, 0.0, 0.03)).norm();
        assert!(moved < 1e-3, "{moved} m at {rate} rad/s");
    }
}

/// A hand is shaped before it closes: any swivel of a loaded finger releases the object.
#[test]
fn closed_fingers_keep_the_preshape() {
    let pool = pool(&objects(&[Family::Can]), Control::Twist, 1);
    let rows = pool.spec().config.action().table(pool.spec().hand());
    let percent = 100.0 * OPEN_SHARE;
    assert!(
        rows[5].meaning.ends_with(&format!("no other actuator has closed by more than {percent:.0} % of its travel"))
    );
    pool.reset(&[Some(0)], None, &ResetOptions::default()).unwrap();
    let act = |spool: f32, preshape: f32, steps: usize| {
        let mut action = vec![0.0; pool.spec().action];
        action[6..9].fill(spool);
        action[9] = preshape;
        for _ in 0..steps {
            pool.step(&action).unwrap();
        }
        let env = pool.env(0).unwrap();
        env.episode().unwrap().episode().world().preshape()
    };
    let shaped = std::f64::consts::FRAC_PI_4;
    assert!((act(0.0, 0.0, 10) - shaped).abs() < 1e-6);
    // 0.525 rad of the spool's 3.6.
    act(1.0, 0.0, 3);
    for preshape in [-1.0, 0.3, 1.0] {
        assert!((act(0.0, preshape, 5) - shaped).abs() < 1e-6, "moved for {preshape}");
    }
    act(-1.0, 0.0, 3);
    assert!(act(0.0, 1.0, 20) > shaped + 0.1, "open fingers do not follow");
}
