//! The info of a step: one row per entry, with its type, meaning and reader. A new entry is a new row of [`INFO`].

use crate::actions::control::Control;
use crate::observations::view::View;
use crate::pool::env_spec::EnvSpec;
use crate::state::mode::DISTURBED;
use crate::state::{ClearState, TargetScene};
use graspbox_episode::FailureKind;
use serde::Serialize;

/// Type and reader of an entry.
pub enum Reader {
    Flag(fn(&View<'_>) -> bool),
    Number(fn(&View<'_>) -> f64),
    Index(fn(&View<'_>) -> i64),
    /// An index into names.
    Name(Names, fn(&View<'_>) -> i64),
}

/// Lists of names that an entry refers to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Names {
    /// [`failure_names`].
    Failures,
    Objects,
}

/// The control modes that have an entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Modes {
    /// Every mode.
    All,
    /// Every mode, in environments without goals.
    Grasps,
    /// Those whose steps are decisions.
    Decisions,
    /// [`Control::Clear`].
    Clear,
    /// The others, if the episodes are about one target among several objects.
    Target,
    /// Every mode, if an arm carries the hand.
    Arm,
}

/// An entry of the info.
pub struct InfoRow {
    pub name: &'static str,
    /// Unit; empty without one.
    pub unit: &'static str,
    pub meaning: &'static str,
    /// The control modes that have it.
    pub modes: Modes,
    pub read: Reader,
}

impl InfoRow {
    /// True if the entry belongs to the infos of environments.
    pub fn is_in(&self, spec: &EnvSpec) -> bool {
        let config = &spec.config;
        match self.modes {
            Modes::Grasps => config.goal.is_none(),
            Modes::Target => config.has_target(),
            Modes::Arm => spec.arm.is_some(),
            _ => self.is_of(config.control, false),
        }
    }

    /// True if the entry belongs to the infos of a control mode, whatever the layout.
    fn is_of(&self, control: Control, with_arm: bool) -> bool {
        match self.modes {
            Modes::All | Modes::Grasps => true,
            Modes::Decisions => control.decides(),
            Modes::Clear => control == Control::Clear,
            Modes::Target => false,
            Modes::Arm => with_arm,
        }
    }
}

/// Every entry, in order.
pub const INFO: &[InfoRow] = &[
    InfoRow {
        name: "is_success",
        unit: "",
        meaning: "the grasp succeeded",
        modes: Modes::All,
        read: Reader::Flag(|view| view.record.success),
    },
    InfoRow {
        name: "is_secure",
        unit: "",
        meaning: "it succeeded without shifting or turning in the hand",
        modes: Modes::Grasps,
        read: Reader::Flag(|view| {
            view.record.success && view.last_attempt().map_or(view.verdict.secure, |last| last.secure)
        }),
    },
    InfoRow {
        name: "failure",
        unit: "",
        meaning: "kind of the failure if the episode ended now; empty for a success, and before the first step",
        modes: Modes::Grasps,
        read: Reader::Name(Names::Failures, |view| failure(view).map_or(0, failure_code)),
    },
    InfoRow {
        name: "lift",
        unit: "m",
        meaning: "rise of the object's centre of mass above its resting height",
        modes: Modes::All,
        read: Reader::Number(|view| {
            let lift = view.last_attempt().map_or(view.verdict.lift, |last| last.lift);
            if lift.is_finite() { lift } else { 0.0 }
        }),
    },
    InfoRow {
        name: "object",
        unit: "",
        meaning: "name of the object",
        modes: Modes::All,
        read: Reader::Name(Names::Objects, |view| view.record.object as i64),
    },
    InfoRow {
        name: "resting",
        unit: "",
        meaning: "index of the object's resting pose; -1 if it was dropped at a given pose, or lies among others",
        modes: Modes::All,
        read: Reader::Index(|view| view.mode.resting().map_or(-1, |resting| resting as i64)),
    },
    InfoRow {
        name: "fits",
        unit: "",
        meaning: "the object's least width in plan view, as the episode begins, is within the width that the hand states; True for a hand that states none",
        modes: Modes::All,
        read: Reader::Flag(|view| view.record.fits),
    },
    InfoRow {
        name: "touches",
        unit: "",
        meaning: "the hand touches the object",
        modes: Modes::All,
        read: Reader::Flag(|view| view.last_attempt().map_or(view.touches(), |last| last.touches)),
    },
    InfoRow {
        name: "protective_stop",
        unit: "",
        meaning: "the protective stop held the hand at some time in the last step",
        modes: Modes::All,
        read: Reader::Flag(|view| view.mode.stopped()),
    },
    InfoRow {
        name: "arm_blocked",
        unit: "",
        meaning: "the arm stopped before itself, its hand, the table or a wall, or an object pressed on its links, at some time in the last step; after a decision: it found no path",
        modes: Modes::Arm,
        read: Reader::Flag(|view| view.arm.blocked()),
    },
    InfoRow {
        name: "infeasible",
        unit: "",
        meaning: "the hand could not reach its pose",
        modes: Modes::Decisions,
        read: Reader::Flag(|view| view.mode.result().failure == Some(FailureKind::Infeasible)),
    },
    InfoRow {
        name: "survives_shake",
        unit: "",
        meaning: "the object was still in the hand after the shake; False without `trial=TrialConfig(shake=...)`",
        modes: Modes::Decisions,
        read: Reader::Flag(|view| view.mode.result().survives_shake),
    },
    InfoRow {
        name: "attempts",
        unit: "",
        meaning: "attempts since the episode began",
        modes: Modes::Clear,
        read: Reader::Index(|view| count(view, |clearing| clearing.attempts)),
    },
    InfoRow {
        name: "cleared",
        unit: "",
        meaning: "objects taken away so far",
        modes: Modes::Clear,
        read: Reader::Index(|view| count(view, |clearing| clearing.cleared)),
    },
    InfoRow {
        name: "lost",
        unit: "",
        meaning: "objects that left the workspace otherwise",
        modes: Modes::Clear,
        read: Reader::Index(|view| count(view, |clearing| clearing.lost)),
    },
    InfoRow {
        name: "remaining",
        unit: "",
        meaning: "objects that are still there",
        modes: Modes::Clear,
        read: Reader::Index(|view| count(view, ClearState::remaining)),
    },
    InfoRow {
        name: "disturbed",
        unit: "",
        meaning: "objects still there that the last attempt moved by more than 1 cm",
        modes: Modes::Clear,
        read: Reader::Index(|view| count(view, |clearing| clearing.last.disturbed)),
    },
    InfoRow {
        name: "neighbours",
        unit: "",
        meaning: "other objects in the scene",
        modes: Modes::Target,
        read: Reader::Index(|view| view.mode.target_scene().map_or(0, TargetScene::neighbours) as i64),
    },
    InfoRow {
        name: "neighbours_moved",
        unit: "",
        meaning: "of these, those that are more than 1 cm from where they lay as the episode began",
        modes: Modes::Target,
        read: Reader::Index(neighbours_moved),
    },
];

/// Number of objects other than the target that moved by more than [`DISTURBED`] since the episode began.
fn neighbours_moved(view: &View<'_>) -> i64 {
    let (world, scene) = (view.world(), view.episode.scene());
    let moved = |object: &usize| {
        let first = scene.world_from(*object) * scene.center_of(*object);
        *object != scene.target() && (world.center_of(*object) - first).norm() > DISTURBED
    };
    let targets = view.mode.target_scene().is_some();
    if targets { (0..world.object_count()).filter(moved).count() as i64 } else { 0 }
}

/// A count of a scene that is cleared; 0 for other episodes.
fn count(view: &View<'_>, of: fn(&ClearState) -> u32) -> i64 {
    view.mode.clearing().map_or(0, |clearing| i64::from(of(clearing)))
}

/// The kind of failure if the episode ended now; `None` for a success, and before the first step.
fn failure(view: &View<'_>) -> Option<FailureKind> {
    let decided = view.mode.result().failure;
    if view.record.steps == 0 || view.record.success || decided.is_some() {
        decided
    } else if view.world().has_diverged() {
        Some(FailureKind::Unstable)
    } else if !view.record.touched {
        Some(FailureKind::NoContact)
    } else {
        Some(view.judge().failure(view.world(), view.touches()))
    }
}

/// Names of the failure codes: empty for a success, then those of [`FailureKind::ALL`].
pub fn failure_names() -> Vec<&'static str> {
    std::iter::once("").chain(FailureKind::ALL.map(FailureKind::name)).collect()
}

/// Index into [`failure_names`].
fn failure_code(kind: FailureKind) -> i64 {
    FailureKind::ALL.iter().position(|other| *other == kind).map_or(0, |index| index as i64 + 1)
}

/// A value of an entry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum InfoValue {
    Flag(bool),
    Number(f64),
    /// An integer, or an index into names.
    Index(i64),
}

impl Default for InfoValue {
    fn default() -> Self {
        Self::Flag(false)
    }
}

/// The values of all entries, in the order of [`INFO`].
pub type Info = [InfoValue; INFO.len()];

/// Reads every entry.
pub fn read_info(view: &View<'_>) -> Info {
    std::array::from_fn(|i| match INFO[i].read {
        Reader::Flag(read) => InfoValue::Flag(read(view)),
        Reader::Number(read) => InfoValue::Number(read(view)),
        Reader::Index(read) | Reader::Name(_, read) => InfoValue::Index(read(view)),
    })
}

/// An entry of many environments.
#[derive(Clone, Debug, PartialEq)]
pub enum InfoArray {
    Flags(Vec<bool>),
    Numbers(Vec<f64>),
    /// Integers, or indices into names.
    Indices(Vec<i64>),
}

impl InfoArray {
    /// An empty array for a row of [`INFO`], with capacity for `rows` values.
    pub fn with_capacity(row: &InfoRow, rows: usize) -> Self {
        match row.read {
            Reader::Flag(_) => Self::Flags(Vec::with_capacity(rows)),
            Reader::Number(_) => Self::Numbers(Vec::with_capacity(rows)),
            Reader::Index(_) | Reader::Name(..) => Self::Indices(Vec::with_capacity(rows)),
        }
    }

    /// Adds a value of the same type; others are ignored.
    pub fn push(&mut self, value: InfoValue) {
        match (self, value) {
            (Self::Flags(values), InfoValue::Flag(value)) => values.push(value),
            (Self::Numbers(values), InfoValue::Number(value)) => values.push(value),
            (Self::Indices(values), InfoValue::Index(value)) => values.push(value),
            _ => {}
        }
    }

    /// Adds the values of another array of the same type; others are ignored.
    pub fn append(&mut self, other: &mut Self) {
        match (self, other) {
            (Self::Flags(values), Self::Flags(more)) => values.append(more),
            (Self::Numbers(values), Self::Numbers(more)) => values.append(more),
            (Self::Indices(values), Self::Indices(more)) => values.append(more),
            _ => {}
        }
    }
}

#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct InfoTableRow {
    pub name: &'static str,
    /// `bool`, `float64`, `int64`, or `str`, whose arrays contain indices into names.
    pub dtype: &'static str,
    /// Its names; `None` for other types.
    pub names: Option<Names>,
    /// Unit; empty without one.
    pub unit: &'static str,
    pub meaning: &'static str,
}

/// The entries of a kind of control, in order.
///
/// * `with_arm`: an arm carries the hand.
pub fn info_table(control: Control, with_arm: bool) -> Vec<InfoTableRow> {
    table(INFO.iter().filter(|row| row.is_of(control, with_arm)))
}

/// The further entries of episodes about one target among several objects, in order.
pub fn target_info_table() -> Vec<InfoTableRow> {
    table(INFO.iter().filter(|row| row.modes == Modes::Target))
}

/// The entries of environments with goals, in order.
pub fn goal_info_table(with_arm: bool) -> Vec<InfoTableRow> {
    let of = |row: &&InfoRow| row.modes == Modes::All || (with_arm && row.modes == Modes::Arm);
    let mut rows = table(INFO.iter().filter(of));
    let success = rows.iter_mut().filter(|row| row.name == "is_success");
    success.for_each(|row| row.meaning = "the achieved goal is within the threshold of the desired one");
    rows
}

fn table(rows: impl Iterator<Item = &'static InfoRow>) -> Vec<InfoTableRow> {
    rows.map(|row| {
        let (dtype, names) = match row.read {
            Reader::Flag(_) => ("bool", None),
            Reader::Number(_) => ("float64", None),
            Reader::Index(_) => ("int64", None),
            Reader::Name(names, _) => ("str", Some(names)),
        };
        InfoTableRow { name: row.name, dtype, names, unit: row.unit, meaning: row.meaning }
    })
    .collect()
}
