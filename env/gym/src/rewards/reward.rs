//! Named reward terms; the caller weights them.
//!
//! Shaping terms are differences of bounded potentials: their sum over an episode depends only on its first and last state, so oscillation gains
//! nothing, and the optimal policy stays optimal (Ng, Harada, Russell, "Policy invariance under reward transformations", 1999; with a
//! discount of 1). In a decision, an episode of one step, a shaping term is the potential itself. A new term is a new row of [`TERMS`].

use crate::actions::arm_controller::{ANGULAR_SPEED, ArmController, LINEAR_SPEED};
use crate::actions::control::Control;
use crate::rewards::potentials::{PUSHED, Potentials, REACH};
use graspbox_sim::World;
use serde::Serialize;

/// A reward term in one kind of control: its range in a step, its meaning, its value.
pub struct Definition<T> {
    /// Least value.
    pub low: f64,
    /// Greatest value.
    pub high: f64,
    pub meaning: fn() -> String,
    pub value: fn(&T) -> f64,
}

/// A reward term.
pub struct Term {
    pub name: &'static str,
    /// In a step of closed-loop control.
    pub step: Definition<Transition>,
    /// In a decision; `None` if it is always 0 there.
    pub decision: Option<Definition<Attempt>>,
}

/// Inputs of the terms in a step of closed-loop control.
#[derive(Clone, Copy, Debug, Default)]
pub struct Transition {
    /// Length of the step, in units of 0.05 s.
    pub time: f64,
    /// Potentials before the step.
    pub before: Potentials,
    pub after: Potentials,
    /// The grasp succeeded.
    pub success: bool,
    /// The grasp succeeded, and is secure.
    pub secure: bool,
    /// The object is lost.
    pub lost: bool,
    /// The hand touched table or ground.
    pub table: bool,
    /// The protective stop held the hand.
    pub stop: bool,
    /// See [`effort`].
    pub effort: f64,
}

/// Inputs of the terms in a decision.
#[derive(Clone, Copy, Debug, Default)]
pub struct Attempt {
    /// Nearness before the hand closes; contact, closure and push after it has closed; lift, hold and slip at the end.
    pub potentials: Potentials,
    /// The grasp succeeded.
    pub success: bool,
    /// The grasp succeeded, and is secure.
    pub secure: bool,
    /// The hand could not reach its pose.
    pub infeasible: bool,
}

/// Every reward term, in order.
pub const TERMS: &[Term] = &[
    Term {
        name: "reach",
        step: change(
            || format!("change of 1 - d / {REACH} m, with d the distance from the grasp centre to the object's core"),
            |t| t.after.reach - t.before.reach,
        ),
        decision: share(
            || {
                let distance = "d the distance from the grasp centre to the object's core";
                format!("1 - d / {REACH} m, with {distance} before the hand closes")
            },
            |a| a.potentials.reach,
        ),
    },
    Term {
        name: "contact",
        step: change(
            || "change of the mean of the share of fingers that touch and how far two of them oppose".into(),
            |t| t.after.contact - t.before.contact,
        ),
        decision: share(
            || {
                "mean of the share of fingers that touch and how far two of them oppose, when the hand has closed"
                    .into()
            },
            |a| a.potentials.contact,
        ),
    },
    Term {
        name: "closure",
        step: change(
            || "change of the epsilon quality of the present contacts".into(),
            |t| t.after.closure - t.before.closure,
        ),
        decision: share(
            || "epsilon quality of the contacts, when the hand has closed".into(),
            |a| a.potentials.closure,
        ),
    },
    Term {
        name: "lift",
        step: change(
            || "change of the share of the lift height, while the hand holds the object off the table".into(),
            |t| t.after.lift - t.before.lift,
        ),
        decision: share(
            || "greatest rise of the centre of mass, as a share of the lift height".into(),
            |a| a.potentials.lift,
        ),
    },
    Term {
        name: "hold",
        step: change(|| "change of the share of the hold time".into(), |t| t.after.hold - t.before.hold),
        decision: share(|| "share of the hold time at the end".into(), |a| a.potentials.hold),
    },
    Term {
        name: "success",
        step: within([0.0, 1.0], || "1 at success".into(), |t| indicator(t.success)),
        decision: share(|| "1 at success".into(), |a| indicator(a.success)),
    },
    Term {
        name: "failure",
        step: cost(|| "-1 when the object is lost for good".into(), |t| -indicator(t.lost)),
        decision: Some(cost(|| "-1 if the attempt is infeasible".into(), |a| -indicator(a.infeasible))),
    },
    Term {
        name: "effort",
        step: cost(
            || {
                "minus the mean square of the speeds of hand and actuators as shares of their limits, each 0.05 s"
                    .into()
            },
            |t| -t.effort * t.time,
        ),
        decision: None,
    },
    Term {
        name: "push",
        step: change(
            || format!("minus the change of how far the object was moved sideways, up to {PUSHED} m, as a share"),
            |t| t.before.push - t.after.push,
        ),
        decision: Some(cost(
            || {
                format!(
                    "minus how far the object was moved sideways while the hand closed, up to {PUSHED} m, as a share"
                )
            },
            |a| -a.potentials.push,
        )),
    },
    Term {
        name: "table",
        step: cost(
            || "-1 for each 0.05 s in which the hand touches the table".into(),
            |t| -indicator(t.table) * t.time,
        ),
        decision: None,
    },
    Term {
        name: "stop",
        step: cost(
            || "-1 for each 0.05 s in which the protective stop holds the hand".into(),
            |t| -indicator(t.stop) * t.time,
        ),
        decision: None,
    },
    Term {
        name: "secure",
        step: within([0.0, 1.0], || "1 at a secure success".into(), |t| indicator(t.secure)),
        decision: share(|| "1 at a secure success".into(), |a| indicator(a.secure)),
    },
    Term {
        name: "slip",
        step: change(
            || {
                let allowed = "as a share of what a secure grasp allows";
                format!("minus the change of how far the object moved in the hand since it left the table, {allowed}")
            },
            |t| t.before.slip - t.after.slip,
        ),
        decision: Some(cost(
            || {
                "minus how far the object moved in the hand since it left the table, as a share of what a secure grasp \
                 allows"
                    .into()
            },
            |a| -a.potentials.slip,
        )),
    },
];

