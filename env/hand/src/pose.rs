//! The grasp pose: where the hand goes, and its preshape.

use nalgebra::Isometry3;
use serde::{Deserialize, Serialize};

/// A hand pose to grasp from, with the preshape of its fingers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GraspPose {
    /// Hand (grasp) frame in the object's frame.
    pub object_from_hand: Isometry3<f64>,
    /// Angle of the preshape joint, radians: 0 for power, pi/2 for pinch.
    pub preshape: f64,
}
