//! One row of a table of columns: adjacent entries of an observation or an action.

use serde::Serialize;
use std::borrow::Cow;

/// Adjacent entries of a vector with one meaning.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Column {
    pub name: Cow<'static, str>,
    /// Number of entries.
    pub size: usize,
    /// Least value; smaller ones are clipped.
    pub low: f64,
    /// Greatest value; larger ones are clipped.
    pub high: f64,
    /// Unit; `1` for a number without one.
    pub unit: &'static str,
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

/// Total number of entries of all columns.
pub fn total_size(columns: &[Column]) -> usize {
    columns.iter().map(|column| column.size).sum()
}
