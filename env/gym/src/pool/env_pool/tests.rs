//! An inconsistent row is refused when a pool is made; panics are errors; a panic in a pending step is an error of its environment.

use super::*;
use crate::actions::control::Control;
use crate::observations::observation::{Observation, ObservationSpec};
use crate::observations::observation_row::{Reading, Row, Size};
use crate::source::Source;
use graspbox_hand::Hand;
use graspbox_objects::Family;
use graspbox_sim::PhysicsConfig;
use std::sync::mpsc::channel;

fn ball() -> Arc<Objects> {
    let ball = Source::Procedural { name: "ball".into(), family: Family::Ball, seed: 0, scale: 1.0, mass: None };
    let hand = Arc::new(Hand::reflex().unwrap().clone());
    Arc::new(Objects::new(vec![ball], hand, PhysicsConfig::default(), None).unwrap())
}

const fn two_numbers(size: Size) -> Row {
    Row {
        name: "odd",
        size,
        bounds: |_| [0.0, 1.0],
        unit: |_| "1",
        meaning: "two numbers",
        privileged: false,
        read: |_, out| out.put([0.5, f64::NAN]),
    }
}

/// A reader whose number of entries differs from its row is an error when environments are made, not at a reset.
#[test]
fn a_reader_that_does_not_fit_its_row_is_refused() {
    static ROWS: [Row; 3] = [two_numbers(Size::Fixed(2)), two_numbers(Size::Fixed(1)), two_numbers(Size::Actuators)];
    for (row, fits) in ROWS.iter().zip([true, false, false]) {
        for control in [Control::Twist, Control::GraspPose] {
            let mut spec = EnvSpec::new(ball(), EnvConfig { control, ..EnvConfig::default() }).unwrap();
            let odd = ObservationSpec::of_readings(
                Observation::State,
                vec![Reading::Row(row)],
                spec.hand(),
                spec.config.action(),
            );
            spec.observations.push(odd);
            match EnvPool::with_spec(spec, 1) {
                Ok(pool) => {
                    assert!(fits);
                    let batch = pool.reset(&[Some(0)], None, &ResetOptions::default()).unwrap();
                    assert_eq!(batch.observations.last().unwrap(), &[0.5, 0.0], "NaN becomes the least value");
                }
                Err(EnvError::WrongSize { column, found: 2, .. }) if column == "odd" => assert!(!fits),
                Err(other) => panic!("{other}"),
            }
        }
    }
}

/// `graspbox_py` makes an `InternalError` of the text, and the server a fault.
#[test]
fn a_panic_is_an_error_with_its_message() {
    let panicking = |work: fn() -> Result<i32, String>| caught(work, |text| format!("defect: {text}"));
    assert_eq!(panicking(|| panic!("a constant")), Err("defect: a constant".to_owned()));
    assert_eq!(panicking(|| panic!("number {}", 3)), Err("defect: number 3".to_owned()));
    assert_eq!(panicking(|| std::panic::panic_any(3)), Err("defect: no message".to_owned()));
    assert_eq!(panicking(|| Err("an error".to_owned())), Err("an error".to_owned()));
    assert_eq!(panicking(|| Ok(3)), Ok(3));
}

/// A panic in a pending step is an error of that environment only, and a reset makes it usable again.
#[test]
fn a_panic_of_a_sent_environment_is_its_error() {
    let pool = Arc::new(EnvPool::new(ball(), EnvConfig::default(), 2).unwrap());
    pool.reset(&[Some(0), Some(1)], None, &ResetOptions::default()).unwrap();
    let (sender, arrivals) = channel();
    let done = move |env, result| sender.send((env, result)).unwrap();
    pool.dispatch(&[0, 1], done, |pool, row, index| {
        let env = pool.lock(index);
        assert!(row != 1, "no step today");
        Ok(pool.row(index, &env))
    });
    for _ in 0..2 {
        let (env, result) = arrivals.recv().unwrap();
        assert!(matches!(pool.env(env), Err(EnvError::Busy { .. })));
        pool.arrived(env);
        match (env, result) {
            (0, Ok(stepped)) => assert_eq!(stepped.now.envs, [0]),
            (1, Err(EnvError::Broken { env: 1, why })) => assert!(why.contains("no step today"), "{why}"),
            (env, result) => panic!("environment {env}: {:?}", result.map(|s| s.now.envs)),
        }
    }
    let zeros = vec![0.0; 2 * pool.spec().action];
    pool.reset(&[None, None], Some(&[false, true]), &ResetOptions::default()).unwrap();
    assert_eq!(pool.step(&zeros).unwrap().now.len(), 2);
}
