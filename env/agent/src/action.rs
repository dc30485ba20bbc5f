//! What the numbers of an action mean. All are in [-1, 1]; values beyond are clipped.

use crate::arm_controller::{ANGULAR_SPEED, Goal, LINEAR_SPEED};
use crate::config::CONTROL_PERIOD;
use crate::guard::{WORKSPACE_HIGH, WORKSPACE_LOW};
use crate::observation_spec::Field;
use graspbox_hand::{Hand, Motor, MotorCommand, MotorKind};
use nalgebra::{Isometry3, Matrix3, Rotation3, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};

/// How an action moves the hand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Control {
    /// A velocity in the hand's axes.
    #[default]
    Twist,
    /// A step in the hand's axes, added up by the arm.
    DeltaPose,
    /// A pose in the world.
    TargetPose,
    /// One decision an episode: a pose in the world and a preshape, which a trial then tries.
    GraspPose,
}

/// Corners of the box of hand positions that a decision chooses from, world frame, metres: a hand's reach around objects near the
/// middle of the table.
pub const DECISION_LOW: [f64; 3] = [-0.25, -0.25, 0.0];
/// See [`DECISION_LOW`].
pub const DECISION_HIGH: [f64; 3] = [0.25, 0.25, 0.40];

/// The preshape follows its target while no spool has turned further than this, radians: a hand is shaped before it closes. Fingers
/// swivelled about what they hold, by however little, let go of it.
pub const PRESHAPE_SPOOL: f64 = 0.5;

/// A direction shorter than this, or two with a smaller sine between them, name no rotation.
const DEGENERATE: f64 = 1e-3;

impl Control {
    /// Every mode of closed-loop control.
    pub const CLOSED_LOOP: [Self; 3] = [Self::Twist, Self::DeltaPose, Self::TargetPose];

    /// True where an episode is one decision.
    pub fn decides(self) -> bool {
        self == Self::GraspPose
    }

    /// Its name in configs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Twist => "twist",
            Self::DeltaPose => "delta_pose",
            Self::TargetPose => "target_pose",
            Self::GraspPose => "grasp_pose",
        }
    }

    /// Numbers of an action that move the hand; the motors' follow.
    pub fn hand_size(self) -> usize {
        match self {
            Self::Twist | Self::DeltaPose => 6,
            Self::TargetPose | Self::GraspPose => 9,
        }
    }

    /// Numbers of an action.
    pub fn size(self, hand: &Hand) -> usize {
        let motors = if self.decides() { 1 } else { hand.motors.len() };
        self.hand_size() + motors
    }

    /// What -1 and 1 stand for, row by row.
    pub fn table(self, hand: &Hand) -> Vec<Field> {
        let step = LINEAR_SPEED * CONTROL_PERIOD;
        let turn = ANGULAR_SPEED * CONTROL_PERIOD;
        let field = |name: &'static str, size, low, high, unit, meaning| Field { name, size, low, high, unit, meaning };
        let mut rows = match self {
            Self::Twist => vec![
                field(
                    "linear",
                    3,
                    -LINEAR_SPEED,
                    LINEAR_SPEED,
                    "m/s",
                    "velocity in the hand's axes; its length is cut to the upper limit",
                ),
                field(
                    "angular",
                    3,
                    -ANGULAR_SPEED,
                    ANGULAR_SPEED,
                    "rad/s",
                    "angular velocity in the hand's axes; its length is cut to the upper limit",
                ),
            ],
            Self::DeltaPose => vec![
                field("step", 3, -step, step, "m", "change of position in the hand's axes"),
                field("turn", 3, -turn, turn, "rad", "rotation vector in the hand's axes"),
            ],
            Self::TargetPose => pose_table(
                WORKSPACE_LOW,
                WORKSPACE_HIGH,
                "first two columns of world_from_hand, any length; degenerate ones hold the last one",
            ),
            Self::GraspPose => {
                let mut rows = pose_table(
                    DECISION_LOW,
                    DECISION_HIGH,
                    "first two columns of world_from_hand, any length; degenerate ones name no pose",
                );
                let [low, high] = hand.preshape_limits;
                rows.push(field("preshape", 1, low, high, "rad", "preshape"));
                return rows;
            }
        };
        for motor in &hand.motors {
            rows.push(match motor.kind {
                MotorKind::Finger(_) => field(
                    "spool",
                    1,
                    -motor.max_speed,
                    motor.max_speed,
                    "rad/s",
                    "speed of a finger's spool; positive closes",
                ),
                MotorKind::Preshape => field(
                    "preshape",
                    1,
                    hand.preshape_limits[0],
                    hand.preshape_limits[1],
                    "rad",
                    "target of the preshape, followed while no spool is beyond 0.5 rad",
                ),
            });
        }
        rows
    }

    /// The goal that an action names.
    ///
    /// * `values`: finite numbers; the first [`Control::hand_size`] count.
    /// * `last`: the last reference, whose rotation is held where the action names none.
    pub fn goal(self, values: &[f32], last: &Isometry3<f64>) -> Goal {
        let at = |i: usize| f64::from(values[i]).clamp(-1.0, 1.0);
        let three = |i: usize| Vector3::new(at(i), at(i + 1), at(i + 2));
        match self {
            Self::Twist => Goal::Twist(three(0) * LINEAR_SPEED, three(3) * ANGULAR_SPEED),
            Self::DeltaPose => Goal::Delta(Isometry3::from_parts(
                Translation3::from(three(0) * (LINEAR_SPEED * CONTROL_PERIOD)),
                UnitQuaternion::from_scaled_axis(three(3) * (ANGULAR_SPEED * CONTROL_PERIOD)),
            )),
            Self::TargetPose | Self::GraspPose => {
                let [low, high] =
                    if self.decides() { [DECISION_LOW, DECISION_HIGH] } else { [WORKSPACE_LOW, WORKSPACE_HIGH] };
                let place = between(&three(0), low, high);
                let rotation = rotation(&three(3), &three(6)).unwrap_or(last.rotation);
                Goal::Pose(Isometry3::from_parts(Translation3::from(place), rotation))
            }
        }
    }
}

