//! Control modes, what an action says about the fingers, and the timing of control.

use crate::EnvError;
use graspbox_hand::Hand;
use graspbox_mesh::in_range;
use serde::{Deserialize, Serialize};

/// Longest control period, seconds: slower control repeats an action in several periods. It is also the time for which costs are paid in full.
pub const CONTROL_PERIOD: f64 = 0.05;
/// Least and greatest control frequency, Hz.
const CONTROL_FREQS: std::ops::RangeInclusive<f64> = 5.0..=100.0;

/// Control modes: how an action moves the hand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Control {
    /// A velocity in the hand's axes.
    #[default]
    Twist,
    /// A displacement in the hand's axes, which the arm accumulates.
    DeltaPose,
    /// A pose in the world.
    TargetPose,
    /// A velocity in the world's axes, and one about the vertical: the palm keeps facing down.
    TopDown,
    /// A speed of every joint of the arm that carries the hand.
    JointVelocity,
    /// One decision per episode: a pose in the world and a preshape, followed by a trial.
    GraspPose,
    /// One decision per episode too: where the grasp centre goes, how the hand tilts and turns, and a preshape.
    GraspPoint,
    /// Decisions of [`Control::GraspPose`] until a scene of several objects is cleared.
    Clear,
}

/// What an action says about the fingers in closed-loop control.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Fingers {
    /// One number along the hand's closing motion, and the preshape coordinate if the hand has one.
    #[default]
    Synergy,
    /// One number per actuator.
    Each,
}

impl Fingers {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Synergy, Self::Each];

    /// Its name in configs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Synergy => "synergy",
            Self::Each => "each",
        }
    }
}

/// The meaning of an action: control mode and fingers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ActionSpec {
    pub control: Control,
    /// Without meaning where a step is a decision.
    pub fingers: Fingers,
}

/// The control modes with an action every control period.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ClosedLoop {
    /// [`Control::Twist`].
    Twist,
    /// [`Control::DeltaPose`].
    DeltaPose,
    /// [`Control::TargetPose`].
    TargetPose,
    /// [`Control::TopDown`].
    TopDown,
    /// [`Control::JointVelocity`].
    JointVelocity,
}

impl From<ClosedLoop> for Control {
    fn from(mode: ClosedLoop) -> Self {
        match mode {
            ClosedLoop::Twist => Self::Twist,
            ClosedLoop::DeltaPose => Self::DeltaPose,
            ClosedLoop::TargetPose => Self::TargetPose,
            ClosedLoop::TopDown => Self::TopDown,
            ClosedLoop::JointVelocity => Self::JointVelocity,
        }
    }
}

impl Control {
    /// Every mode of closed-loop control that moves any hand.
    pub const CLOSED_LOOP: [Self; 4] = [Self::Twist, Self::DeltaPose, Self::TargetPose, Self::TopDown];

    /// Every mode of closed-loop control of a hand: with an arm also that of its joints.
    pub fn closed_loops(hand: &Hand) -> impl Iterator<Item = Self> {
        Self::CLOSED_LOOP.into_iter().chain(hand.carrier.as_ref().map(|_| Self::JointVelocity))
    }

    /// The closed-loop mode; `None` if a step is a decision.
    pub fn closed_loop(self) -> Option<ClosedLoop> {
        match self {
            Self::Twist => Some(ClosedLoop::Twist),
            Self::DeltaPose => Some(ClosedLoop::DeltaPose),
            Self::TargetPose => Some(ClosedLoop::TargetPose),
            Self::TopDown => Some(ClosedLoop::TopDown),
            Self::JointVelocity => Some(ClosedLoop::JointVelocity),
            Self::GraspPose | Self::GraspPoint | Self::Clear => None,
        }
    }

    /// True if a step is a decision, followed by a trial.
    pub fn decides(self) -> bool {
        self.closed_loop().is_none()
    }

    /// Its name in configs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Twist => "twist",
            Self::DeltaPose => "delta_pose",
            Self::TargetPose => "target_pose",
            Self::TopDown => "top_down",
            Self::JointVelocity => "joint_velocity",
            Self::GraspPose => "grasp_pose",
            Self::GraspPoint => "grasp_point",
            Self::Clear => "clear",
        }
    }
}

/// Timing of a step of closed-loop control.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Timing {
    /// Control periods of a step, which share its action.
    pub periods: u32,
    /// Length of a control period, seconds.
    pub period: f64,
    /// Physics steps of a control period.
    pub substeps: u32,
}

impl Timing {
    /// That of a decision, which has no control periods.
    pub const DECISION: Self = Self { periods: 1, period: CONTROL_PERIOD, substeps: 0 };

    /// The timing at `control_freq` actions per second (Hz) and a physics time step of `dt` seconds.
    ///
    /// # Errors
    /// [`EnvError::OutOfRange`] for a frequency outside 5 to 100 Hz, [`EnvError::BadTimeStep`] for a time step that does not divide the period.
    pub fn new(control_freq: f64, dt: f64) -> Result<Self, EnvError> {
        let periods = Self::periods(control_freq)?;
        let period = 1.0 / (control_freq * f64::from(periods));
        let steps = (period / dt).round();
        if steps < 1.0 || (steps * dt - period).abs() > 1e-9 {
            return Err(EnvError::BadTimeStep { dt, control_freq, period });
        }
        Ok(Self { periods, period, substeps: steps as u32 })
    }

    /// Control periods of a step.
    ///
    /// # Errors
    /// [`EnvError::OutOfRange`] for a frequency outside 5 to 100 Hz.
    pub fn periods(control_freq: f64) -> Result<u32, EnvError> {
        in_range("control_freq", control_freq, CONTROL_FREQS, "Hz")?;
        Ok((1.0 / (CONTROL_PERIOD * control_freq) - 1e-9).ceil().max(1.0) as u32)
    }
}
