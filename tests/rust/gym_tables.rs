//! Tables of observations, reward terms and infos: the values of every row, by name, against queries of the world that do not use the
//! tables. A new row needs an expected value here.
//!
//! A bug here: a reader in the wrong row, a row of the wrong size.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_episode::FailureKind;
use graspbox_gym::actions::action::OPEN_SHARE;
use graspbox_gym::actions::control::ClosedLoop;
use graspbox_gym::observations::info::{INFO, InfoValue, failure_names, info_table, read_info};
use graspbox_gym::observations::view::View;
use graspbox_gym::pool::env_episode::EnvEpisode;
use graspbox_gym::rewards::potentials::Potentials;
use graspbox_gym::rewards::reward::{Attempt, TERMS, TermValues, Transition, term_table};
use graspbox_gym::state::{
    ClearState, DecisionResult, GraspPoseState, GraspState, LastAttempt, Mode, Placed, Record, SceneKind, TargetScene,
};
use graspbox_gym::{Column, Control, EnvConfig, EnvPool, EnvSpec, Observation, Randomization, ResetOptions};
use graspbox_objects::Family;
use graspbox_tests::bench::bending;
use graspbox_tests::gym::{each_period, follow_until, objects, pool, seeds, target};
use graspbox_tests::scenes::{planned, procedural};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use std::collections::BTreeSet;
use std::sync::Arc;

fn columns_of(pose: &Isometry3<f64>) -> Vec<f64> {
    let m = pose.rotation.to_rotation_matrix();
    [m.matrix().column(0), m.matrix().column(1)]
        .iter()
        .flat_map(|column| column.iter().copied().collect::<Vec<_>>())
        .collect()
}

fn point(p: &Point3<f64>) -> Vec<f64> {
    p.coords.as_slice().to_vec()
}

fn flag(yes: bool) -> f64 {
    if yes { 1.0 } else { 0.0 }
}

/// 1 where the object touches: proximal and distal link of each finger, palm.
fn contact_flags(episode: &EnvEpisode) -> Vec<f64> {
    let world = episode.episode().world();
    let (hand, touching) = (world.hand(), world.contacts().links);
    let mut expected = Vec::new();
    for index in 0..hand.chain_count() {
        let distal = hand.joints[bending(hand, index)[1]].child;
        let own = touching.iter().filter(|link| hand.chain_of_link(**link) == Some(index));
        expected.push(flag(own.clone().any(|link| *link != distal)));
        expected.push(flag(own.clone().any(|link| *link == distal)));
    }
    expected.push(flag(touching.iter().any(|link| hand.chain_of_link(*link).is_none())));
    expected
}

