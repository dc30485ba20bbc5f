//! The meaning of an action's entries. All are in [-1, 1]; other values are clipped.

use crate::actions::arm_controller::{ANGULAR_SPEED, Goal, LINEAR_SPEED};
use crate::actions::control::{ActionSpec, ClosedLoop, Control, Fingers};
use crate::actions::workspace::{
    DECISION_HIGH, DECISION_LOW, POINT_HIGH, POINT_LOW, POINT_TILT, WORKSPACE_HIGH, WORKSPACE_LOW,
};
use crate::observations::column::Column;
use graspbox_arm::chain::MAX_AXES;
use graspbox_hand::{Actuator, ActuatorCommand, CarrierAxis, Hand, JointKind};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use std::f64::consts::PI;

/// The preshape follows its target while no other actuator has closed by more than this share of its travel: the hand is shaped before it closes.
/// Any change of the preshape under load would release the object.
pub const OPEN_SHARE: f64 = 5.0 / 36.0;

/// Least length of a direction, and least sine between two, that define a rotation.
const DEGENERATE: f64 = 1e-3;

impl Control {
    /// Number of entries that move the hand; those of the actuators follow.
    pub fn hand_size(self, hand: &Hand) -> usize {
        match self {
            Self::JointVelocity => hand.carrier.as_ref().map_or(0, |arm| arm.axes.len()),
            Self::Twist | Self::DeltaPose | Self::GraspPoint => 6,
            Self::TopDown => 4,
            Self::TargetPose | Self::GraspPose | Self::Clear => 9,
        }
    }

    /// The columns of these entries.
    fn hand_table(self, hand: &Hand) -> Vec<Column> {
        match self {
            Self::JointVelocity => hand.carrier.iter().flat_map(|arm| arm.axes.iter().map(joint_column)).collect(),
            Self::Twist => motion_table("linear", "angular", "in the hand's axes"),
            Self::DeltaPose => motion_table("step", "turn", "at which the goal moves, in the hand's axes"),
            Self::TopDown => top_down_table(),
            Self::TargetPose => pose_table(
                WORKSPACE_LOW,
                WORKSPACE_HIGH,
                "first two columns of world_from_hand, any length; degenerate ones hold the last one",
            ),
            Self::GraspPoint => point_table(),
            Self::GraspPose | Self::Clear => pose_table(
                DECISION_LOW,
                DECISION_HIGH,
                "first two columns of world_from_hand, any length; degenerate ones name no pose",
            ),
        }
    }
}

impl ActionSpec {
    /// Number of entries of an action.
    pub fn size(self, hand: &Hand) -> usize {
        let fingers = match self.fingers {
            _ if self.control.decides() => usize::from(hand.has_preshapes()),
            Fingers::Synergy => 1 + usize::from(hand.grasp.coordinate.is_some()),
            Fingers::Each => hand.actuators.len(),
        };
        self.control.hand_size(hand) + fingers
    }

    /// The columns of an action; `low` and `high` are the values of -1 and 1.
    pub fn table(self, hand: &Hand) -> Vec<Column> {
        let mut columns = self.control.hand_table(hand);
        match self.fingers {
            _ if self.control.decides() => columns.extend(preshape_choice(hand)),
            Fingers::Synergy => {
                let meaning = "speed along the closing motion of a trial, as a share; positive closes, negative opens";
                columns.push(Column::new("close", 1, [-1.0, 1.0], "1", meaning));
                columns.extend(hand.grasp.coordinate.map(|coordinate| actuator_column(coordinate.actuator, hand)));
            }
            Fingers::Each => columns.extend((0..hand.actuators.len()).map(|actuator| actuator_column(actuator, hand))),
        }
        columns
    }
}

/// The preshape of a decision, for a hand with several.
fn preshape_choice(hand: &Hand) -> Option<Column> {
    let meaning = match hand.grasp.coordinate {
        Some(_) => "preshape".to_owned(),
        None => format!("number of the preshape, rounded: {}", preshape_names(hand)),
    };
    let column = Column::new("preshape", 1, hand.preshape_limits(), hand.preshape_unit(), meaning);
    hand.has_preshapes().then_some(column)
}

fn motion_table(linear: &'static str, angular: &'static str, which: &str) -> Vec<Column> {
    let cut = format!("{which}; its length is cut to the upper limit");
    vec![
        Column::new(linear, 3, [-LINEAR_SPEED, LINEAR_SPEED], "m/s", format!("velocity {cut}")),
        Column::new(angular, 3, [-ANGULAR_SPEED, ANGULAR_SPEED], "rad/s", format!("angular velocity {cut}")),
    ]
}

