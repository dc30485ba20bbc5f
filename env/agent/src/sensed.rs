//! Rows of what a real arm and hand sense. A new column is a new row.

use crate::observation_row::{Row, Size};
use crate::view::{position, rotation_columns};
use graspbox_hand::{Hand, Motor};

/// Greatest force that a tactile sensor shows, N: a fingertip at full tension presses with 5 to 14 N.
pub const TACTILE_LIMIT: f64 = 20.0;

/// What the arm and the hand sense of themselves.
pub const PROPRIO: &[Row] = &[
    Row {
        name: "hand_position",
        size: Size::Fixed(3),
        bounds: |_| [-1.0, 1.0],
        unit: "m",
        meaning: "grasp frame as the arm knows it, world",
        privileged: false,
        read: |view, out| out.put(position(view.arm.believed())),
    },
    Row {
        name: "hand_rotation",
        size: Size::Fixed(6),
        bounds: |_| [-1.0, 1.0],
        unit: "1",
        meaning: "first two columns of world_from_hand",
        privileged: false,
        read: |view, out| out.put(rotation_columns(&view.arm.believed().rotation)),
    },
    Row {
        name: "hand_velocity",
        size: Size::Fixed(3),
        bounds: |_| [-1.0, 1.0],
        unit: "m/s",
        meaning: "of the grasp frame, hand axes",
        privileged: false,
        read: |view, out| out.put(view.arm.velocity().0.iter().copied()),
    },
    Row {
        name: "hand_spin",
        size: Size::Fixed(3),
        bounds: |_| [-4.0, 4.0],
        unit: "rad/s",
        meaning: "angular velocity, hand axes",
        privileged: false,
        read: |view, out| out.put(view.arm.velocity().1.iter().copied()),
    },
    Row {
        name: "proximal",
        size: Size::Fingers,
        bounds: |_| [-0.5, 3.2],
        unit: "rad",
        meaning: "proximal encoder of each finger",
        privileged: false,
        read: |view, out| out.put(view.fingers().map(|finger| finger.proximal)),
    },
    Row {
        name: "spool",
        size: Size::Fingers,
        bounds: spool_travel,
        unit: "rad",
        meaning: "spool encoder of each finger",
        privileged: false,
        read: |view, out| out.put(view.fingers().map(|finger| finger.spool)),
    },
    Row {
        name: "spool_speed",
        size: Size::Fingers,
        bounds: spool_speed,
        unit: "rad/s",
        meaning: "speed of each finger's spool",
        privileged: false,
        read: |view, out| {
            let world = view.world();
            out.put(world.hand().fingers.iter().map(|finger| world.motors()[finger.motor].velocity));
        },
    },
    Row {
        name: "load",
        size: Size::Fingers,
        bounds: |hand| [0.0, hand.fingers.iter().map(|f| f.tendon.max_tension).fold(0.0, f64::max)],
        unit: "N",
        meaning: "load of each finger's motor: the tension of its tendon",
        privileged: false,
        read: |view, out| out.put(view.fingers().map(|finger| finger.tension)),
    },
    Row {
        name: "preshape",
        size: Size::Fixed(1),
        bounds: |hand| hand.preshape_limits,
        unit: "rad",
        meaning: "preshape angle",
        privileged: false,
        read: |view, out| out.put([view.world().preshape()]),
    },
];

/// Forces on the tactile sensors.
pub const TACTILE: &[Row] = &[Row {
    name: "tactile",
    size: Size::Sensors,
    bounds: |_| [0.0, TACTILE_LIMIT],
    unit: "N",
    meaning: "force on each sensor",
    privileged: false,
    read: |view, out| out.put(view.world().tactile().force),
}];

fn spool_motors(hand: &Hand) -> impl Iterator<Item = &Motor> {
    hand.fingers.iter().map(|finger| &hand.motors[finger.motor])
}

fn spool_travel(hand: &Hand) -> [f64; 2] {
    let least = spool_motors(hand).map(|motor| motor.travel[0]).fold(0.0, f64::min);
    [least, spool_motors(hand).map(|motor| motor.travel[1]).fold(0.0, f64::max)]
}

fn spool_speed(hand: &Hand) -> [f64; 2] {
    let speed = spool_motors(hand).map(|motor| motor.max_speed).fold(0.0, f64::max);
    [-speed, speed]
}