fn pose_table(low: [f64; 3], high: [f64; 3], rotation: &'static str) -> Vec<Field> {
    let row = |name, size, low, high, unit, meaning| Field { name, size, low, high, unit, meaning };
    vec![
        row("x", 1, low[0], high[0], "m", "hand position, world"),
        row("y", 1, low[1], high[1], "m", "hand position, world"),
        row("z", 1, low[2], high[2], "m", "hand position, world"),
        row("rotation", 6, -1.0, 1.0, "1", rotation),
    ]
}

/// The point at shares of a box, each in [-1, 1].
fn between(shares: &Vector3<f64>, low: [f64; 3], high: [f64; 3]) -> Vector3<f64> {
    let (low, high) = (Vector3::from(low), Vector3::from(high));
    low + (shares.add_scalar(1.0) / 2.0).component_mul(&(high - low))
}

/// The hand's pose and the preshape (rad) that a decision names; none where its columns name no rotation.
///
/// * `values`: [`Control::GraspPose`]'s numbers, finite.
pub fn pose_and_preshape(values: &[f32], hand: &Hand) -> Option<(Isometry3<f64>, f64)> {
    let at = |i: usize| f64::from(values[i]).clamp(-1.0, 1.0);
    let three = |i: usize| Vector3::new(at(i), at(i + 1), at(i + 2));
    let place = between(&three(0), DECISION_LOW, DECISION_HIGH);
    let pose = Isometry3::from_parts(Translation3::from(place), rotation(&three(3), &three(6))?);
    let [low, high] = hand.preshape_limits;
    Some((pose, low + (at(9) + 1.0) / 2.0 * (high - low)))
}

/// The rotation whose first two columns point along `first` and (as far as it can) `second`; none where they name none.
fn rotation(first: &Vector3<f64>, second: &Vector3<f64>) -> Option<UnitQuaternion<f64>> {
    let x = first.try_normalize(DEGENERATE)?;
    let y = (second - x * x.dot(second)).try_normalize(DEGENERATE * second.norm().max(1.0))?;
    let matrix = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[x, y, x.cross(&y)]));
    Some(UnitQuaternion::from_rotation_matrix(&matrix))
}

/// Commands to the motors from the numbers that follow those of the hand.
///
/// * `preshape`: the target that holds, radians; replaced by the action's while `open`.
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
