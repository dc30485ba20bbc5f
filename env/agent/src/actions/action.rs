//! The meaning of an action's entries. All are in [-1, 1]; other values are clipped.

use crate::actions::arm_controller::{ANGULAR_SPEED, Goal, LINEAR_SPEED};
use crate::actions::control::{CONTROL_PERIOD, ClosedLoop, Control};
use crate::actions::workspace::{DECISION_HIGH, DECISION_LOW, WORKSPACE_HIGH, WORKSPACE_LOW};
use crate::observations::column::Column;
use graspbox_hand::{Actuator, ActuatorCommand, Hand, JointKind};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// The preshape follows its target while no other actuator has closed by more than this share of its travel: the hand is shaped before it closes.
/// Any change of the preshape under load would release the object.
pub const OPEN_SHARE: f64 = 5.0 / 36.0;

/// Least length of a direction, and least sine between two, that define a rotation.
const DEGENERATE: f64 = 1e-3;

impl Control {
    /// Number of entries that move the hand; those of the actuators follow.
    pub fn hand_size(self) -> usize {
        match self {
            Self::Twist | Self::DeltaPose => 6,
            Self::TargetPose | Self::GraspPose | Self::Clear => 9,
        }
    }

    /// Number of entries of an action.
    pub fn size(self, hand: &Hand) -> usize {
        let actuators = if self.decides() { usize::from(hand.has_preshapes()) } else { hand.actuators.len() };
        self.hand_size() + actuators
    }

    /// The columns of an action; `low` and `high` are the values of -1 and 1.
    pub fn table(self, hand: &Hand) -> Vec<Column> {
        let mut columns = match self {
            Self::Twist => twist_table(),
            Self::DeltaPose => delta_table(),
            Self::TargetPose => pose_table(
                WORKSPACE_LOW,
                WORKSPACE_HIGH,
                "first two columns of world_from_hand, any length; degenerate ones hold the last one",
            ),
            Self::GraspPose | Self::Clear => pose_table(
                DECISION_LOW,
                DECISION_HIGH,
                "first two columns of world_from_hand, any length; degenerate ones name no pose",
            ),
        };
        if !self.decides() {
            columns.extend((0..hand.actuators.len()).map(|actuator| actuator_column(actuator, hand)));
        } else if hand.has_preshapes() {
            let meaning = match hand.grasp.coordinate {
                Some(_) => "preshape".to_owned(),
                None => format!("number of the preshape, rounded: {}", preshape_names(hand)),
            };
            columns.push(Column::new("preshape", 1, hand.preshape_limits(), hand.preshape_unit(), meaning));
        }
        columns
    }
}

fn twist_table() -> Vec<Column> {
    let (linear, angular) = ([-LINEAR_SPEED, LINEAR_SPEED], [-ANGULAR_SPEED, ANGULAR_SPEED]);
    let cut = "in the hand's axes; its length is cut to the upper limit";
    vec![
        Column::new("linear", 3, linear, "m/s", format!("velocity {cut}")),
        Column::new("angular", 3, angular, "rad/s", format!("angular velocity {cut}")),
    ]
}

fn delta_table() -> Vec<Column> {
    let (step, turn) = (LINEAR_SPEED * CONTROL_PERIOD, ANGULAR_SPEED * CONTROL_PERIOD);
    vec![
        Column::new("step", 3, [-step, step], "m", "change of position in the hand's axes"),
        Column::new("turn", 3, [-turn, turn], "rad", "rotation vector in the hand's axes"),
    ]
}

fn pose_table(low: [f64; 3], high: [f64; 3], rotation: &str) -> Vec<Column> {
    let axis = |name, i: usize| Column::new(name, 1, [low[i], high[i]], "m", "hand position, world");
    vec![axis("x", 0), axis("y", 1), axis("z", 2), Column::new("rotation", 6, [-1.0, 1.0], "1", rotation)]
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
    pub fn goal(self, values: &[f32], last: &Isometry3<f64>) -> Goal {
        match self {
            Self::Twist => Goal::Twist(three(values, 0) * LINEAR_SPEED, three(values, 3) * ANGULAR_SPEED),
            Self::DeltaPose => Goal::Delta(Isometry3::from_parts(
                Translation3::from(three(values, 0) * (LINEAR_SPEED * CONTROL_PERIOD)),
                UnitQuaternion::from_scaled_axis(three(values, 3) * (ANGULAR_SPEED * CONTROL_PERIOD)),
            )),
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
/// * `values`: an action of [`Control::GraspPose`] or [`Control::Clear`], finite.
pub fn pose_and_preshape(values: &[f32], hand: &Hand) -> Option<(Isometry3<f64>, f64)> {
    let position = between(&three(values, 0), DECISION_LOW, DECISION_HIGH);
    let rotation = rotation(&three(values, 3), &three(values, 6))?;
    let pose = Isometry3::from_parts(Translation3::from(position), rotation);
    let preshape = if hand.has_preshapes() { preshape_at(entry(values, 9), hand) } else { hand.preshape_limits()[0] };
    Some((pose, preshape))
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
pub fn actuator_commands(hand: &Hand, values: &[f32], open: bool, preshape: &mut f64) -> Vec<ActuatorCommand> {
    let command = |((index, actuator), value): ((usize, &Actuator), &f32)| {
        let value = f64::from(*value).clamp(-1.0, 1.0);
        if !is_preshape(index, hand) {
            return ActuatorCommand::Velocity(value * actuator.max_speed);
        }
        if open {
            *preshape = preshape_at(value, hand);
        }
        ActuatorCommand::Position { target: *preshape, speed: None }
    };
    hand.actuators.iter().enumerate().zip(values).map(command).collect()
}
