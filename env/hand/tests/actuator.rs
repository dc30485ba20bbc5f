//! Actuators: speeds, travels, loads.
#![allow(clippy::unwrap_used, clippy::panic)]

use graspbox_hand::{Actuator, ActuatorCommand, ActuatorState, Hand, Hold};
use proptest::prelude::*;

const DT: f64 = 0.002;

fn actuator() -> &'static Actuator {
    &Hand::reflex().unwrap().actuators[0]
}

fn go(target: f64) -> ActuatorCommand {
    ActuatorCommand::Position { target, speed: None }
}

/// Steps until the state no longer moves; returns the seconds it took.
fn run(state: &mut ActuatorState, command: ActuatorCommand, load: impl Fn(&ActuatorState) -> f64) -> f64 {
    for step in 0..10_000 {
        let before = state.position;
        let load = load(state);
        state.step(actuator(), command, load, DT).unwrap();
        if state.position == before {
            return f64::from(step) * DT;
        }
    }
    panic!("the actuator never came to rest: {state:?}");
}

#[test]
fn a_finger_closes_at_its_default_speed_and_opens_in_a_second_at_its_greatest() {
    let mut state = ActuatorState::new(actuator(), 0.0);
    let closing = run(&mut state, go(9.0), |_| 0.0);
    assert_eq!(state.position, 3.6, "the target is cut to the travel");
    assert!((closing - 3.6 / 3.0).abs() <= 1.5 * DT, "closed in {closing} s");
    assert_eq!(state.hold, Hold::Free, "it has arrived");
    let fast = ActuatorCommand::Position { target: 0.0, speed: Some(100.0) };
    let opening = run(&mut state, fast, |_| 0.0);
    assert_eq!(state.position, 0.0);
    assert!((opening - 3.6 / 3.5).abs() <= 1.5 * DT, "opened in {opening} s");
}

#[test]
fn a_velocity_command_runs_to_the_end_of_the_travel() {
    let mut state = ActuatorState::new(actuator(), 1.0);
    state.step(actuator(), ActuatorCommand::Velocity(0.5), 0.0, DT).unwrap();
    assert!((state.position - (1.0 + 0.5 * DT)).abs() < 1e-15);
    run(&mut state, ActuatorCommand::Velocity(9.0), |_| 0.0);
    assert_eq!((state.position, state.hold), (3.6, Hold::Travel));
    run(&mut state, ActuatorCommand::Velocity(-9.0), |_| 0.0);
    assert_eq!((state.position, state.hold), (0.0, Hold::Travel));
}

/// A finger that met an object at a spool angle of 2 rad: the tendon pulls like a spring from there.
fn blocked(state: &ActuatorState) -> f64 {
    Hand::reflex().unwrap().tendons[0].tension(0.0125 * (state.position - 2.0), 0.0)
}

#[test]
fn a_finger_whose_load_passes_its_limit_stops_pulling() {
    let mut state = ActuatorState::new(actuator(), 0.0);
    run(&mut state, go(3.6), blocked);
    assert_eq!((blocked(&state), state.hold), (50.0, Hold::Load));
    // 50 N stretch the tendon by 1 mm, 0.08 rad of the spool; a step adds at most 6 mrad.
    assert!((2.08..=2.08 + 3.0 * DT + 1e-9).contains(&state.position), "{}", state.position);
    let held = state.position;
    state.step(actuator(), go(0.0), 50.0, DT).unwrap();
    assert!(state.position < held, "a load never stops opening");
}

#[test]
fn a_force_command_reaches_its_load_and_holds_it() {
    let mut state = ActuatorState::new(actuator(), 1.9);
    for _ in 0..500 {
        let load = blocked(&state);
        state.step(actuator(), ActuatorCommand::Force(20.0), load, DT).unwrap();
    }
    assert!((blocked(&state) - 20.0).abs() < 0.01, "{} N", blocked(&state));
    for _ in 0..500 {
        let load = blocked(&state);
        state.step(actuator(), ActuatorCommand::Force(0.0), load, DT).unwrap();
    }
    assert!(blocked(&state) < 0.01, "a command of 0 N lets go");
    assert!(state.position > 1.99, "and does not open further");
}

#[test]
fn a_command_that_is_no_number_changes_nothing() {
    let mut state = ActuatorState::new(actuator(), 1.0);
    let before = state;
    for command in [go(f64::NAN), ActuatorCommand::Velocity(f64::INFINITY), ActuatorCommand::Force(f64::NAN)] {
        assert!(state.step(actuator(), command, 0.0, DT).is_err());
    }
    let message = state.step(actuator(), go(1.0), 0.0, 0.0).unwrap_err().to_string();
    assert_eq!(message, "the time step is 0 s; give a finite one greater than 0");
    assert_eq!(state, before);
}

proptest! {
    /// The travel and the greatest speed hold for any command; and a state survives a snapshot.
    #[test]
    fn travel_and_speed_hold_for_any_commands(
        commands in prop::collection::vec((0..3u8, -20.0..70.0f64, 0.0..80.0f64), 1..60),
        dt in 1e-4..0.05f64,
    ) {
        let mut state = ActuatorState::new(actuator(), 1.8);
        for (kind, value, load) in commands {
            let command = match kind {
                0 => ActuatorCommand::Position { target: value, speed: Some(value) },
                1 => ActuatorCommand::Velocity(value),
                _ => ActuatorCommand::Force(value),
            };
            let bytes = postcard::to_allocvec(&(state, command)).unwrap();
            let (mut copy, again): (ActuatorState, ActuatorCommand) = postcard::from_bytes(&bytes).unwrap();
            let before = state.position;
            state.step(actuator(), command, load, dt).unwrap();
            copy.step(actuator(), again, load, dt).unwrap();
            prop_assert_eq!(copy, state);
            prop_assert!((0.0..=3.6).contains(&state.position));
            prop_assert!((state.position - before).abs() <= 3.5 * dt + 1e-12);
            prop_assert!(!(load >= 50.0 && state.position > before), "closed against its load limit");
        }
    }
}
