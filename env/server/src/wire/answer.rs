//! Answers as frames: results of environments as arrays by name.

use crate::segment::Segment;
use crate::wire::encode::Encoder;
use crate::wire::fault::Fault;
use graspbox_gym::observations::info::{INFO, InfoArray};
use graspbox_gym::pool::env_pool::StepBatches;
use graspbox_gym::rewards::reward::TERM_COUNT;
use graspbox_gym::{Batch, EnvSpec};
use graspbox_render::{ImageTable, Pixels};
use std::sync::Arc;

/// Bytes of a frame without its arrays.
const HEAD: usize = 4096;

/// Encoding of results.
pub struct Layout<'a> {
    /// Properties shared by the environments.
    pub spec: &'a EnvSpec,
    /// Weights of the reward terms.
    pub weights: &'a [f64],
    /// Depth images as uint16 millimetres.
    pub millimetres: bool,
    /// Destination of large arrays, instead of the frame.
    pub segment: Option<Arc<Segment>>,
}

/// Begins the answer to command `id` with `entries` entries besides the number.
pub fn begin(id: u64, entries: usize, bytes: usize) -> Encoder {
    let mut frame = Encoder::with_capacity(HEAD + bytes);
    frame.map(entries + 1);
    frame.text("id");
    frame.unsigned(id);
    frame
}

/// The answer with an error; `id` is that of the command, if it had one.
pub fn error(id: Option<u64>, fault: &Fault) -> Vec<u8> {
    let mut frame = Encoder::default();
    frame.map(2);
    frame.text("id");
    match id {
        Some(id) => frame.unsigned(id),
        None => frame.nil(),
    }
    frame.text("error");
    frame.map(4);
    let Fault { kind, field, message, object } = fault;
    for (name, text) in [("type", kind), ("field", field), ("message", message), ("object", object)] {
        frame.text(name);
        frame.text(text);
    }
    frame.into_bytes()
}

/// The answer of a step: every row, and the final rows of episodes that ended in it.
pub fn stepped(id: u64, layout: &Layout<'_>, stepped: &StepBatches) -> Vec<u8> {
    let last = (!stepped.last.is_empty()).then_some(&stepped.last);
    let mut frame = rows(id, layout, 1 + usize::from(last.is_some()), size(&stepped.now) + last.map_or(0, size));
    frame.text("now");
    batch(&mut frame, layout, &stepped.now);
    if let Some(last) = last {
        frame.text("last");
        batch(&mut frame, layout, last);
    }
    frame.into_bytes()
}

/// The answer with the rows of a batch.
pub fn now(id: u64, layout: &Layout<'_>, found: &Batch) -> Vec<u8> {
    let mut frame = rows(id, layout, 1, size(found));
    frame.text("now");
    batch(&mut frame, layout, found);
    frame.into_bytes()
}

/// Begins an answer with rows of environments.
fn rows(id: u64, layout: &Layout<'_>, entries: usize, bytes: usize) -> Encoder {
    match &layout.segment {
        None => begin(id, entries, bytes),
        Some(segment) => {
            let mut frame = begin(id, entries, 0);
            frame.share(Arc::clone(segment));
            frame
        }
    }
}

/// Bytes of the arrays of a batch, at most.
fn size(batch: &Batch) -> usize {
    let images = batch.images.iter().map(|pixels| match pixels {
        Pixels::Bytes(values) => values.len(),
        Pixels::Floats(values) => 4 * values.len(),
    });
    let vectors = batch.observations.iter().map(|values| 4 * values.len());
    images.chain(vectors).sum::<usize>() + batch.len() * (4 * TERM_COUNT + 8 * INFO.len() + 32)
}

/// Bytes of the arrays of `rows` rows, a bound before allocation.
pub fn row_bytes(spec: &EnvSpec) -> usize {
    let images = spec.observer.tables().iter().map(|table| {
        let entries: usize = table.shape.iter().product();
        if table.dtype == "uint8" { entries } else { 4 * entries }
    });
    let vectors = spec.observations.iter().map(|observation| 4 * observation.size);
    images.chain(vectors).sum::<usize>() + 4 * TERM_COUNT + 8 * INFO.len() + 32
}

fn batch(frame: &mut Encoder, layout: &Layout<'_>, batch: &Batch) {
    let rows = batch.len();
    frame.map(8);
    frame.text("env_ids");
    frame.array(&batch.envs.iter().map(|env| *env as i64).collect::<Vec<_>>(), &[rows]);
    frame.text("observations");
    frame.map(batch.observations.len() + batch.images.len());
    for (spec, values) in layout.spec.observations.iter().zip(&batch.observations) {
        frame.text(layout.spec.config.shown_name(spec.observation.name()));
        frame.array(values, &[rows, spec.size]);
    }
    for (table, pixels) in layout.spec.observer.tables().iter().zip(&batch.images) {
        frame.text(layout.spec.config.shown_name(&table.name));
        image(frame, layout, table, pixels, rows);
    }
    frame.text("terms");
    frame.array(&batch.terms, &[rows, TERM_COUNT]);
    frame.text("reward");
    frame.array(&rewards(layout.weights, &batch.terms), &[rows]);
    let flags = [("terminated", &batch.terminated), ("truncated", &batch.truncated), ("reset", &batch.reset)];
    for (name, values) in flags {
        frame.text(name);
        frame.array(values, &[rows]);
    }
    frame.text("info");
    let infos = || INFO.iter().zip(&batch.info).filter(|(row, _)| row.is_in(layout.spec));
    frame.map(infos().count());
    for (row, values) in infos() {
        frame.text(row.name);
        match values {
            InfoArray::Flags(values) => frame.array(values, &[rows]),
            InfoArray::Numbers(values) => frame.array(values, &[rows]),
            InfoArray::Indices(values) => frame.array(values, &[rows]),
        }
    }
}

fn image(frame: &mut Encoder, layout: &Layout<'_>, table: &ImageTable, pixels: &Pixels, rows: usize) {
    let [a, b, c] = table.shape;
    let shape = [rows, a, b, c];
    match pixels {
        Pixels::Bytes(values) => frame.array(values, &shape),
        Pixels::Floats(values) if layout.millimetres && table.kind == "depth" => {
            // Saturates at 65.535 m; 0 stays 0, which means no measurement.
            let millimetres: Vec<u16> = values.iter().map(|depth| (depth * 1000.0 + 0.5) as u16).collect();
            frame.array(&millimetres, &shape);
        }
        Pixels::Floats(values) => frame.array(values, &shape),
    }
}

/// Weighted sums (rows,) of terms (rows, terms), one by one in f64, as `graspbox.envs.reward.total` has them.
pub fn rewards(weights: &[f64], terms: &[f32]) -> Vec<f64> {
    let row = |row: &[f32]| row.iter().zip(weights).fold(0.0, |sum, (term, weight)| sum + f64::from(*term) * weight);
    terms.chunks_exact(TERM_COUNT).map(row).collect()
}
