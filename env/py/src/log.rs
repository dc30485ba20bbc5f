//! Log events of the core, for Python's `logging` (logger `graspbox`).
//!
//! Pool threads only collect events; the calling thread passes them to Python once it has the GIL again.

use pyo3::prelude::*;
use std::collections::VecDeque;
use std::fmt::Debug;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id, Record};
use tracing::subscriber::Subscriber;
use tracing::{Event, Level, Metadata};

/// Most events between two calls; the oldest are dropped.
const KEPT: usize = 256;
/// Attempts to take the lock before an event is dropped: a fork may have copied it while it was held.
const ATTEMPTS: usize = 1000;

static NOTES: Mutex<VecDeque<(u8, String)>> = Mutex::new(VecDeque::new());
static ANY: AtomicBool = AtomicBool::new(false);

/// Keeps events of this project's crates at level INFO and above; spans are not used.
struct Collector;

impl Subscriber for Collector {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        metadata.is_event() && *metadata.level() <= Level::INFO && metadata.target().starts_with("graspbox")
    }

    fn new_span(&self, _: &Attributes<'_>) -> Id {
        Id::from_u64(1)
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}

    fn record_follows_from(&self, _: &Id, _: &Id) {}

    fn event(&self, event: &Event<'_>) {
        let mut text = Text(String::new());
        event.record(&mut text);
        note(python_level(*event.metadata().level()), text.0);
    }

    fn enter(&self, _: &Id) {}

    fn exit(&self, _: &Id) {}
}

/// The message of an event.
struct Text(String);

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        if field.name() == "message" {
            self.0 = format!("{value:?}");
        }
    }
}

/// Numeric levels of Python's `logging`.
fn python_level(level: Level) -> u8 {
    match level {
        Level::ERROR => 40,
        Level::WARN => 30,
        Level::INFO => 20,
        _ => 10,
    }
}

fn note(level: u8, text: String) {
    for _ in 0..ATTEMPTS {
        if let Ok(mut notes) = NOTES.try_lock() {
            if notes.len() == KEPT {
                notes.pop_front();
            }
            notes.push_back((level, text));
            ANY.store(true, Ordering::Release);
            return;
        }
        std::thread::yield_now();
    }
}

/// Collects the events of this process from now on, unless another subscriber exists.
pub fn install() {
    drop(tracing::subscriber::set_global_default(Collector));
}

/// Passes the collected events to Python's `logging`. An exception of a handler is reported as unraisable, since the call itself succeeded.
pub fn emit(py: Python<'_>) {
    if !ANY.swap(false, Ordering::AcqRel) {
        return;
    }
    let Ok(notes) = NOTES.try_lock().map(|mut notes| std::mem::take(&mut *notes)) else {
        ANY.store(true, Ordering::Release);
        return;
    };
    let send = || -> PyResult<()> {
        let logger = py.import("logging")?.call_method1("getLogger", ("graspbox",))?;
        notes.iter().try_for_each(|(level, text)| logger.call_method1("log", (level, "%s", text)).map(drop))
    };
    if let Err(error) = send() {
        error.write_unraisable(py, None);
    }
}