/// Expected values of the column `name` of an observation.
fn expected(name: &str, episode: &EnvEpisode, spec: &EnvSpec) -> Vec<f64> {
    let (world, arm) = (episode.episode().world(), episode.arm());
    let hand = world.hand();
    let (object, verdict) = (world.world_from_object(), episode.episode().verdict());
    let in_hand = world.world_from_hand().inverse() * object;
    let frame = if spec.config.control.decides() { object } else { in_hand };
    let bent = |which: usize| {
        let joints = (0..hand.chain_count()).map(|finger| bending(hand, finger)[which]);
        joints.map(|joint| world.joint(joint).position).collect()
    };
    let spools = &world.actuators()[..3];
    match name {
        "hand_position" => arm.estimated_pose().translation.vector.as_slice().to_vec(),
        "hand_rotation" => columns_of(arm.estimated_pose()),
        "hand_velocity" => arm.velocity().0.as_slice().to_vec(),
        "hand_spin" => arm.velocity().1.as_slice().to_vec(),
        "proximal" => bent(0),
        "distal" => bent(1),
        "actuator" => spools.iter().map(|spool| spool.position).collect(),
        "actuator_speed" => spools.iter().map(|spool| spool.velocity).collect(),
        "load" => (0..3).map(|tendon| world.tension(tendon)).collect(),
        "preshape" => vec![world.preshape()],
        "tactile" => world.tactile().force,
        "object_position" => object.translation.vector.as_slice().to_vec(),
        "object_rotation" => columns_of(&object),
        "object_in_hand_position" => in_hand.translation.vector.as_slice().to_vec(),
        "object_in_hand_rotation" => columns_of(&in_hand),
        "object_velocity" => world.object_velocity_in_hand().0.as_slice().to_vec(),
        "object_spin" => world.object_velocity_in_hand().1.as_slice().to_vec(),
        "center_of_mass" => point(&(frame * episode.episode().scene().center_of_mass())),
        "bounds_center" => point(&(frame * episode.bounds_center())),
        "half_extents" => episode.half_extents().as_slice().to_vec(),
        "mass" => {
            let fresh = episode.episode().scene().template().spawn(&world.world_from_hand(), &object, 0.0);
            vec![fresh.object_mass() * episode.view(spec).record.mass]
        }
        "contact" => contact_flags(episode),
        "on_table" => vec![flag(world.contacts().scenery)],
        "lift" => vec![world.object_center().z - episode.judge().resting_height()],
        "held" => vec![episode.judge().held_time(world) / episode.judge().criterion().hold_time],
        "shift" => vec![verdict.shift],
        "turn" => vec![verdict.turn],
        "closure" => vec![episode.potentials().closure],
        "last_action" => episode.last_action().iter().map(|entry| f64::from(*entry)).collect(),
        other => panic!("no expected value for the column {other}: add one"),
    }
}

/// Compares the values of an observation with the expected values of its columns, by name.
fn compare(columns: &[Column], values: &[f32], episode: &EnvEpisode, spec: &EnvSpec) -> Result<(), String> {
    let mut rest = values;
    for column in columns {
        let (own, others) = rest.split_at_checked(column.size).ok_or("too few values")?;
        let wanted = expected(&column.name, episode, spec);
        let near = |(value, want): (&f32, &f64)| {
            (f64::from(*value) - want.clamp(column.low, column.high)).abs() < 1e-6 * (1.0 + want.abs())
        };
        if wanted.len() != own.len() || !own.iter().zip(&wanted).all(near) {
            return Err(format!("{} is {own:?} instead of {wanted:?}", column.name));
        }
        rest = others;
    }
    if rest.is_empty() { Ok(()) } else { Err("too many values".into()) }
}

/// Compares every observation of environment 0 of a pool of one; returns the columns of equal size that could be swapped unseen.
fn check_observations(pool: &EnvPool) -> BTreeSet<String> {
    let batch = pool.now();
    let env = pool.env(0).unwrap();
    let episode = env.episode().unwrap();
    let mut unseen = BTreeSet::new();
    for (spec, values) in pool.spec().observations.iter().zip(&batch.observations) {
        compare(&spec.columns, values, episode, pool.spec()).unwrap();
        for (i, a) in spec.columns.iter().enumerate() {
            for (j, b) in spec.columns.iter().enumerate().skip(i + 1).filter(|(_, b)| b.size == a.size) {
                let mut swapped = spec.columns.clone();
                swapped.swap(i, j);
                if compare(&swapped, values, episode, pool.spec()).is_ok() {
                    unseen.insert(format!("{}: {} and {}", spec.observation.name(), a.name, b.name));
                }
            }
        }
    }
    unseen
}

fn varied(control: Control, family: Family) -> Arc<EnvPool> {
    let randomization = Randomization { hand_position: 0.002, hand_rotation: 0.01, ..Randomization::default() };
    let config = EnvConfig { control, randomization, ..each_period() };
    Arc::new(EnvPool::new(objects(&[family]), config, 1).unwrap())
}

