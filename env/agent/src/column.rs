//! One row of a table of numbers: some neighbouring entries of an observation or an action.

use serde::Serialize;
use std::borrow::Cow;

/// Neighbouring entries of a vector that mean one thing.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Column {
    /// Name.
    pub name: Cow<'static, str>,
    /// Number of entries.
    pub size: usize,
    /// Least value; smaller ones are clipped.
    pub low: f64,
    /// Greatest value; larger ones are clipped.
    pub high: f64,
    /// Unit; `1` for a number without one.
    pub unit: &'static str,
    /// What it means.
    pub meaning: String,
    /// True if no sensor of a real robot measures it.
    pub privileged: bool,
}

impl Column {
    /// A column of an action.
    pub(crate) fn new(
        name: &'static str,
        size: usize,
        [low, high]: [f64; 2],
        unit: &'static str,
        meaning: impl Into<String>,
    ) -> Self {
        Self { name: name.into(), size, low, high, unit, meaning: meaning.into(), privileged: false }
    }
}

/// Number of entries of all columns together.
pub fn total_size(columns: &[Column]) -> usize {
    columns.iter().map(|column| column.size).sum()
}
