//! Control modes, and the control period.

use crate::AgentError;
use serde::{Deserialize, Serialize};

/// Seconds between two actions: 20 Hz.
pub const CONTROL_PERIOD: f64 = 0.05;

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
    /// One decision per episode: a pose in the world and a preshape, followed by a trial.
    GraspPose,
    /// Such decisions until a scene of several objects is cleared.
    Clear,
}

/// The control modes with an action every control period.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClosedLoop {
    /// [`Control::Twist`].
    Twist,
    /// [`Control::DeltaPose`].
    DeltaPose,
    /// [`Control::TargetPose`].
    TargetPose,
}

impl Control {
    /// Every mode of closed-loop control.
    pub const CLOSED_LOOP: [Self; 3] = [Self::Twist, Self::DeltaPose, Self::TargetPose];

    /// The closed-loop mode; `None` if a step is a decision.
    pub fn closed_loop(self) -> Option<ClosedLoop> {
        match self {
            Self::Twist => Some(ClosedLoop::Twist),
            Self::DeltaPose => Some(ClosedLoop::DeltaPose),
            Self::TargetPose => Some(ClosedLoop::TargetPose),
            Self::GraspPose | Self::Clear => None,
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
            Self::GraspPose => "grasp_pose",
            Self::Clear => "clear",
        }
    }
}

/// Number of physics steps in a control period of [`CONTROL_PERIOD`].
///
/// * `dt`: physics time step, seconds.
///
/// # Errors
/// [`AgentError::BadTimeStep`] for a time step that does not divide the period.
pub fn steps_per_control(dt: f64) -> Result<u32, AgentError> {
    let steps = (CONTROL_PERIOD / dt).round();
    if steps < 1.0 || (steps * dt - CONTROL_PERIOD).abs() > 1e-9 {
        return Err(AgentError::BadTimeStep { dt, period: CONTROL_PERIOD });
    }
    Ok(steps as u32)
}
