//! Observations: vectors by name, each a list of rows with the meaning and reader of its columns.

use crate::EnvError;
use crate::actions::control::ActionSpec;
use crate::observations::column::{Column, total_size};
use crate::observations::observation_row::{Reading, Row, Size};
use crate::observations::sensed::{ACTUATORS, ARM, AXES, TACTILE};
use crate::observations::simulated::{ACHIEVED_GOAL, DESIRED_GOAL, LAST_ACTION, RESTING, SIMULATED};
use crate::observations::view::View;
use graspbox_hand::Hand;
use serde::{Deserialize, Serialize};

/// The vector observations.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Observation {
    /// Proprioception of a real arm and hand.
    Proprio,
    /// Forces on the tactile sensors.
    Tactile,
    /// The complete state, including the object's pose: privileged.
    State,
    /// The position that is to reach the goal: privileged.
    AchievedGoal,
    /// The goal.
    DesiredGoal,
}

impl Observation {
    /// Those of environments with goals.
    pub const GOAL: [Self; 2] = [Self::AchievedGoal, Self::DesiredGoal];

    /// The observations of every environment.
    pub const ALL: [Self; 3] = [Self::Proprio, Self::Tactile, Self::State];

    /// Name in configs and dictionaries.
    pub fn name(self) -> &'static str {
        match self {
            Self::Proprio => "proprio",
            Self::Tactile => "tactile",
            Self::State => "state",
            Self::AchievedGoal => "achieved_goal",
            Self::DesiredGoal => "desired_goal",
        }
    }

    /// Its rows, in order.
    ///
    /// * `action`: in closed-loop control, the state includes the last action; before a decision it describes the object only.
    fn readings(self, hand: &Hand, action: ActionSpec) -> Vec<Reading> {
        let table = |rows: &'static [Row]| {
            // A hand without a preshape coordinate, or without an arm, has no such row.
            let there = |row: &&Row| !matches!(row.size, Size::Preshape | Size::Axes) || row.size.of(hand, action) > 0;
            rows.iter().filter(there).map(Reading::Row).collect::<Vec<_>>()
        };
        let joints = |encoder: bool| {
            let groups = hand.groups.iter().enumerate().filter(move |(_, group)| group.encoder == encoder);
            groups.map(|(index, _)| Reading::Joints(index)).collect::<Vec<_>>()
        };
        let proprio = || [table(ARM), table(AXES), joints(true), table(ACTUATORS)].into_iter().flatten();
        match self {
            Self::Proprio => proprio().collect(),
            Self::Tactile => table(TACTILE),
            Self::AchievedGoal => table(ACHIEVED_GOAL),
            Self::DesiredGoal => table(DESIRED_GOAL),
            Self::State if action.control.decides() => table(RESTING),
            Self::State => proprio().chain(joints(false)).chain(table(SIMULATED)).chain(table(LAST_ACTION)).collect(),
        }
    }

    /// Its columns, in order, for a hand and the meaning of its actions.
    pub fn table(self, hand: &Hand, action: ActionSpec) -> Vec<Column> {
        self.readings(hand, action).iter().map(|reading| reading.column(hand, action)).collect()
    }

    /// True if the hand has columns in it: a hand without tactile sensors has no tactile observation.
    pub fn exists(self, hand: &Hand, action: ActionSpec) -> bool {
        total_size(&self.table(hand, action)) > 0
    }

    /// True if no sensor of a real robot measures some part of it.
    pub fn privileged(self) -> bool {
        matches!(self, Self::State | Self::AchievedGoal)
    }
}

/// An observation of one pool: its columns and their readers.
pub struct ObservationSpec {
    pub observation: Observation,
    /// The columns, in order.
    pub columns: Vec<Column>,
    /// Number of entries.
    pub size: usize,
    readings: Vec<Reading>,
}

impl ObservationSpec {
    /// The observation for a hand and the meaning of its actions.
    pub fn new(observation: Observation, hand: &Hand, action: ActionSpec) -> Self {
        Self::of_readings(observation, observation.readings(hand, action), hand, action)
    }

    /// An observation with other rows than its own.
    pub(crate) fn of_readings(
        observation: Observation,
        readings: Vec<Reading>,
        hand: &Hand,
        action: ActionSpec,
    ) -> Self {
        let columns: Vec<Column> = readings.iter().map(|reading| reading.column(hand, action)).collect();
        Self { observation, size: total_size(&columns), columns, readings }
    }

    /// Appends the observation.
    ///
    /// # Errors
    /// [`EnvError::WrongSize`] for a reader whose number of entries differs from its row.
    pub fn read(&self, view: &View<'_>, out: &mut Vec<f32>) -> Result<(), EnvError> {
        out.reserve(self.size);
        self.readings.iter().zip(&self.columns).try_for_each(|(reading, column)| reading.read(column, view, out))
    }
}
