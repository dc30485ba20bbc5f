//! The one definition of success, and every number that describes a grasp.
//!
//! The judge looks at the world after every time step. A trial asks it once, at its end; a closed-loop environment asks after every step.

use graspbox_sim::World;
use nalgebra::{Isometry3, Point3};
use serde::{Deserialize, Serialize};

/// The object's centre of mass must be this far above its resting height, metres.
pub const LIFT_HEIGHT: f64 = 0.15;
/// In the hand's frame the object must move slower than this, m/s.
pub const REST_SPEED: f64 = 0.005;
/// Success is held for this long, seconds.
pub const HOLD_TIME: f64 = 0.5;
/// A secure grasp moved less than this since the object left the table, metres.
pub const SECURE_SHIFT: f64 = 0.05;
/// A secure grasp turned less than this since the object left the table, radians (15 degrees).
pub const SECURE_TURN: f64 = 15.0 * std::f64::consts::PI / 180.0;
/// The reference study reads its success this long after closing begins, seconds.
pub const LEGACY_TIME: f64 = 2.5;
/// Sampling period of kindness, seconds.
pub const KINDNESS_PERIOD: f64 = 0.01;
/// The object counted as lifted, and so could be dropped, once it rose this far, metres.
const CLEAR_OF_TABLE: f64 = 0.02;

/// Why a grasp failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FailureKind {
    /// The hand collides with object or table at the start or on the approach.
    Infeasible,
    /// The closed hand does not touch the object, not even while it rises.
    NoContact,
    /// The hand touched the object, but it never left the table for good.
    Slipped,
    /// The object was lifted, then lost.
    Dropped,
    /// The object is held, but does not come to rest in the hand (or the simulation diverged).
    Unstable,
}

/// What the judge can say at any time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// Held high, free and still for the last half second.
    pub success: bool,
    /// Success without shifting or turning in the hand since the object left the table.
    pub secure: bool,
    /// Rise of the object's centre of mass above its resting height, metres.
    pub lift: f64,
    /// Rise of the hand since lifting began, metres.
    pub hand_lift: f64,
    /// Shift of the centre of mass in the hand's frame since the object left the table, metres.
    pub shift: f64,
    /// Turn in the hand's frame since the object left the table, radians.
    pub turn: f64,
    /// Mean of |d distance/dt| between hand frame and object frame since lifting began, m/s.
    pub kindness_rate: f64,
}

/// Observes a world step by step.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Judge {
    /// Resting height of the centre of mass, metres.
    resting_height: f64,
    /// Origin of the study's object frame: middle of the base, object frame.
    base_point: Point3<f64>,
    /// Centre of mass in the object frame.
    center: Point3<f64>,
    /// Steps for which the success predicate has held without a break.
    held_steps: u64,
    /// Pose in the hand when the object last left the scenery.
    left_table: Option<Isometry3<f64>>,
    was_on_scenery: bool,
    highest: f64,
    /// Time and height of the hand when lifting began.
    lift_start: Option<(f64, f64)>,
    distance: f64,
    /// Sum of |change of distance| since lifting began, metres.
    travelled: f64,
    /// Distance at the last kindness sample, and their sum.
    sampled: f64,
    kindness: f64,
    samples: u64,
}

impl Judge {
    /// Begins to judge a world in which the object rests.
    ///
    /// * `base_point`: origin of the study's object frame (middle of the base), object frame.
    /// * `center`: centre of mass, object frame.
    pub fn new(world: &World, base_point: Point3<f64>, center: Point3<f64>) -> Self {
        let resting_height = world.object_center().z;
        let distance = (world.hand_from_object() * base_point).coords.norm();
        Self {
            resting_height,
            base_point,
            center,
            held_steps: 0,
            left_table: None,
            was_on_scenery: true,
            highest: 0.0,
            lift_start: None,
            distance,
            travelled: 0.0,
            sampled: distance,
            kindness: 0.0,
            samples: 0,
        }
    }

    /// The object was let go where it is, or was before it came to rest; its centre of mass rests at `resting_height`, metres.
    pub fn dropped(&mut self, world: &World, resting_height: f64) {
        self.resting_height = resting_height;
        self.highest = 0.0;
        self.was_on_scenery = world.object_on_scenery();
    }

