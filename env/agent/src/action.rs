//! What the numbers of an action mean. All are in [-1, 1]; values beyond are clipped.

use crate::arm_controller::{ANGULAR_SPEED, Goal, LINEAR_SPEED};
use crate::column::Column;
use crate::control::{CONTROL_PERIOD, ClosedLoop, Control};
use crate::workspace::{DECISION_HIGH, DECISION_LOW, WORKSPACE_HIGH, WORKSPACE_LOW};
use graspbox_hand::{Hand, Motor, MotorCommand, MotorKind};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};

/// The preshape follows its target while no spool has turned further than this, radians: a hand is shaped before it closes. Fingers
/// swivelled about an object that they hold, by however little, release it.
pub const PRESHAPE_SPOOL: f64 = 0.5;

/// A direction shorter than this, or two with a smaller sine between them, define no rotation.
const DEGENERATE: f64 = 1e-3;

impl Control {
    /// Entries of an action that move the hand; the motors' follow.
    pub fn hand_size(self) -> usize {
        match self {
            Self::Twist | Self::DeltaPose => 6,
            Self::TargetPose | Self::GraspPose => 9,
        }
    }

    /// Entries of an action.
    pub fn size(self, hand: &Hand) -> usize {
        let motors = if self.decides() { 1 } else { hand.motors.len() };
        self.hand_size() + motors
    }

    /// The columns of an action; `low` and `high` are what -1 and 1 mean.
    pub fn table(self, hand: &Hand) -> Vec<Column> {
        let mut columns = match self {
            Self::Twist => twist_table(),
            Self::DeltaPose => delta_table(),
            Self::TargetPose => pose_table(
                WORKSPACE_LOW,
                WORKSPACE_HIGH,
                "first two columns of world_from_hand, any length; degenerate ones hold the last one",
            ),
            Self::GraspPose => pose_table(
                DECISION_LOW,
                DECISION_HIGH,
                "first two columns of world_from_hand, any length; degenerate ones name no pose",
            ),
        };
        if self.decides() {
            columns.push(Column::new("preshape", 1, hand.preshape_limits, "rad", "preshape"));
        } else {
            columns.extend(hand.motors.iter().map(|motor| motor_column(motor, hand)));
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

fn motor_column(motor: &Motor, hand: &Hand) -> Column {
    match motor.kind {
        MotorKind::Finger(_) => {
            let speed = [-motor.max_speed, motor.max_speed];
            Column::new("spool", 1, speed, "rad/s", "speed of a finger's spool; positive closes")
        }
        MotorKind::Preshape => {
            let meaning = format!("target of the preshape, followed while no spool is beyond {PRESHAPE_SPOOL} rad");
            Column::new("preshape", 1, hand.preshape_limits, "rad", meaning)
        }
    }
}

/// An entry of an action, clipped.
fn entry(values: &[f32], i: usize) -> f64 {
    f64::from(values[i]).clamp(-1.0, 1.0)
}

fn three(values: &[f32], i: usize) -> Vector3<f64> {
    Vector3::new(entry(values, i), entry(values, i + 1), entry(values, i + 2))
}

impl ClosedLoop {
    /// The goal that an action names.
    ///
    /// * `values`: finite numbers; the first [`Control::hand_size`] count.
    /// * `last`: the last reference, whose rotation is held if the action names none.
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

/// The hand's pose and the preshape (rad) that a decision names; none if its columns define no rotation.
///
/// * `values`: an action of [`Control::GraspPose`], finite.
pub fn pose_and_preshape(values: &[f32], hand: &Hand) -> Option<(Isometry3<f64>, f64)> {
    let position = between(&three(values, 0), DECISION_LOW, DECISION_HIGH);
    let rotation = rotation(&three(values, 3), &three(values, 6))?;
    let pose = Isometry3::from_parts(Translation3::from(position), rotation);
    let [low, high] = hand.preshape_limits;
    Some((pose, low + (entry(values, 9) + 1.0) / 2.0 * (high - low)))
}

/// The rotation whose first column points along `first`, and whose second lies in the plane of both; none if they define none.
fn rotation(first: &Vector3<f64>, second: &Vector3<f64>) -> Option<UnitQuaternion<f64>> {
    let x = first.try_normalize(DEGENERATE)?;
    let y = (second - x * x.dot(second)).try_normalize(DEGENERATE * second.norm().max(1.0))?;
    let matrix = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, x.cross(&y)]));
    Some(UnitQuaternion::from_rotation_matrix(&matrix))
}

/// Commands to the motors, from the entries that follow those of the hand.
///
/// * `preshape`: target of the preshape, radians; replaced by the action's while `open`.
pub fn motor_commands(hand: &Hand, values: &[f32], open: bool, preshape: &mut f64) -> Vec<MotorCommand> {
    let [low, high] = hand.preshape_limits;
    let command = |(motor, value): (&Motor, &f32)| {
        let value = f64::from(*value).clamp(-1.0, 1.0);
        match motor.kind {
            MotorKind::Finger(_) => MotorCommand::Velocity(value * motor.max_speed),
            MotorKind::Preshape => {
                if open {
                    *preshape = low + (value + 1.0) / 2.0 * (high - low);
                }
                MotorCommand::Position { target: *preshape, speed: None }
            }
        }
    };
    hand.motors.iter().zip(values).map(command).collect()
}
