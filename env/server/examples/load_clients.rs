//! Steps environments from several clients at once, each with its own session, under random actions:
//!
//! `cargo run --release -p graspbox-server --example load_clients -- ws://127.0.0.1:5055 CLIENTS ENVS STEPS`
//!
//! Prints environment steps per second of all clients together. `scripts/bench_server.py` compares many clients of one environment
//! with one client of many.

use graspbox_server::{Client, ClientOptions, Value, decode};
use std::sync::{Arc, Barrier};
use std::time::{Duration, Instant};

/// Entries of an action of `Grasp-v0` with the ReFlex hand and `fingers="each"`.
const ACTION: usize = 10;

/// Waits for an answer; an error of the server ends the program.
fn answer(client: &mut Client, id: u64) -> Result<(), Box<dyn std::error::Error>> {
    loop {
        if let Some(frame) = client.poll(id)? {
            return match decode(&frame)?.get("error").and_then(|error| error.get("message")) {
                Some(Value::Text(message)) => Err((*message).into()),
                _ => Ok(()),
            };
        }
    }
}

/// Makes environments and begins their episodes.
fn begin(url: &str, envs: usize, seed: u64) -> Result<Client, Box<dyn std::error::Error>> {
    let mut client = Client::connect(url, ClientOptions::default(), Duration::ZERO)?;
    let id = client.submit("make", 4, |frame| {
        frame.text("environment");
        frame.text("graspbox/Grasp-v0");
        frame.text("num_envs");
        frame.unsigned(envs as u64);
        frame.text("objects");
        frame.text("procedural:can:0-3");
        frame.text("keywords");
        frame.map(2);
        frame.text("fingers");
        frame.text("each");
        frame.text("control_freq");
        frame.unsigned(20);
    })?;
    answer(&mut client, id)?;
    let id = client.submit("reset", 1, |frame| {
        frame.text("seed");
        frame.unsigned(seed);
    })?;
    answer(&mut client, id)?;
    Ok(client)
}

/// Numbers in [-1, 1] that look random.
fn actions(count: usize, state: &mut u64) -> Vec<f32> {
    let mut next = || {
        *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (*state >> 40) as f32 / (1 << 23) as f32 - 1.0
    };
    (0..count).map(|_| next()).collect()
}

fn steps(client: &mut Client, envs: usize, count: usize, seed: u64) -> Result<(), Box<dyn std::error::Error>> {
    let mut state = seed;
    for _ in 0..count {
        let action = actions(envs * ACTION, &mut state);
        let id = client.submit("step", 1, |frame| {
            frame.text("actions");
            frame.array(&action, &[envs, ACTION]);
        })?;
        answer(client, id)?;
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let given: Vec<String> = std::env::args().skip(1).collect();
    let [url, rest @ ..] = given.as_slice() else {
        return Err("give an address, and the numbers of clients, environments of each, and steps".into());
    };
    let numbers = rest.iter().map(|text| text.parse()).collect::<Result<Vec<usize>, _>>()?;
    let [count, envs, length] = numbers[..] else {
        return Err("give the numbers of clients, of environments of each client, and of steps".into());
    };
    let clients = (0..count).map(|index| begin(url, envs, (index * envs) as u64)).collect::<Result<Vec<_>, _>>()?;
    let start = Arc::new(Barrier::new(count + 1));
    let threads: Vec<_> = clients
        .into_iter()
        .enumerate()
        .map(|(index, mut client)| {
            let start = Arc::clone(&start);
            std::thread::spawn(move || {
                start.wait();
                steps(&mut client, envs, length, index as u64).map_err(|error| error.to_string())
            })
        })
        .collect();
    start.wait();
    let started = Instant::now();
    for thread in threads {
        thread.join().map_err(|_| "a client broke down")??;
    }
    println!("{:.1}", (count * envs * length) as f64 / started.elapsed().as_secs_f64());
    Ok(())
}