fn joint_column(axis: &CarrierAxis) -> Column {
    let unit = if axis.kind == JointKind::Prismatic { "m/s" } else { "rad/s" };
    Column::new("joint", 1, [-axis.speed, axis.speed], unit, format!("speed of `{}`", axis.name))
}

fn top_down_table() -> Vec<Column> {
    let cut = "velocity in the world's axes; its length is cut to the upper limit";
    vec![
        Column::new("linear", 3, [-LINEAR_SPEED, LINEAR_SPEED], "m/s", cut),
        Column::new("yaw", 1, [-ANGULAR_SPEED, ANGULAR_SPEED], "rad/s", "angular velocity about the vertical"),
    ]
}

fn pose_table(low: [f64; 3], high: [f64; 3], rotation: &str) -> Vec<Column> {
    let axis = |name, i: usize| Column::new(name, 1, [low[i], high[i]], "m", "hand position, world");
    vec![axis("x", 0), axis("y", 1), axis("z", 2), Column::new("rotation", 6, [-1.0, 1.0], "1", rotation)]
}

fn point_table() -> Vec<Column> {
    let axis =
        |name, i: usize| Column::new(name, 1, [POINT_LOW[i], POINT_HIGH[i]], "m", "grasp centre of the hand, world");
    let tilt = "rotation vector along the world's x and y, after the yaw; its length is cut to the upper limit";
    let yaw = "about the vertical, from a hand that faces down with its x along the world's";
    vec![
        axis("center_x", 0),
        axis("center_y", 1),
        axis("center_z", 2),
        Column::new("tilt", 2, [-POINT_TILT, POINT_TILT], "rad", tilt),
        Column::new("yaw", 1, [-PI, PI], "rad", yaw),
    ]
}

/// The named preshapes with their numbers.
fn preshape_names(hand: &Hand) -> String {
    let names: Vec<String> = hand.preshapes().iter().map(|named| format!("{} {}", named.value, named.name)).collect();
    names.join(", ")
}

fn actuator_column(index: usize, hand: &Hand) -> Column {
    let actuator = &hand.actuators[index];
    if is_preshape(index, hand) {
        let percent = 100.0 * OPEN_SHARE;
        let meaning = format!(
            "target of the preshape, followed while no other actuator has closed by more than {percent:.0} % of its travel"
        );
        return Column::new("preshape", 1, hand.preshape_limits(), hand.preshape_unit(), meaning);
    }
    let unit = if hand.motion_kind(actuator) == JointKind::Prismatic { "m/s" } else { "rad/s" };
    let speed = [-actuator.max_speed, actuator.max_speed];
    Column::new("actuator", 1, speed, unit, format!("speed of actuator `{}`; positive closes", actuator.name))
}

/// True for the actuator whose position is the preshape coordinate.
fn is_preshape(actuator: usize, hand: &Hand) -> bool {
    hand.grasp.coordinate.is_some_and(|coordinate| coordinate.actuator == actuator)
}

/// The preshape at a share of its range, from -1 to 1; the nearest one if preshapes are named.
fn preshape_at(share: f64, hand: &Hand) -> f64 {
    let [low, high] = hand.preshape_limits();
    let preshape = low + (share + 1.0) / 2.0 * (high - low);
    if hand.grasp.coordinate.is_some() { preshape } else { preshape.round() }
}

/// An entry of an action, clipped.
fn entry(values: &[f32], i: usize) -> f64 {
    f64::from(values[i]).clamp(-1.0, 1.0)
}

fn three(values: &[f32], i: usize) -> Vector3<f64> {
    Vector3::new(entry(values, i), entry(values, i + 1), entry(values, i + 2))
}

impl ClosedLoop {
    /// The goal of an action.
    ///
    /// * `values`: finite numbers, of which the first [`Control::hand_size`] are used.
    /// * `last`: the last reference, whose rotation is kept if the action defines none.
    /// * `period`: of control, seconds.
    pub fn goal(self, values: &[f32], last: &Isometry3<f64>, period: f64) -> Goal {
        match self {
            Self::Twist => Goal::Twist(three(values, 0) * LINEAR_SPEED, three(values, 3) * ANGULAR_SPEED),
            Self::DeltaPose => Goal::Delta(Isometry3::from_parts(
                Translation3::from(three(values, 0) * (LINEAR_SPEED * period)),
                UnitQuaternion::from_scaled_axis(three(values, 3) * (ANGULAR_SPEED * period)),
            )),
            Self::TopDown => {
                let yaw = Vector3::z() * (entry(values, 3) * ANGULAR_SPEED);
                Goal::WorldTwist(three(values, 0) * LINEAR_SPEED, yaw)
            }
            Self::JointVelocity => {
                let mut shares = [0.0; MAX_AXES];
                let entries = values.len().min(MAX_AXES);
                (0..entries).for_each(|axis| shares[axis] = entry(values, axis));
                Goal::Joints(shares)
            }
            Self::TargetPose => {
                let position = between(&three(values, 0), WORKSPACE_LOW, WORKSPACE_HIGH);
                let rotation = rotation(&three(values, 3), &three(values, 6)).unwrap_or(last.rotation);
                Goal::Pose(Isometry3::from_parts(Translation3::from(position), rotation))
            }
        }
    }
}

