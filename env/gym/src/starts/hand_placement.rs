//! The initial pose of the hand: as requested, or sampled and raised out of the object.

use crate::EnvError;
use crate::actions::control::Control;
use crate::actions::workspace::{WORKSPACE_HIGH, WORKSPACE_LOW};
use crate::pool::env_spec::{EnvSpec, open_hand};
use crate::starts::initial_samples::InitialSamples;
use crate::starts::reset_options::{ResetOptions, bad_option, rigid};
use graspbox_plan::{CollisionScene, OpenHand};
use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};
use std::f64::consts::PI;

/// Extra distance of the hand from the table's middle before a decision, metres.
pub const WAITING_DISTANCE: f64 = 0.35;
/// Rotation of the waiting hand about the world's x axis, from above the middle towards +y, radians (50 degrees).
pub const WAITING_ANGLE: f64 = 0.873;
/// Greatest coordinate of the waiting hand along any axis, metres.
const FURTHEST: f64 = 1.0;
/// Step by which the hand is raised while it collides with the object, metres.
const RAISE: f64 = 0.05;
/// Most raises: more would leave the workspace.
const MOST_RAISES: usize = 10;

/// The obstacles of the hand's initial pose.
pub struct HandPlacement<'a> {
    /// Data shared by all environments.
    pub spec: &'a EnvSpec,
    pub object: &'a str,
    /// Object and table; `None` without obstacles.
    pub obstacles: Option<CollisionScene>,
    /// Pose of the object.
    pub world_from_object: &'a Isometry3<f64>,
}

impl HandPlacement<'_> {
    /// Pose of the open hand: as requested, or sampled and raised out of the object.
    ///
    /// # Errors
    /// [`EnvError::BadOption`] for a requested pose out of the workspace or in collision, [`EnvError::NoRoom`] otherwise.
    pub fn place(
        &self,
        samples: &InitialSamples,
        options: &ResetOptions,
        preshape: f64,
    ) -> Result<Isometry3<f64>, EnvError> {
        let hand = self.spec.hand();
        let other;
        let open = if preshape == hand.preshape_limits()[0] {
            &self.spec.open
        } else {
            other = open_hand(hand, preshape)?;
            &other
        };
        if let Some(rows) = &options.world_from_hand {
            return self.given(rows, open);
        }
        let mut hand = self.sampled(samples);
        for _ in 0..MOST_RAISES {
            if !self.collides(open, &hand) {
                return Ok(hand);
            }
            hand.translation.vector.z += RAISE;
        }
        Err(EnvError::NoRoom { object: self.object.to_owned() })
    }

    /// True if the open hand touches nothing at a pose.
    pub fn is_free(&self, world_from_hand: &Isometry3<f64>, preshape: f64) -> bool {
        open_hand(self.spec.hand(), preshape).is_ok_and(|open| !self.collides(&open, world_from_hand))
    }

    fn collides(&self, open: &OpenHand, world_from_hand: &Isometry3<f64>) -> bool {
        let object_from_hand = self.world_from_object.inverse() * world_from_hand;
        self.obstacles.as_ref().is_some_and(|o| o.collides(open, &object_from_hand))
    }

    fn given(&self, rows: &[[f64; 4]; 4], open: &OpenHand) -> Result<Isometry3<f64>, EnvError> {
        let hand = rigid(rows, "world_from_hand")?;
        let [low, high] = if self.spec.config.control.decides() {
            [[-FURTHEST, -FURTHEST, 0.0], [FURTHEST; 3]]
        } else {
            [WORKSPACE_LOW, WORKSPACE_HIGH]
        };
        let at = &hand.translation.vector;
        if (0..3).any(|i| !(low[i]..=high[i]).contains(&at[i])) {
            let why = format!("the hand would be at {:?} m; keep it between {low:?} and {high:?} m", at.as_slice());
            return Err(bad_option("world_from_hand", why));
        }
        if self.collides(open, &hand) {
            let why = format!("the open hand would be within 1 cm of the table or of object `{}`", self.object);
            return Err(bad_option("world_from_hand", why));
        }
        Ok(hand)
    }

    fn sampled(&self, samples: &InitialSamples) -> Isometry3<f64> {
        let axis = Unit::new_unchecked(Vector3::new(samples.tilt[0].cos(), samples.tilt[0].sin(), 0.0));
        let tilt = if self.spec.config.control == Control::TopDown { 0.0 } else { samples.tilt[1] };
        let rotation = UnitQuaternion::from_axis_angle(&axis, tilt)
            * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), samples.yaw)
            * UnitQuaternion::from_axis_angle(&Vector3::x_axis(), PI);
        let above = Isometry3::from_parts(Translation3::from(Vector3::from(samples.hand)), rotation);
        if self.spec.config.control.decides() {
            let aside = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), -WAITING_ANGLE);
            aside * Translation3::new(0.0, 0.0, WAITING_DISTANCE) * above
        } else {
            above
        }
    }
}