/// In the middle of a grasp, while the object is held and not yet for long enough; and when the hand turns and opens then.
#[test]
fn columns_hold_what_their_names_say() {
    let pool = varied(Control::TargetPose, Family::Mug);
    let objects = &pool.spec().objects;
    let (_, scene) = objects.scene(&objects.prepared(0).unwrap(), 0).unwrap();
    let options = ResetOptions { resting: Some(0), mass: Some(1.1), friction: Some(1.2), ..ResetOptions::default() };
    let grasps = planned(&procedural(Family::Mug, 0), &scene, 10, 0);
    let holds = || {
        let env = pool.env(0).unwrap();
        let episode = env.episode().unwrap();
        episode.judge().held_time(episode.episode().world()) > 0.1
    };
    let shaped = grasps.iter().filter(|grasp| grasp.preshape > 0.1);
    let held = shaped.into_iter().any(|grasp| {
        let driven = follow_until(&pool, &options, 3, grasp, |_| holds());
        holds() && !driven.success
    });
    assert!(held, "no grasp held the object");
    let while_held = check_observations(&pool);
    // Then the hand turns and opens: columns that did not change before change now.
    let (turned, preshape) = {
        let env = pool.env(0).unwrap();
        let episode = env.episode().unwrap();
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.3, -0.2, 0.4));
        (episode.arm().estimated_pose() * turn, episode.episode().world().preshape())
    };
    pool.step(&target(pool.spec().hand(), &turned, -0.5, preshape)).unwrap();
    let unseen: Vec<_> = while_held.intersection(&check_observations(&pool)).cloned().collect();
    assert!(unseen.is_empty(), "can be swapped: {unseen:?}");
}

#[test]
fn columns_before_a_decision_hold_what_their_names_say() {
    let config = EnvConfig {
        control: Control::GraspPose,
        observations: vec![Observation::State],
        randomization: Randomization::standard(),
        ..each_period()
    };
    let pool = EnvPool::new(objects(&[Family::Kettle]), config, 1).unwrap();
    pool.reset(&[Some(4)], None, &ResetOptions::default()).unwrap();
    assert_eq!(check_observations(&pool), BTreeSet::new());
}

fn potentials(first: f64) -> Potentials {
    let at = |k: f64| first + 0.07 * k * k;
    let (lift, push, slip) = (at(3.0), at(2.5), at(2.2));
    Potentials { reach: at(0.0), contact: at(1.0), closure: at(2.0), lift, hold: at(1.5), push, slip }
}

/// The value of the term `name`.
fn term(values: &TermValues, name: &str) -> f64 {
    f64::from(values[TERMS.iter().position(|term| term.name == name).unwrap()])
}

/// Every term of a step by name, and that nothing else is a term.
#[test]
fn terms_of_a_step_are_what_their_names_say() {
    let (before, after) = (Potentials { lift: 0.5, ..potentials(0.05) }, Potentials { reach: 0.9, ..potentials(0.2) });
    let base = Transition { time: 0.4, before, after, effort: 0.31, ..Transition::default() };
    let cases = [
        ("success", Transition { success: true, ..base }),
        ("secure", Transition { secure: true, ..base }),
        ("failure", Transition { lost: true, ..base }),
        ("table", Transition { table: true, ..base }),
        ("stop", Transition { stop: true, ..base }),
    ];
    for (raised, transition) in cases {
        let flag = |name: &str| flag(name == raised);
        for row in TERMS {
            let expected = match row.name {
                "reach" => after.reach - before.reach,
                "contact" => after.contact - before.contact,
                "closure" => after.closure - before.closure,
                "lift" => after.lift - before.lift,
                "hold" => after.hold - before.hold,
                "push" => before.push - after.push,
                "slip" => before.slip - after.slip,
                gain @ ("success" | "secure") => flag(gain),
                "failure" => -flag("failure"),
                // Costs are paid for the time of the step, others for the step.
                "effort" => -0.31 * 0.4,
                cost @ ("table" | "stop") => -0.4 * flag(cost),
                other => panic!("no expected value for the term {other}: add one"),
            };
            let value = term(&transition.terms(), row.name);
            assert!((value - expected).abs() < 1e-6, "{} is {value} instead of {expected}", row.name);
            assert!((row.step.low..=row.step.high).contains(&value), "{}", row.name);
        }
    }
}

