//! Observations: vectors by name, each a list of rows that say what its columns mean and how they are read.

use crate::AgentError;
use crate::column::{Column, total_size};
use crate::control::Control;
use crate::observation_row::Row;
use crate::sensed::{PROPRIO, TACTILE};
use crate::simulated::{LAST_ACTION, RESTING, SIMULATED};
use crate::view::View;
use graspbox_hand::Hand;
use serde::{Deserialize, Serialize};

/// What can be observed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Observation {
    /// What a real arm and hand sense of themselves.
    Proprio,
    /// Forces on the tactile sensors.
    Tactile,
    /// Everything, the object's pose included: privileged.
    State,
}

impl Observation {
    /// Every observation of this crate.
    pub const ALL: [Self; 3] = [Self::Proprio, Self::Tactile, Self::State];

    /// Its name in configs and dictionaries.
    pub fn name(self) -> &'static str {
        match self {
            Self::Proprio => "proprio",
            Self::Tactile => "tactile",
            Self::State => "state",
        }
    }

    /// Its rows, in order.
    ///
    /// * `control`: the state holds the last action; before a decision it describes the object alone.
    fn rows(self, control: Control) -> impl Iterator<Item = &'static Row> {
        let parts: [&'static [Row]; 3] = match self {
            Self::Proprio => [PROPRIO, &[], &[]],
            Self::Tactile => [TACTILE, &[], &[]],
            Self::State if control.decides() => [RESTING, &[], &[]],
            Self::State => [PROPRIO, SIMULATED, LAST_ACTION],
        };
        parts.into_iter().flatten()
    }

    /// Its columns, in order, for a hand and a control mode.
    pub fn table(self, hand: &Hand, control: Control) -> Vec<Column> {
        self.rows(control).map(|row| row.column(hand, control)).collect()
    }

    /// True if no sensor of a real robot measures some part of it.
    pub fn privileged(self) -> bool {
        self.rows(Control::default()).any(|row| row.privileged)
    }
}

/// An observation of one pool: its columns, and how they are read.
pub struct ObservationSpec {
    /// Which.
    pub observation: Observation,
    /// The columns, in order.
    pub columns: Vec<Column>,
    /// Number of entries.
    pub size: usize,
    rows: Vec<&'static Row>,
}

impl ObservationSpec {
    /// The observation for a hand and a control mode.
    pub fn new(observation: Observation, hand: &Hand, control: Control) -> Self {
        Self::of_rows(observation, observation.rows(control).collect(), hand, control)
    }

    /// An observation with other rows than its own.
    pub(crate) fn of_rows(observation: Observation, rows: Vec<&'static Row>, hand: &Hand, control: Control) -> Self {
        let columns: Vec<Column> = rows.iter().map(|row| row.column(hand, control)).collect();
        Self { observation, size: total_size(&columns), columns, rows }
    }

    /// Appends the observation.
    ///
    /// # Errors
    /// [`AgentError::WrongSize`] for a row whose reader gives another number of entries than the row says.
    pub fn read(&self, view: &View<'_>, out: &mut Vec<f32>) -> Result<(), AgentError> {
        out.reserve(self.size);
        self.rows.iter().zip(&self.columns).try_for_each(|(row, column)| row.read(column, view, out))
    }
}