/// A term between two values.
const fn within<T>([low, high]: [f64; 2], meaning: fn() -> String, value: fn(&T) -> f64) -> Definition<T> {
    Definition { low, high, meaning, value }
}

/// The change of a potential.
const fn change(meaning: fn() -> String, value: fn(&Transition) -> f64) -> Definition<Transition> {
    within([-1.0, 1.0], meaning, value)
}

/// A share between 0 and 1, in a decision.
const fn share(meaning: fn() -> String, value: fn(&Attempt) -> f64) -> Option<Definition<Attempt>> {
    Some(within([0.0, 1.0], meaning, value))
}

/// A cost between -1 and 0.
const fn cost<T>(meaning: fn() -> String, value: fn(&T) -> f64) -> Definition<T> {
    within([-1.0, 0.0], meaning, value)
}

fn indicator(yes: bool) -> f64 {
    if yes { 1.0 } else { 0.0 }
}

pub const TERM_COUNT: usize = TERMS.len();

/// The values of all terms, in the order of [`TERMS`].
pub type TermValues = [f32; TERM_COUNT];

impl Transition {
    /// The terms of this step.
    pub fn terms(&self) -> TermValues {
        std::array::from_fn(|i| (TERMS[i].step.value)(self) as f32)
    }
}

impl Attempt {
    /// The terms of this decision.
    pub fn terms(&self) -> TermValues {
        std::array::from_fn(|i| TERMS[i].decision.as_ref().map_or(0.0, |term| (term.value)(self) as f32))
    }
}

/// A row of the table of reward terms.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TermRow {
    pub name: &'static str,
    /// Least value in a step.
    pub low: f64,
    /// Greatest value in a step.
    pub high: f64,
    pub meaning: String,
}

/// The terms of a control mode, without those that are always 0.
pub fn term_table(control: Control) -> Vec<TermRow> {
    fn row<T>(name: &'static str, term: &Definition<T>) -> TermRow {
        TermRow { name, low: term.low, high: term.high, meaning: (term.meaning)() }
    }
    let of = |term: &Term| match control.decides() {
        true => term.decision.as_ref().map(|decision| row(term.name, decision)),
        false => Some(row(term.name, &term.step)),
    };
    TERMS.iter().filter_map(of).collect()
}

/// Mean square of the speeds of hand and actuators, as shares of their limits, in [0, 1].
pub fn effort(arm: &ArmController, world: &World) -> f64 {
    let (linear, angular) = arm.velocity();
    let hand = world.hand();
    let share = |index: usize| world.actuators()[index].velocity / hand.actuators[index].max_speed;
    let closing = hand.grasp_actuators().map(share).map(|s| s * s).sum::<f64>();
    let fingers = closing / hand.grasp_actuators().count().max(1) as f64;
    let moves = (linear.norm() / LINEAR_SPEED).powi(2) + (angular.norm() / ANGULAR_SPEED).powi(2);
    ((moves + fingers) / 3.0).min(1.0)
}
