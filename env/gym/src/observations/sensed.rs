//! Rows of quantities that a real arm and hand sense. A new column is a new row.

use crate::observations::observation_row::{Row, Size};
use crate::observations::view::{position, rotation_columns};
use graspbox_hand::{Actuator, CarrierAxis, Hand, JointKind};

/// Greatest force in a tactile observation, N: a fingertip at full tension presses with 5 to 14 N.
pub const TACTILE_LIMIT: f64 = 20.0;

/// Proprioception of the arm.
pub const ARM: &[Row] = &[
    Row {
        name: "hand_position",
        size: Size::Fixed(3),
        bounds: |_| [-1.0, 1.0],
        unit: |_| "m",
        meaning: "grasp frame as the arm knows it, world",
        privileged: false,
        read: |view, out| out.put(position(view.arm.estimated_pose())),
    },
    Row {
        name: "hand_rotation",
        size: Size::Fixed(6),
        bounds: |_| [-1.0, 1.0],
        unit: |_| "1",
        meaning: "first two columns of world_from_hand",
        privileged: false,
        read: |view, out| out.put(rotation_columns(&view.arm.estimated_pose().rotation)),
    },
    Row {
        name: "hand_velocity",
        size: Size::Fixed(3),
        bounds: |_| [-1.0, 1.0],
        unit: |_| "m/s",
        meaning: "of the grasp frame, hand axes",
        privileged: false,
        read: |view, out| out.put(view.arm.velocity().0.iter().copied()),
    },
    Row {
        name: "hand_spin",
        size: Size::Fixed(3),
        bounds: |_| [-4.0, 4.0],
        unit: |_| "rad/s",
        meaning: "angular velocity, hand axes",
        privileged: false,
        read: |view, out| out.put(view.arm.velocity().1.iter().copied()),
    },
];

/// Encoders of the arm.
pub const AXES: &[Row] = &[
    Row {
        name: "arm_q",
        size: Size::Axes,
        bounds: |hand| axes(hand, |axis| axis.limits),
        unit: |hand| axis_unit(hand, ["rad", "m", "rad or m"]),
        meaning: "position of each joint of the arm, from the base on",
        privileged: false,
        read: |view, out| out.put(view.arm.joints().0.iter().take(view.world().arm_axes()).copied()),
    },
    Row {
        name: "arm_dq",
        size: Size::Axes,
        bounds: |hand| axes(hand, |axis| [-axis.speed, axis.speed]),
        unit: |hand| axis_unit(hand, ["rad/s", "m/s", "rad/s or m/s"]),
        meaning: "its speed",
        privileged: false,
        read: |view, out| out.put(view.arm.joints().1.iter().take(view.world().arm_axes()).copied()),
    },
];

fn axes(hand: &Hand, of: impl Fn(&CarrierAxis) -> [f64; 2]) -> [f64; 2] {
    hand.carrier.as_ref().map_or([0.0, 0.0], |arm| arm.range(of))
}

fn axis_unit(hand: &Hand, words: [&'static str; 3]) -> &'static str {
    hand.carrier.as_ref().map_or(words[0], |arm| arm.unit(words))
}

/// Encoders and load sensors of the actuators.
pub const ACTUATORS: &[Row] = &[
    Row {
        name: "actuator",
        size: Size::Actuators,
        bounds: travel,
        unit: |hand| unit(hand, ["rad", "m", "rad or m"]),
        meaning: "position of each actuator but the preshape's",
        privileged: false,
        read: |view, out| {
            let world = view.world();
            out.put(world.hand().grasp_actuators().map(|index| world.actuators()[index].position));
        },
    },
    Row {
        name: "actuator_speed",
        size: Size::Actuators,
        bounds: speed,
        unit: |hand| unit(hand, ["rad/s", "m/s", "rad/s or m/s"]),
        meaning: "its speed",
        privileged: false,
        read: |view, out| {
            let world = view.world();
            out.put(world.hand().grasp_actuators().map(|index| world.actuators()[index].velocity));
        },
    },
    Row {
        name: "load",
        size: Size::Actuators,
        bounds: |hand| [0.0, each(hand).map(|actuator| actuator.load_limit).fold(0.0, f64::max)],
        unit: load_unit,
        meaning: "its load: the tension of its tendon, or the force on its joints",
        privileged: false,
        read: |view, out| {
            let world = view.world();
            out.put(world.hand().grasp_actuators().map(|index| world.load(index)));
        },
    },
    Row {
        name: "preshape",
        size: Size::Preshape,
        bounds: |hand| hand.preshape_limits(),
        unit: |hand| hand.preshape_unit(),
        meaning: "position of the preshape's actuator",
        privileged: false,
        read: |view, out| {
            let coordinate = view.world().hand().grasp.coordinate;
            out.put(coordinate.map(|_| view.world().preshape()));
        },
    },
];

/// Forces on the tactile sensors.
pub const TACTILE: &[Row] = &[Row {
    name: "tactile",
    size: Size::Sensors,
    bounds: |_| [0.0, TACTILE_LIMIT],
    unit: |_| "N",
    meaning: "force on each sensor",
    privileged: false,
    read: |view, out| out.put(view.world().tactile().force),
}];

/// The actuators except the preshape's.
fn each(hand: &Hand) -> impl Iterator<Item = &Actuator> {
    hand.grasp_actuators().map(|index| &hand.actuators[index])
}

fn travel(hand: &Hand) -> [f64; 2] {
    let least = each(hand).map(|actuator| actuator.travel[0]).fold(0.0, f64::min);
    [least, each(hand).map(|actuator| actuator.travel[1]).fold(0.0, f64::max)]
}

fn speed(hand: &Hand) -> [f64; 2] {
    let speed = each(hand).map(|actuator| actuator.max_speed).fold(0.0, f64::max);
    [-speed, speed]
}

/// The unit of all revolute, of all prismatic, or of mixed actuators.
fn unit(hand: &Hand, [revolute, prismatic, mixed]: [&'static str; 3]) -> &'static str {
    let slides = each(hand).filter(|actuator| hand.motion_kind(actuator) == JointKind::Prismatic).count();
    match slides {
        0 => revolute,
        n if n == each(hand).count() => prismatic,
        _ => mixed,
    }
}

fn load_unit(hand: &Hand) -> &'static str {
    let mut units = each(hand).map(|actuator| hand.load_unit(actuator));
    match units.next() {
        Some(first) if units.all(|other| other == first) => first,
        Some(_) => "N or N m",
        None => "N",
    }
}
