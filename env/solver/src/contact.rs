//! Contact points as they are reported.

use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::model::BodyIndex;
use crate::scenery::Surface;

/// One side of a contact point, in the frame of its body (for the scenery: the world).
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Side {
    /// See [`BodyIndex`].
    pub body: BodyIndex,
    /// Shape within a body of the tree.
    pub shape: u16,
    /// Point on the body, metres.
    pub point: Vector3<f64>,
    /// Unit normal into the body.
    pub normal: Vector3<f64>,
}

/// A contact point of the last step; one across a gap has no force.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Contact {
    /// Both sides.
    pub sides: [Side; 2],
    /// The surface, if the second body is the scenery.
    pub surface: Option<Surface>,
    /// Midway between the surfaces at the beginning of the step, frame of the base, metres.
    pub point: Vector3<f64>,
    /// Unit normal from the first to the second body, frame of the base.
    pub normal: Vector3<f64>,
    /// Coefficient of friction.
    pub friction: f64,
    /// Signed distance at the end of the step, metres; negative where the bodies overlap.
    pub distance: f64,
    /// Normal force, mean over the step, N.
    pub force: f64,
    /// Friction on the second body, mean over the step, frame of the base, N.
    pub friction_force: Vector3<f64>,
}