    /// To be called once, when the hand begins to lift.
    pub fn begin_lift(&mut self, world: &World) {
        self.lift_start = Some((world.time(), world.world_from_hand().translation.z));
    }

    /// Looks at the world after a step.
    pub fn observe(&mut self, world: &World) {
        let hand_from_object = world.hand_from_object();
        let rise = world.object_center().z - self.resting_height;
        self.highest = self.highest.max(rise);
        let on_scenery = world.object_on_scenery();
        if self.was_on_scenery && !on_scenery {
            self.left_table = Some(hand_from_object);
        }
        self.was_on_scenery = on_scenery;
        let still = world.object_velocity_in_hand().0.norm() < REST_SPEED;
        let holds = rise >= LIFT_HEIGHT && !on_scenery && still;
        self.held_steps = if holds { self.held_steps + 1 } else { 0 };
        let distance = (hand_from_object * self.base_point).coords.norm();
        if self.lift_start.is_some() {
            self.travelled += (distance - self.distance).abs();
        }
        self.distance = distance;
        // The small allowance keeps a sample from slipping to the next step by rounding.
        if world.time() + 1e-9 >= (self.samples + 1) as f64 * KINDNESS_PERIOD {
            self.kindness += (distance - self.sampled).abs() / KINDNESS_PERIOD;
            self.sampled = distance;
            self.samples += 1;
        }
    }

    /// What can be said now.
    pub fn verdict(&self, world: &World) -> Verdict {
        let now = world.hand_from_object();
        let (shift, turn) = match self.left_table {
            Some(then) => {
                let shift = (now * self.center - then * self.center).norm();
                (shift, (then.rotation.inverse() * now.rotation).angle())
            }
            None => (0.0, 0.0),
        };
        let success = self.success(world);
        let (since, hand_lift) = match self.lift_start {
            Some((time, height)) => (world.time() - time, world.world_from_hand().translation.z - height),
            None => (0.0, 0.0),
        };
        Verdict {
            success,
            secure: success && shift < SECURE_SHIFT && turn < SECURE_TURN,
            lift: world.object_center().z - self.resting_height,
            hand_lift,
            shift,
            turn,
            kindness_rate: if since > 0.0 { self.travelled / since } else { 0.0 },
        }
    }

    /// Time for which the object has been held high, free and still without a break, seconds.
    pub fn held_time(&self, world: &World) -> f64 {
        self.held_steps as f64 * world.dt()
    }

    /// True once the object has been held for [`HOLD_TIME`]: the one definition of success.
    pub fn success(&self, world: &World) -> bool {
        self.held_time(world) >= HOLD_TIME - 1e-9
    }

    /// Height of the centre of mass of the object at rest, metres.
    pub fn resting_height(&self) -> f64 {
        self.resting_height
    }

    /// Greatest rise of the centre of mass above its resting height so far, metres.
    pub fn highest(&self) -> f64 {
        self.highest
    }

    /// True while the object touches table or ground.
    pub fn on_scenery(&self) -> bool {
        self.was_on_scenery
    }

    /// Kindness summed so far, m/s a sample.
    pub fn kindness(&self) -> f64 {
        self.kindness
    }

    /// Distance between the hand's frame and the study's object frame, metres.
    pub fn distance(&self) -> f64 {
        self.distance
    }

    /// The study's own criterion, read now: the object followed the hand, or did not move in it at all.
    pub fn legacy_success(&self, world: &World) -> bool {
        let verdict = self.verdict(world);
        !(verdict.hand_lift - verdict.lift > 0.10 && self.kindness >= 1e-4)
    }

    /// Names the failure of a grasp that did not succeed.
    ///
    /// * `touches`: the hand touches the object now.
    pub fn failure(&self, world: &World, touches: bool) -> FailureKind {
        let rise = world.object_center().z - self.resting_height;
        let held_high = touches && !self.was_on_scenery && rise >= LIFT_HEIGHT;
        if held_high || !world.is_finite() {
            FailureKind::Unstable
        } else if self.highest >= CLEAR_OF_TABLE && self.left_table.is_some() {
            FailureKind::Dropped
        } else {
            FailureKind::Slipped
        }
    }
}
