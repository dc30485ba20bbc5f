//! A contact point, as it is reported.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::model::BodyIndex;
use crate::scenery::Surface;

/// One side of a contact point, in its body's frame (the world's for the scenery).
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Side {
    /// The object, a body of the tree (from [`crate::BASE`]), or the scenery.
    pub body: BodyIndex,
    /// Shape within a body of the tree.
    pub shape: u16,
    /// On the body, metres.
    pub point: Vector3<f64>,
    /// Unit normal into the body.
    pub normal: Vector3<f64>,
}

/// A contact point of the last step, pressing or merely near.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Contact {
    /// Both sides.
    pub sides: [Side; 2],
    /// Which surface, where the second body is the scenery.
    pub surface: Option<Surface>,
    /// Midway between the bodies, frame of the base, at the beginning of the step.
    pub point: Vector3<f64>,
    /// From the first to the second body, frame of the base.
    pub normal: Vector3<f64>,
    /// Coefficient of friction.
    pub friction: f64,
    /// Distance at the end of the step, metres.
    pub distance: f64,
    /// Normal force, mean over the step, N.
    pub force: f64,
}