/// Every term of a decision by name; those that are always 0 are not in its table.
#[test]
fn terms_of_a_decision_are_what_their_names_say() {
    let potentials = potentials(0.1);
    for (success, secure, infeasible) in [(true, true, false), (true, false, false), (false, false, true)] {
        let values = Attempt { potentials, success, secure, infeasible }.terms();
        for row in TERMS {
            let expected = match row.name {
                "reach" => potentials.reach,
                "contact" => potentials.contact,
                "closure" => potentials.closure,
                "lift" => potentials.lift,
                "hold" => potentials.hold,
                "push" => -potentials.push,
                "slip" => -potentials.slip,
                "success" => flag(success),
                "secure" => flag(secure),
                "failure" => -flag(infeasible),
                "effort" | "table" | "stop" => 0.0,
                other => panic!("no expected value for the term {other}: add one"),
            };
            let value = term(&values, row.name);
            assert!((value - expected).abs() < 1e-6, "{} is {value} instead of {expected}", row.name);
        }
    }
    let names: Vec<_> = term_table(Control::GraspPose).iter().map(|row| row.name).collect();
    let shaped = ["reach", "contact", "closure", "lift", "hold", "success", "failure", "push"];
    assert_eq!(names, [&shaped[..], &["secure", "slip"]].concat());
    assert_eq!(term_table(Control::Twist).len(), TERMS.len());
}

/// An episode whose state and verdict are made up. Cases 2 and 3 clear scenes, which the present view does not show; case 4 has a target
/// among others; case 5 is a decision.
struct Case {
    i: usize,
    success: bool,
    secure: bool,
    touches: bool,
    stopped: bool,
    failure: Option<FailureKind>,
}

impl Case {
    fn clears(&self) -> bool {
        [2, 3].contains(&self.i)
    }

    fn has_target(&self) -> bool {
        self.i == 4
    }

    fn count(&self, first: u32) -> u32 {
        first + self.i as u32
    }

    fn lift(&self) -> f64 {
        0.1 * self.i as f64
    }

    fn record(&self, like: &Record) -> Record {
        Record { success: self.success, object: self.i + 7, fits: self.i != 0, ..like.clone() }
    }

    fn mode(&self) -> Mode {
        let Self { i, secure, touches, stopped, failure, .. } = *self;
        let result = DecisionResult { failure, survives_shake: i == 5 };
        let scene = match self.has_target() {
            true => SceneKind::Target(TargetScene { objects: vec![cube(); 6], target: 4 }),
            false => SceneKind::Single { resting: i + 20, dropped: i == 1 },
        };
        if self.clears() {
            let last = LastAttempt { lift: self.lift(), secure, touches, disturbed: self.count(50) };
            let (attempts, cleared) = (self.count(30), self.count(40));
            let new = ClearState::new(Vec::new(), Isometry3::identity());
            Mode::Clear(ClearState { attempts, cleared, lost: 3, last, begun: 90, result, ..new })
        } else if i == 5 {
            Mode::GraspPose(GraspPoseState { control: Control::GraspPose, scene, result })
        } else {
            Mode::Grasp(GraspState { control: ClosedLoop::Twist, scene, lifting: false, stopped })
        }
    }