/// The point at shares of a box, each in [-1, 1].
fn between(shares: &Vector3<f64>, low: [f64; 3], high: [f64; 3]) -> Vector3<f64> {
    let (low, high) = (Vector3::from(low), Vector3::from(high));
    low + (shares.add_scalar(1.0) / 2.0).component_mul(&(high - low))
}

/// Pose and preshape of a decision; `None` if its columns define no rotation.
///
/// * `values`: a finite action of `control`, one whose steps are decisions.
pub fn pose_and_preshape(control: Control, values: &[f32], hand: &Hand) -> Option<(Isometry3<f64>, f64)> {
    let pose = match control {
        Control::GraspPoint => pose_about_point(values, hand),
        _ => {
            let position = between(&three(values, 0), DECISION_LOW, DECISION_HIGH);
            Isometry3::from_parts(Translation3::from(position), rotation(&three(values, 3), &three(values, 6))?)
        }
    };
    let preshape = match hand.has_preshapes() {
        true => preshape_at(entry(values, control.hand_size(hand)), hand),
        false => hand.preshape_limits()[0],
    };
    Some((pose, preshape))
}

/// The pose of a hand whose grasp centre is at a point.
fn pose_about_point(values: &[f32], hand: &Hand) -> Isometry3<f64> {
    let tilt = Vector3::new(entry(values, 3), entry(values, 4), 0.0);
    let rotation = UnitQuaternion::from_scaled_axis(tilt / tilt.norm().max(1.0) * POINT_TILT)
        * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), entry(values, 5) * PI)
        * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
    let center = between(&three(values, 0), POINT_LOW, POINT_HIGH);
    Isometry3::from_parts(Translation3::from(center - rotation * hand.grasp.center.coords), rotation)
}

/// The rotation whose first column is along `first` and whose second is in the plane of both; `None` if they define none.
fn rotation(first: &Vector3<f64>, second: &Vector3<f64>) -> Option<UnitQuaternion<f64>> {
    let x = first.try_normalize(DEGENERATE)?;
    let y = (second - x * x.dot(second)).try_normalize(DEGENERATE * second.norm().max(1.0))?;
    let matrix = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, x.cross(&y)]));
    Some(UnitQuaternion::from_rotation_matrix(&matrix))
}

/// Commands to the actuators from the entries after those of the hand.
///
/// * `preshape`: target of the preshape coordinate, rad or m; updated from the action while `open`.
pub fn actuator_commands(
    hand: &Hand,
    fingers: Fingers,
    values: &[f32],
    open: bool,
    preshape: &mut f64,
) -> Vec<ActuatorCommand> {
    let coordinate = hand.grasp.coordinate.map(|coordinate| match fingers {
        Fingers::Synergy => 1,
        Fingers::Each => coordinate.actuator,
    });
    if let Some(entry_of_preshape) = coordinate.filter(|_| open) {
        *preshape = preshape_at(entry(values, entry_of_preshape), hand);
    }
    match fingers {
        Fingers::Synergy => closing_commands(hand, entry(values, 0), *preshape),
        Fingers::Each => {
            let command = |(index, actuator): (usize, &Actuator)| match is_preshape(index, hand) {
                true => ActuatorCommand::Position { target: *preshape, speed: None },
                false => ActuatorCommand::Velocity(entry(values, index) * actuator.max_speed),
            };
            hand.actuators.iter().enumerate().map(command).collect()
        }
    }
}

/// Commands that move a hand along the closing motion of a trial: its closing actuators at their default speeds, between the open hand and the end
/// of their travel; the others stay where the preshape puts them.
///
/// * `share`: of these speeds, in [-1, 1]; positive closes.
fn closing_commands(hand: &Hand, share: f64, preshape: f64) -> Vec<ActuatorCommand> {
    let command = |(index, target): (usize, f64)| {
        let speed = share * hand.actuators[index].default_speed;
        match hand.grasp.closing.contains(&index) {
            false => ActuatorCommand::Position { target, speed: None },
            true if share < 0.0 => ActuatorCommand::Position { target, speed: Some(-speed) },
            true => ActuatorCommand::Velocity(speed),
        }
    };
    hand.open_positions(preshape).into_iter().enumerate().map(command).collect()
}
