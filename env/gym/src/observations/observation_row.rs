//! One row of a table of observations, and the buffer of its reader.

use crate::EnvError;
use crate::actions::control::ActionSpec;
use crate::observations::column::Column;
use crate::observations::view::View;
use graspbox_hand::{Hand, JointKind};

/// A row: adjacent entries of an observation, and their reader.
pub struct Row {
    pub name: &'static str,
    /// Number of entries.
    pub size: Size,
    /// Least and greatest value; others are clipped.
    pub bounds: fn(&Hand) -> [f64; 2],
    /// Unit; `1` for a number without one.
    pub unit: fn(&Hand) -> &'static str,
    pub meaning: &'static str,
    /// True if no sensor of a real robot measures it.
    pub privileged: bool,
    /// Writes exactly `size` numbers.
    pub read: fn(&View<'_>, &mut Entries<'_>),
}

/// Number of entries of a row.
pub enum Size {
    /// The same for every hand.
    Fixed(usize),
    /// One per actuator except the preshape's.
    Actuators,
    /// One for a hand with a preshape coordinate, else none.
    Preshape,
    /// One per axis of the arm that carries the hand; none without one.
    Axes,
    /// One per moving link with collision shapes, then the palm.
    Links,
    /// One per tactile sensor.
    Sensors,
    /// One per entry of an action.
    Action,
}

impl Size {
    /// The number for a hand and the meaning of its actions.
    pub fn of(&self, hand: &Hand, action: ActionSpec) -> usize {
        match self {
            Self::Fixed(size) => *size,
            Self::Actuators => hand.grasp_actuators().count(),
            Self::Preshape => usize::from(hand.grasp.coordinate.is_some()),
            Self::Axes => hand.carrier.as_ref().map_or(0, |arm| arm.axes.len()),
            Self::Links => hand.touch_links().len() + 1,
            Self::Sensors => hand.sensors.len(),
            Self::Action => action.size(hand),
        }
    }
}

/// Buffer of a reader; every number is clipped to the bounds of its row.
pub struct Entries<'a> {
    out: &'a mut Vec<f32>,
    low: f32,
    high: f32,
}

impl Row {
    /// The column of the row for a hand and the meaning of its actions.
    pub fn column(&self, hand: &Hand, action: ActionSpec) -> Column {
        let [low, high] = (self.bounds)(hand);
        Column {
            name: self.name.into(),
            size: self.size.of(hand, action),
            low,
            high,
            unit: (self.unit)(hand),
            meaning: self.meaning.to_owned(),
            privileged: self.privileged,
        }
    }

    /// Appends the numbers of this row.
    ///
    /// * `column`: from [`Row::column`].
    ///
    /// # Errors
    /// [`EnvError::WrongSize`] if the reader's number of entries differs from the row.
    pub fn read(&self, column: &Column, view: &View<'_>, out: &mut Vec<f32>) -> Result<(), EnvError> {
        read_column(column, view, out, self.read)
    }
}

/// A row of an observation: from one of the tables, or a group of joints.
pub enum Reading {
    /// A row of a table.
    Row(&'static Row),
    /// Positions of a group of joints, by its index in the hand.
    Joints(usize),
}

/// Margin of an observation beyond the joint limits, rad and m: stops are soft.
const BEYOND_LIMITS: [f64; 2] = [0.5, 0.02];

impl Reading {
    /// The column of the row for a hand and the meaning of its actions.
    pub fn column(&self, hand: &Hand, action: ActionSpec) -> Column {
        let group = match self {
            Self::Row(row) => return row.column(hand, action),
            Self::Joints(group) => &hand.groups[*group],
        };
        let joints = || group.joints.iter().map(|joint| &hand.joints[*joint]);
        let kind = joints().next().map_or(JointKind::Revolute, |joint| joint.kind);
        let beyond = BEYOND_LIMITS[usize::from(kind == JointKind::Prismatic)];
        let names: Vec<&str> = joints().map(|joint| joint.name.as_str()).collect();
        Column {
            name: group.name.clone().into(),
            size: group.joints.len(),
            low: joints().map(|joint| joint.limits[0]).fold(f64::INFINITY, f64::min) - beyond,
            high: joints().map(|joint| joint.limits[1]).fold(f64::NEG_INFINITY, f64::max) + beyond,
            unit: kind.unit(),
            meaning: format!("position of {}", names.join(", ")),
            privileged: !group.encoder,
        }
    }

    /// Appends the numbers of the row; see [`Row::read`].
    ///
    /// # Errors
    /// As [`Row::read`].
    pub fn read(&self, column: &Column, view: &View<'_>, out: &mut Vec<f32>) -> Result<(), EnvError> {
        match self {
            Self::Row(row) => row.read(column, view, out),
            Self::Joints(group) => read_column(column, view, out, |view, out| {
                let world = view.world();
                out.put(world.hand().groups[*group].joints.iter().map(|joint| world.joint(*joint).position));
            }),
        }
    }
}

fn read_column(
    column: &Column,
    view: &View<'_>,
    out: &mut Vec<f32>,
    read: impl Fn(&View<'_>, &mut Entries<'_>),
) -> Result<(), EnvError> {
    let (begin, expected) = (out.len(), column.size);
    read(view, &mut Entries { out, low: column.low as f32, high: column.high as f32 });
    match out.len() - begin {
        found if found == expected => Ok(()),
        found => Err(EnvError::WrongSize { column: column.name.to_string(), found, expected }),
    }
}

impl Entries<'_> {
    /// Appends numbers; NaN becomes the least value.
    pub fn put(&mut self, values: impl IntoIterator<Item = f64>) {
        let (low, high) = (self.low, self.high);
        // `max` returns the bound for NaN.
        self.out.extend(values.into_iter().map(|value| (value as f32).max(low).min(high)));
    }
}
