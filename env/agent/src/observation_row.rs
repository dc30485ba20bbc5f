//! One row of a table of observations, and where its reader writes.

use crate::AgentError;
use crate::column::Column;
use crate::control::Control;
use crate::view::View;
use graspbox_hand::Hand;

/// A row: some neighbouring entries of an observation, and how they are read.
pub struct Row {
    /// Name.
    pub name: &'static str,
    /// Number of entries.
    pub size: Size,
    /// Least and greatest value; others are clipped.
    pub bounds: fn(&Hand) -> [f64; 2],
    /// Unit; `1` for a number without one.
    pub unit: &'static str,
    /// What it means.
    pub meaning: &'static str,
    /// True if no sensor of a real robot measures it.
    pub privileged: bool,
    /// Writes exactly as many numbers as the size says.
    pub read: fn(&View<'_>, &mut Entries<'_>),
}

/// Number of entries of a row.
pub enum Size {
    /// The same for every hand.
    Fixed(usize),
    /// One per finger.
    Fingers,
    /// Proximal and distal link of each finger, then the palm.
    Links,
    /// One per tactile sensor.
    Sensors,
    /// One per entry of an action.
    Action,
}

impl Size {
    /// The number for a hand and a control mode.
    pub fn of(&self, hand: &Hand, control: Control) -> usize {
        match self {
            Self::Fixed(size) => *size,
            Self::Fingers => hand.fingers.len(),
            Self::Links => 2 * hand.fingers.len() + 1,
            Self::Sensors => hand.sensors.len(),
            Self::Action => control.size(hand),
        }
    }
}

/// Where a reader writes: every number is clipped to the bounds of its row.
pub struct Entries<'a> {
    out: &'a mut Vec<f32>,
    low: f32,
    high: f32,
}

impl Row {
    /// What the row is for a hand and a control mode.
    pub fn column(&self, hand: &Hand, control: Control) -> Column {
        let [low, high] = (self.bounds)(hand);
        Column {
            name: self.name,
            size: self.size.of(hand, control),
            low,
            high,
            unit: self.unit,
            meaning: self.meaning.to_owned(),
            privileged: self.privileged,
        }
    }

    /// Appends the numbers of this row.
    ///
    /// * `column`: what [`Row::column`] gave.
    ///
    /// # Errors
    /// [`AgentError::WrongSize`] if the reader gave another number of entries than the row says.
    pub fn read(&self, column: &Column, view: &View<'_>, out: &mut Vec<f32>) -> Result<(), AgentError> {
        let (begin, expected) = (out.len(), column.size);
        (self.read)(view, &mut Entries { out, low: column.low as f32, high: column.high as f32 });
        match out.len() - begin {
            found if found == expected => Ok(()),
            found => Err(AgentError::WrongSize { column: self.name, found, expected }),
        }
    }
}

impl Entries<'_> {
    /// Appends numbers; what is not a number becomes the least value.
    pub fn put(&mut self, values: impl IntoIterator<Item = f64>) {
        let (low, high) = (self.low, self.high);
        // `max` takes the bound if the value is not a number.
        self.out.extend(values.into_iter().map(|value| (value as f32).max(low).min(high)));
    }
}