    fn expected(&self, name: &str) -> InfoValue {
        let counted = |number: u32| InfoValue::Index(if self.clears() { i64::from(number) } else { 0 });
        match name {
            "is_success" => InfoValue::Flag(self.success),
            "is_secure" => InfoValue::Flag(self.success && self.secure),
            "failure" => {
                let name = self.failure.map_or("", FailureKind::name);
                InfoValue::Index(failure_names().iter().position(|other| *other == name).unwrap() as i64)
            }
            "lift" => InfoValue::Number(self.lift()),
            "object" => InfoValue::Index(self.i as i64 + 7),
            "resting" => InfoValue::Index(if self.i == 1 || self.clears() || self.has_target() {
                -1
            } else {
                self.i as i64 + 20
            }),
            "fits" => InfoValue::Flag(self.i != 0),
            "touches" => InfoValue::Flag(self.touches),
            "protective_stop" => InfoValue::Flag(self.stopped),
            // No arm carries the hand of the view; `a_blocked_arm_says_so` has one.
            "arm_blocked" => InfoValue::Flag(false),
            "survives_shake" => InfoValue::Flag(self.i == 5),
            "infeasible" => InfoValue::Flag(self.failure == Some(FailureKind::Infeasible)),
            "attempts" => counted(self.count(30)),
            "cleared" => counted(self.count(40)),
            "lost" => counted(3),
            "remaining" => counted(90 - self.count(40) - 3),
            "disturbed" => counted(self.count(50)),
            "neighbours" => InfoValue::Index(if self.has_target() { 5 } else { 0 }),
            // Nothing else is in the world of the view.
            "neighbours_moved" => InfoValue::Index(0),
            other => panic!("no expected value for the entry {other}: add one"),
        }
    }
}

fn cube() -> Placed {
    Placed { slot: 0, object: 0, scale: 1.0, world_from_object: Isometry3::identity() }
}

/// Every entry of the info by name; no two entries of one type are always equal.
#[test]
fn infos_hold_what_their_names_say() {
    let pool = pool(&objects(&[Family::Box]), Control::Twist, 1);
    pool.reset(&seeds(&pool), None, &ResetOptions::default()).unwrap();
    let env = pool.env(0).unwrap();
    let episode = env.episode().unwrap();
    let cases = [
        (true, true, true, false, None),
        (true, false, false, true, None),
        (false, false, true, false, Some(FailureKind::Dropped)),
        (false, true, false, false, Some(FailureKind::Infeasible)),
        (true, true, true, false, None),
        (false, true, true, false, Some(FailureKind::Slipped)),
    ];
    let mut seen = Vec::new();
    for (i, (success, secure, touches, stopped, failure)) in cases.into_iter().enumerate() {
        let case = Case { i, success, secure, touches, stopped, failure };
        let mut view = episode.view(pool.spec());
        let (record, mode) = (case.record(view.record), case.mode());
        let clears = case.clears();
        (view.verdict.secure, view.verdict.lift) = if clears { (!secure, 9.0) } else { (secure, case.lift()) };
        view.touching = if touches != clears { vec![1] } else { Vec::new() };
        let info = read_info(&View { record: &record, mode: &mode, ..view });
        for (row, value) in INFO.iter().zip(info) {
            assert_eq!(value, case.expected(row.name), "{} in case {i}", row.name);
        }
        seen.push(info);
    }
    for (i, a) in INFO.iter().enumerate() {
        for (j, b) in INFO.iter().enumerate().skip(i + 1) {
            assert!(seen.iter().any(|info| info[i] != info[j]), "{} and {} can be swapped", a.name, b.name);
        }
    }
    // Before the first step there is no failure yet.
    let view = episode.view(pool.spec());
    let failure = INFO.iter().position(|row| row.name == "failure").unwrap();
    assert_eq!(read_info(&view)[failure], InfoValue::Index(0));
    let record = Record { steps: 1, ..view.record.clone() };
    let untouched = FailureKind::ALL.iter().position(|kind| *kind == FailureKind::NoContact).unwrap() as i64 + 1;
    assert_eq!(read_info(&View { record: &record, ..view })[failure], InfoValue::Index(untouched));
    let names = |control| info_table(control, false).iter().map(|row| row.name).collect::<Vec<_>>();
    assert!(names(Control::GraspPose).contains(&"infeasible") && !names(Control::Twist).contains(&"infeasible"));
}

/// Texts in tables name the constants that they describe.
#[test]
fn meanings_name_their_constants() {
    let pool = pool(&objects(&[Family::Box]), Control::Twist, 1);
    let actions = pool.spec().config.action().table(pool.spec().hand());
    let preshape = actions.iter().find(|column| column.name == "preshape").unwrap();
    assert!(preshape.meaning.contains(&format!("{:.0} %", 100.0 * OPEN_SHARE)), "{}", preshape.meaning);
}
