//! An agent in Rust: makes an environment on a server, steps it with random actions, and prints its rewards.
//!
//! `graspbox serve` in one terminal, and in another
//! `cargo run --release -p graspbox-server --example remote_env -- [ws://HOST:PORT] [STEPS]`. The variable `GRASPBOX_TOKEN` holds the
//! token, where the server has one. `docs/reference/protocol.md` lists the commands and the contents of their answers.

use bytes::Bytes;
use graspbox_server::wire::value::NdArray;
use graspbox_server::{Client, ClientOptions, Encoder, Value, decode};
use std::error::Error;
use std::process::ExitCode;
use std::time::Duration;

/// How long to try to take up the session after a lost connection.
const GRACE: Duration = Duration::from_secs(30);

type Failure = Box<dyn Error>;

fn main() -> ExitCode {
    match run() {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn run() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let url = arguments.next().unwrap_or_else(|| "ws://127.0.0.1:5055".to_owned());
    let steps: u64 = arguments.next().map_or(Ok(20), |steps| steps.parse())?;
    let options = ClientOptions { token: std::env::var("GRASPBOX_TOKEN").ok(), ca: None };
    let mut client = Client::connect(&url, options, GRACE)?;

    let keywords = serde_json::json!({"obs": ["proprio", "depth"], "reward": "dense", "image_size": 32});
    let made = call(&mut client, "make", 4, |frame| {
        frame.text("environment");
        frame.text("graspbox/Grasp-v0");
        frame.text("num_envs");
        frame.unsigned(1);
        frame.text("objects");
        frame.json(&serde_json::json!(["procedural:can:0-9"]));
        frame.text("keywords");
        frame.json(&keywords);
    })?;
    let width = action_size(&decode(&made)?)?;
    println!("{url}: actions of {width} numbers");

    let begun = call(&mut client, "reset", 1, |frame| {
        frame.text("seed");
        frame.unsigned(7);
    })?;
    print_observations(&decode(&begun)?)?;

    let (mut random, mut sum) = (1_u64, 0.0);
    for step in 0..steps {
        let actions: Vec<f32> = (0..width).map(|_| uniform(&mut random)).collect();
        let answer = call(&mut client, "step", 1, |frame| {
            frame.text("actions");
            frame.array(&actions, &[1, width]);
        })?;
        let answer = decode(&answer)?;
        let row = answer.get("now").ok_or("a step answers with 'now'")?;
        let reward = number(row, "reward")?;
        sum += reward;
        let touches = number(row.get("info").ok_or("a row has infos")?, "touches")?;
        let over = number(row, "terminated")? + number(row, "truncated")? > 0.0;
        println!(
            "step {step}: reward {reward:.6}, touches {touches}{}",
            if over { ", the episode is over" } else { "" }
        );
    }
    println!("{steps} steps, return {sum:.6}");
    call(&mut client, "close", 0, |_| {})?;
    Ok(())
}

/// Sends a command and waits for its answer.
fn call(client: &mut Client, command: &str, fields: usize, write: impl FnOnce(&mut Encoder)) -> Result<Bytes, Failure> {
    let id = client.submit(command, fields, write)?;
    let answer = loop {
        if let Some(answer) = client.poll(id)? {
            break answer;
        }
    };
    match decode(&answer)?.get("error").and_then(|error| error.get("message")) {
        Some(Value::Text(message)) => Err((*message).into()),
        _ => Ok(answer),
    }
}

/// Numbers of an action.
fn action_size(made: &Value<'_>) -> Result<usize, Failure> {
    let space = made.get("description").and_then(|described| described.get("action_space"));
    match space.and_then(|space| space.get("shape")) {
        Some(Value::List(shape)) if matches!(shape[..], [Value::Integer(_)]) => match shape[0] {
            Value::Integer(size) => Ok(usize::try_from(size)?),
            _ => Err("the action space has no size".into()),
        },
        _ => Err("the action space has one axis".into()),
    }
}

/// Shapes of the first observations.
fn print_observations(answer: &Value<'_>) -> Result<(), Failure> {
    let observations = answer.get("now").and_then(|now| now.get("observations"));
    let Some(Value::Map(entries)) = observations else { return Err("a reset answers with observations".into()) };
    for (name, value) in entries {
        if let Value::Array(NdArray { dtype, shape, .. }) = value {
            println!("observation {name}: {} {shape:?}", dtype.name());
        }
    }
    Ok(())
}

/// The number of the one environment in an array of a row.
fn number(row: &Value<'_>, name: &str) -> Result<f64, Failure> {
    match row.get(name) {
        Some(Value::Array(array)) => match array.item(0) {
            Value::Float(number) => Ok(number),
            Value::Integer(number) => Ok(number as f64),
            Value::Bool(flag) => Ok(f64::from(u8::from(flag))),
            _ => Err(format!("{name} is no number").into()),
        },
        _ => Err(format!("the answer has no array {name}").into()),
    }
}

/// A number in [-1, 1): a linear congruential generator, which is random enough to shake a hand.
fn uniform(state: &mut u64) -> f32 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 40) as f32 / (1 << 23) as f32 - 1.0
}
