//! The tables of observations: one place for names, sizes, bounds and units. Spaces and documentation are made from it.

use crate::action::Control;
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

/// Some neighbouring numbers of a vector.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Field {
    /// Name.
    pub name: &'static str,
    /// How many numbers.
    pub size: usize,
    /// Least value; smaller ones are clipped.
    pub low: f64,
    /// Greatest value; larger ones are clipped.
    pub high: f64,
    /// Unit.
    pub unit: &'static str,
    /// What it means.
    pub meaning: &'static str,
}

/// Greatest force that a tactile sensor shows, N: a fingertip at full tension presses with 5 to 14 N.
pub const TACTILE_LIMIT: f64 = 20.0;

fn field(name: &'static str, size: usize, [low, high]: [f64; 2], unit: &'static str, meaning: &'static str) -> Field {
    Field { name, size, low, high, unit, meaning }
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

    /// True where no sensor of a real robot gives it.
    pub fn privileged(self) -> bool {
        self == Self::State
    }

    /// Its rows, in order.
    ///
    /// * `control`: the state holds the last action; before a decision it tells of the object alone.
    pub fn table(self, hand: &Hand, control: Control) -> Vec<Field> {
        match self {
            Self::State if control.decides() => resting(),
            Self::Proprio => proprio(hand),
            Self::Tactile => {
                vec![field("tactile", hand.sensors.len(), [0.0, TACTILE_LIMIT], "N", "force on each sensor")]
            }
            Self::State => {
                let mut rows = proprio(hand);
                rows.extend(privileged(hand));
                rows.push(field(
                    "last_action",
                    control.size(hand),
                    [-1.0, 1.0],
                    "1",
                    "the last action; zeros after a reset",
                ));
                rows
            }
        }
    }
}

/// The object as it lies before a decision.
fn resting() -> Vec<Field> {
    vec![
        field("object_position", 3, [-1.0, 1.0], "m", "origin of the object's frame, world"),
        field("object_rotation", 6, [-1.0, 1.0], "1", "first two columns of world_from_object"),
        field("center_of_mass", 3, [-1.0, 1.0], "m", "of the object, world"),
        field("bounds_center", 3, [-1.0, 1.0], "m", "middle of the bounds along the object's axes, world"),
        field("half_extents", 3, [0.0, 1.0], "m", "half sides of these bounds"),
        field("mass", 1, [0.0, 10.0], "kg", "of the object"),
    ]
}

fn proprio(hand: &Hand) -> Vec<Field> {
    let n = hand.fingers.len();
    let motors = || hand.fingers.iter().map(|f| &hand.motors[f.motor]);
    let travel = [motors().map(|m| m.travel[0]).fold(0.0, f64::min), motors().map(|m| m.travel[1]).fold(0.0, f64::max)];
    let speed = motors().map(|m| m.max_speed).fold(0.0, f64::max);
    let tension = hand.fingers.iter().map(|f| f.tendon.max_tension).fold(0.0, f64::max);
    vec![
        field("hand_position", 3, [-1.0, 1.0], "m", "grasp frame as the arm knows it, world"),
        field("hand_rotation", 6, [-1.0, 1.0], "1", "first two columns of world_from_hand"),
        field("hand_velocity", 3, [-1.0, 1.0], "m/s", "of the grasp frame, hand axes"),
        field("hand_spin", 3, [-4.0, 4.0], "rad/s", "angular velocity, hand axes"),
        field("proximal", n, [-0.5, 3.2], "rad", "proximal encoder of each finger"),
        field("spool", n, travel, "rad", "spool encoder of each finger"),
        field("spool_speed", n, [-speed, speed], "rad/s", "speed of each finger's spool"),
        field("load", n, [0.0, tension], "N", "load of each finger's motor: the tension of its tendon"),
        field("preshape", 1, hand.preshape_limits, "rad", "preshape angle"),
    ]
}

fn privileged(hand: &Hand) -> Vec<Field> {
    let n = hand.fingers.len();
    let pi = std::f64::consts::PI;
    vec![
        field("distal", n, [-0.5, 3.2], "rad", "distal angle of each finger"),
        field("object_position", 3, [-1.0, 1.0], "m", "origin of the object's frame, world"),
        field("object_rotation", 6, [-1.0, 1.0], "1", "first two columns of world_from_object"),
        field("object_in_hand_position", 3, [-1.5, 1.5], "m", "origin of the object's frame, true hand frame"),
        field("object_in_hand_rotation", 6, [-1.0, 1.0], "1", "first two columns of hand_from_object"),
        field("object_velocity", 3, [-5.0, 5.0], "m/s", "of its centre of mass relative to the hand, hand axes"),
        field("object_spin", 3, [-50.0, 50.0], "rad/s", "relative to the hand, hand axes"),
        field("center_of_mass", 3, [-1.5, 1.5], "m", "of the object, hand frame"),
        field("bounds_center", 3, [-1.5, 1.5], "m", "middle of the bounds along the object's axes, hand frame"),
        field("half_extents", 3, [0.0, 1.0], "m", "half sides of these bounds"),
        field("mass", 1, [0.0, 10.0], "kg", "of the object"),
        field(
            "contact",
            2 * n + 1,
            [0.0, 1.0],
            "1",
            "1 where the object touches: proximal and distal link of each finger, palm",
        ),
        field("on_table", 1, [0.0, 1.0], "1", "1 while the object touches table or ground"),
        field("lift", 1, [-1.0, 1.0], "m", "rise of the centre of mass above its resting height"),
        field("held", 1, [0.0, 1.0], "1", "share of the hold time for which the object has been held"),
        field("shift", 1, [0.0, 1.0], "m", "shift in the hand since the object left the table"),
        field("turn", 1, [0.0, pi], "rad", "turn in the hand since the object left the table"),
        field("closure", 1, [0.0, 1.0], "1", "epsilon quality of the present contacts"),
    ]
}

/// Fills a vector row by row, clipped to the rows' bounds.
pub(crate) struct Sheet<'a> {
    fields: std::slice::Iter<'a, Field>,
    out: &'a mut Vec<f32>,
}

impl<'a> Sheet<'a> {
    pub fn new(fields: &'a [Field], out: &'a mut Vec<f32>) -> Self {
        Self { fields: fields.iter(), out }
    }

    /// The next row: exactly its size in numbers, whatever comes. What is not a number becomes the least value.
    pub fn put(&mut self, values: impl IntoIterator<Item = f64>) {
        let Some(field) = self.fields.next() else { return };
        let (low, high) = (field.low as f32, field.high as f32);
        let end = self.out.len() + field.size;
        // `max` takes the bound where the value is not a number.
        let clipped = values.into_iter().take(field.size).map(|v| (v as f32).max(low).min(high));
        self.out.extend(clipped);
        debug_assert_eq!(self.out.len(), end, "{} has another size", field.name);
        self.out.resize(end, low);
    }

    /// The next row, a single number.
    pub fn one(&mut self, value: f64) {
        self.put([value]);
    }
}
