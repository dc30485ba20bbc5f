//! Rows of quantities that only the simulation knows. A new column is a new row.

use crate::observations::observation_row::{Entries, Row, Size};
use crate::observations::view::{View, position, rotation_columns};
use crate::state::Goal;
use crate::state::goal::GOAL_BOUND;
use std::f64::consts::PI;

const OBJECT_POSITION: Row = Row {
    name: "object_position",
    size: Size::Fixed(3),
    bounds: |_| [-1.0, 1.0],
    unit: |_| "m",
    meaning: "origin of the object's frame, world",
    privileged: true,
    read: |view, out| out.put(position(&view.world().world_from_object())),
};

const OBJECT_ROTATION: Row = Row {
    name: "object_rotation",
    size: Size::Fixed(6),
    bounds: |_| [-1.0, 1.0],
    unit: |_| "1",
    meaning: "first two columns of world_from_object",
    privileged: true,
    read: |view, out| out.put(rotation_columns(&view.world().world_from_object().rotation)),
};

const HALF_EXTENTS: Row = Row {
    name: "half_extents",
    size: Size::Fixed(3),
    bounds: |_| [0.0, 1.0],
    unit: |_| "m",
    meaning: "half sides of these bounds",
    privileged: true,
    read: |view, out| out.put(view.prepared.half_extents().iter().copied()),
};

const MASS: Row = Row {
    name: "mass",
    size: Size::Fixed(1),
    bounds: |_| [0.0, 10.0],
    unit: |_| "kg",
    meaning: "of the object",
    privileged: true,
    read: |view, out| out.put([view.world().object_mass()]),
};

/// The object at rest before a decision.
pub const RESTING: &[Row] = &[
    OBJECT_POSITION,
    OBJECT_ROTATION,
    Row {
        name: "center_of_mass",
        size: Size::Fixed(3),
        bounds: |_| [-1.0, 1.0],
        unit: |_| "m",
        meaning: "of the object, world",
        privileged: true,
        read: |view, out| out.put(view.center_of_mass(&view.world().world_from_object())),
    },
    Row {
        name: "bounds_center",
        size: Size::Fixed(3),
        bounds: |_| [-1.0, 1.0],
        unit: |_| "m",
        meaning: "middle of the bounds along the object's axes, world",
        privileged: true,
        read: |view, out| out.put(view.bounds_center(&view.world().world_from_object())),
    },
    HALF_EXTENTS,
    MASS,
];

/// Hand and object in closed-loop control.
pub const SIMULATED: &[Row] = &[
    OBJECT_POSITION,
    OBJECT_ROTATION,
    Row {
        name: "object_in_hand_position",
        size: Size::Fixed(3),
        bounds: |_| [-1.5, 1.5],
        unit: |_| "m",
        meaning: "origin of the object's frame, true hand frame",
        privileged: true,
        read: |view, out| out.put(position(&view.world().hand_from_object())),
    },
    Row {
        name: "object_in_hand_rotation",
        size: Size::Fixed(6),
        bounds: |_| [-1.0, 1.0],
        unit: |_| "1",
        meaning: "first two columns of hand_from_object",
        privileged: true,
        read: |view, out| out.put(rotation_columns(&view.world().hand_from_object().rotation)),
    },
    Row {
        name: "object_velocity",
        size: Size::Fixed(3),
        bounds: |_| [-5.0, 5.0],
        unit: |_| "m/s",
        meaning: "of its centre of mass relative to the hand, hand axes",
        privileged: true,
        read: |view, out| out.put(view.world().object_velocity_in_hand().0.iter().copied()),
    },
    Row {
        name: "object_spin",
        size: Size::Fixed(3),
        bounds: |_| [-50.0, 50.0],
        unit: |_| "rad/s",
        meaning: "relative to the hand, hand axes",
        privileged: true,
        read: |view, out| out.put(view.world().object_velocity_in_hand().1.iter().copied()),
    },
    Row {
        name: "center_of_mass",
        size: Size::Fixed(3),
        bounds: |_| [-1.5, 1.5],
        unit: |_| "m",
        meaning: "of the object, hand frame",
        privileged: true,
        read: |view, out| out.put(view.center_of_mass(&view.world().hand_from_object())),
    },
    Row {
        name: "bounds_center",
        size: Size::Fixed(3),
        bounds: |_| [-1.5, 1.5],
        unit: |_| "m",
        meaning: "middle of the bounds along the object's axes, hand frame",
        privileged: true,
        read: |view, out| out.put(view.bounds_center(&view.world().hand_from_object())),
    },
    HALF_EXTENTS,
    MASS,
    Row {
        name: "contact",
        size: Size::Links,
        bounds: |_| [0.0, 1.0],
        unit: |_| "1",
        meaning: "1 where the object touches: each moving link with collision shapes, chain by chain from the root to the tip, then the palm",
        privileged: true,
        read: |view, out| {
            // The flag of the base is the last.
            let places = view.flags.first().map_or(0, |palm| palm + 1);
            let touches = |place| view.touching.iter().any(|link| view.flags[*link] == place);
            out.put((0..places).map(|place| if touches(place) { 1.0 } else { 0.0 }));
        },
    },
    Row {
        name: "on_table",
        size: Size::Fixed(1),
        bounds: |_| [0.0, 1.0],
        unit: |_| "1",
        meaning: "1 while the object touches table or ground",
        privileged: true,
        read: |view, out| out.put([if view.judge().on_scenery() { 1.0 } else { 0.0 }]),
    },
    Row {
        name: "lift",
        size: Size::Fixed(1),
        bounds: |_| [-1.0, 1.0],
        unit: |_| "m",
        meaning: "rise of the centre of mass above its resting height",
        privileged: true,
        read: |view, out| out.put([view.verdict.lift]),
    },
    Row {
        name: "held",
        size: Size::Fixed(1),
        bounds: |_| [0.0, 1.0],
        unit: |_| "1",
        meaning: "share of the hold time for which the object has been held",
        privileged: true,
        read: |view, out| out.put([view.judge().held_share(view.world())]),
    },
    Row {
        name: "shift",
        size: Size::Fixed(1),
        bounds: |_| [0.0, 1.0],
        unit: |_| "m",
        meaning: "shift in the hand since the object left the table",
        privileged: true,
        read: |view, out| out.put([view.verdict.shift]),
    },
    Row {
        name: "turn",
        size: Size::Fixed(1),
        bounds: |_| [0.0, PI],
        unit: |_| "rad",
        meaning: "turn in the hand since the object left the table",
        privileged: true,
        read: |view, out| out.put([view.verdict.turn]),
    },
    Row {
        name: "closure",
        size: Size::Fixed(1),
        bounds: |_| [0.0, 1.0],
        unit: |_| "1",
        meaning: "epsilon quality of the present contacts",
        privileged: true,
        read: |view, out| out.put([view.record.potentials.closure]),
    },
];

/// The last action.
pub const LAST_ACTION: &[Row] = &[Row {
    name: "last_action",
    size: Size::Action,
    bounds: |_| [-1.0, 1.0],
    unit: |_| "1",
    meaning: "the last action; zeros after a reset",
    privileged: false,
    read: |view, out| out.put(view.record.last_action.iter().map(|entry| f64::from(*entry))),
}];

/// The position that is to reach the goal. An environment without goals has none.
pub const ACHIEVED_GOAL: &[Row] = &[Row {
    privileged: true,
    ..goal_row(
        "achieved_goal",
        "grasp centre of the hand in `Reach-v0`, the object's centre of mass in `Place-v0`, world",
        |view, out| out.put(numbers(view, |goal| goal.achieved(view.world()))),
    )
}];

/// The goal.
pub const DESIRED_GOAL: &[Row] =
    &[goal_row("desired_goal", "the goal, world", |view, out| out.put(numbers(view, |goal| goal.desired)))];

const fn goal_row(name: &'static str, meaning: &'static str, read: fn(&View<'_>, &mut Entries<'_>)) -> Row {
    Row {
        name,
        size: Size::Fixed(3),
        bounds: |_| [-GOAL_BOUND, GOAL_BOUND],
        unit: |_| "m",
        meaning,
        privileged: false,
        read,
    }
}

fn numbers(view: &View<'_>, of: impl Fn(&Goal) -> [f32; 3]) -> impl Iterator<Item = f64> {
    view.record.goal.as_ref().map(of).into_iter().flatten().map(f64::from)
}
