//! The one definition of success, and the quantities that describe a grasp.
//!
//! The judge observes the world after every time step. A trial reads its verdict once, at the end; a closed-loop environment after every step.

use crate::EpisodeError;
use graspbox_mesh::{all_within, in_range, is_pose};
use graspbox_sim::World;
use nalgebra::{Isometry3, Point3};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// The criterion of success: for a time without interruption, the object is high, free of table and ground, and at rest in the hand.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SuccessCriterion {
    /// The object's centre of mass is at least this far above its resting height, metres.
    pub lift_height: f64,
    /// Time for which all conditions hold, seconds.
    pub hold_time: f64,
    /// The object's centre of mass is slower than this in the hand's frame, as the mean over the last [`REST_TIME`], m/s.
    pub rest_speed: f64,
}

/// Time over which the speed of an object in the hand is measured, seconds. Contacts that open and close move an object at rest by a fraction
/// of a millimetre within one step.
pub const REST_TIME: f64 = 0.1;

impl Default for SuccessCriterion {
    fn default() -> Self {
        Self { lift_height: 0.15, hold_time: 0.5, rest_speed: 0.005 }
    }
}

impl SuccessCriterion {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`EpisodeError::OutOfRange`], naming the first setting that is out of range.
    pub fn validate(&self) -> Result<(), EpisodeError> {
        in_range("success.lift_height", self.lift_height, 0.01..=1.0, "m")?;
        in_range("success.hold_time", self.hold_time, 0.0..=60.0, "s")?;
        Ok(in_range("success.rest_speed", self.rest_speed, 1e-4..=1.0, "m/s")?)
    }
}

/// Greatest translation in the hand of a secure grasp since the object left the table, metres.
pub const SECURE_SHIFT: f64 = 0.05;
/// Greatest rotation in the hand of a secure grasp since the object left the table, radians (15 degrees).
pub const SECURE_TURN: f64 = 15.0 * std::f64::consts::PI / 180.0;
/// An object that rose by this counts as lifted, and so can be dropped, metres.
pub const CLEAR_OF_TABLE: f64 = 0.02;

/// The kind of a failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FailureKind {
    /// The hand collides with object or table at the start or on the approach.
    Infeasible,
    /// The hand does not touch the object after it has closed, including while it rises.
    NoContact,
    /// The hand touched the object, but did not lift it off the table.
    Slipped,
    /// The object was lifted, then lost.
    Dropped,
    /// The object is held, but does not come to rest in the hand, or the simulation diverged.
    Unstable,
}

impl FailureKind {
    /// Every kind.
    pub const ALL: [Self; 5] = [Self::Infeasible, Self::NoContact, Self::Slipped, Self::Dropped, Self::Unstable];

    /// Name in outcomes and infos.
    pub fn name(self) -> &'static str {
        match self {
            Self::Infeasible => "infeasible",
            Self::NoContact => "no_contact",
            Self::Slipped => "slipped",
            Self::Dropped => "dropped",
            Self::Unstable => "unstable",
        }
    }
}

/// The verdict of the judge at one time.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    /// The [`SuccessCriterion`] is met.
    pub success: bool,
    /// Success with less than [`SECURE_SHIFT`] and [`SECURE_TURN`] in the hand since the object left the table.
    pub secure: bool,
    /// Rise of the object's centre of mass above its resting height, metres.
    pub lift: f64,
    /// Rise of the hand since lifting began, metres.
    pub hand_lift: f64,
    /// Translation of the centre of mass in the hand's frame since the object left the table, metres.
    pub shift: f64,
    /// Rotation in the hand's frame since the object left the table, radians.
    pub turn: f64,
}

/// Positions of a point after the steps of the last [`REST_TIME`], oldest first, metres.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct RecentMotion(VecDeque<Point3<f64>>);

impl RecentMotion {
    /// Adds the position after `times` steps of `dt` seconds. Returns the mean speed over [`REST_TIME`], or since the first position, m/s.
    fn speed(&mut self, dt: f64, position: Point3<f64>, times: u32) -> f64 {
        let steps = (REST_TIME / dt).round().max(1.0) as usize;
        for _ in 0..times {
            self.0.push_back(position);
        }
        while self.0.len() > steps + 1 {
            self.0.pop_front();
        }
        let time = (self.0.len() - 1) as f64 * dt;
        if time > 0.0 { (position - self.0[0]).norm() / time } else { f64::INFINITY }
    }
}

/// Observes an object of a world step by step and judges its grasp.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Judge {
    /// Index of the object in the world.
    object: usize,
    criterion: SuccessCriterion,
    /// Resting height of the centre of mass, metres.
    resting_height: f64,
    /// Centre of mass in the object frame.
    center: Point3<f64>,
    /// Of the centre of mass in the hand's frame.
    motion: RecentMotion,
    /// Steps for which all conditions of the criterion have held without interruption.
    held_steps: u64,
    /// Pose of the object in the hand when it last left table or ground.
    left_table: Option<Isometry3<f64>>,
    was_on_scenery: bool,
    highest: f64,
    /// Height of the hand when lifting began.
    lift_start: Option<f64>,
}

impl Judge {
    /// Begins to judge a world in which the object is at rest.
    ///
    /// * `object`: its index in the world.
    /// * `center`: its centre of mass, object frame.
    pub fn new(world: &World, object: usize, center: Point3<f64>, criterion: SuccessCriterion) -> Self {
        Self {
            object,
            criterion,
            resting_height: world.center_of(object).z,
            center,
            motion: RecentMotion::default(),
            held_steps: 0,
            left_table: None,
            was_on_scenery: true,
            highest: 0.0,
            lift_start: None,
        }
    }

    /// Refuses states that no judge of this world can have.
    ///
    /// * `object`, `center`: as for [`Judge::new`].
    ///
    /// # Errors
    /// [`EpisodeError::OutOfRange`], naming the first number.
    pub(crate) fn check(&self, object: usize, center: &Point3<f64>) -> Result<(), EpisodeError> {
        /// Farther than anything falls, metres.
        const FARTHEST: f64 = 1e5;
        let numbers = |point: &Point3<f64>| <[f64; 3]>::from(*point);
        in_range("judge.object", self.object as f64, object as f64..=object as f64, "")?;
        in_range("judge.resting_height", self.resting_height, -FARTHEST..=FARTHEST, "m")?;
        for (own, of_object) in numbers(&self.center).into_iter().zip(numbers(center)) {
            in_range("judge.center", own, of_object..=of_object, "m")?;
        }
        all_within("judge.motion", self.motion.0.iter().flat_map(numbers), FARTHEST, "m")?;
        in_range("judge.held_steps", self.held_steps as f64, 0.0..=1e15, "")?;
        if let Some(pose) = &self.left_table {
            is_pose("judge.left_table", pose, FARTHEST)?;
        }
        Ok(all_within(
            "judge.highest or judge.lift_start",
            [self.highest, self.lift_start.unwrap_or(0.0)],
            FARTHEST,
            "m",
        )?)
    }

    pub fn criterion(&self) -> &SuccessCriterion {
        &self.criterion
    }

    /// To be called when the object is dropped: from now on heights count from `resting_height` of its centre of mass, metres.
    pub fn dropped(&mut self, world: &World, resting_height: f64) {
        self.resting_height = resting_height;
        self.highest = 0.0;
        self.was_on_scenery = world.object_on_scenery();
    }

    /// To be called once, when the hand begins to lift.
    pub fn begin_lift(&mut self, world: &World) {
        self.lift_start = Some(world.world_from_hand().translation.z);
    }

    /// Observes the world after one or more steps.
    ///
    /// * `on_scenery`: table, ground or walls carry the object: [`World::carried_by_scenery`].
    /// * `steps`: the number of steps since the last observation: more than one if nothing moved the objects in them.
    pub fn observe(&mut self, world: &World, on_scenery: bool, steps: u32) {
        let hand_from_object = world.hand_from(self.object);
        let rise = self.rise(world);
        self.highest = self.highest.max(rise);
        if self.was_on_scenery && !on_scenery {
            self.left_table = Some(hand_from_object);
        }
        self.was_on_scenery = on_scenery;
        let still = self.motion.speed(world.dt(), hand_from_object * self.center, steps) < self.criterion.rest_speed;
        let holds = rise >= self.criterion.lift_height && !on_scenery && still;
        self.held_steps = if holds { self.held_steps + u64::from(steps) } else { 0 };
    }

    /// The present verdict.
    pub fn verdict(&self, world: &World) -> Verdict {
        let now = world.hand_from(self.object);
        let (shift, turn) = match self.left_table {
            Some(then) => {
                let shift = (now * self.center - then * self.center).norm();
                (shift, (then.rotation.inverse() * now.rotation).angle())
            }
            None => (0.0, 0.0),
        };
        let success = self.success(world);
        let hand_lift = self.lift_start.map_or(0.0, |start| world.world_from_hand().translation.z - start);
        Verdict {
            success,
            secure: success && shift < SECURE_SHIFT && turn < SECURE_TURN,
            lift: self.rise(world),
            hand_lift,
            shift,
            turn,
        }
    }

    /// Time for which all conditions of the criterion have held without interruption, seconds.
    pub fn held_time(&self, world: &World) -> f64 {
        self.held_steps as f64 * world.dt()
    }

    /// [`Judge::held_time`] as a share of the criterion's hold time; above 1 if the object is held longer.
    pub fn held_share(&self, world: &World) -> f64 {
        self.held_time(world) / self.criterion.hold_time
    }

    /// True once the conditions have held for the criterion's hold time: the one definition of success.
    pub fn success(&self, world: &World) -> bool {
        self.held_time(world) >= self.criterion.hold_time - 1e-9
    }

    fn rise(&self, world: &World) -> f64 {
        world.center_of(self.object).z - self.resting_height
    }

    /// Height of the object's centre of mass at rest, metres.
    pub fn resting_height(&self) -> f64 {
        self.resting_height
    }

    /// Greatest rise of the centre of mass above its resting height so far, metres.
    pub fn highest(&self) -> f64 {
        self.highest
    }

    /// True while table, ground or walls carry the object.
    pub fn on_scenery(&self) -> bool {
        self.was_on_scenery
    }

    /// The kind of failure of a grasp that did not succeed.
    ///
    /// * `touches`: the hand touches the object at present.
    pub fn failure(&self, world: &World, touches: bool) -> FailureKind {
        let held_high = touches && !self.was_on_scenery && self.rise(world) >= self.criterion.lift_height;
        if held_high || world.has_diverged() {
            FailureKind::Unstable
        } else if self.highest >= CLEAR_OF_TABLE && self.left_table.is_some() {
            FailureKind::Dropped
        } else {
            FailureKind::Slipped
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT: f64 = 0.002;

    /// Speed after each of `steps` steps of a point at `place(time)`, m/s.
    fn speeds(steps: usize, place: impl Fn(f64) -> f64) -> Vec<f64> {
        let mut motion = RecentMotion::default();
        (0..steps).map(|step| motion.speed(DT, Point3::new(place(step as f64 * DT), 0.0, 0.0), 1)).collect()
    }

    #[test]
    fn a_steady_motion_has_its_own_speed() {
        let found = speeds(200, |time| 0.02 * time);
        assert!(found[0].is_infinite());
        assert!(found[1..].iter().all(|speed| (speed - 0.02).abs() < 1e-9));
    }

    #[test]
    fn a_jump_counts_as_the_motion_of_its_time() {
        let found = speeds(200, |time| if time > 0.2 { 3e-4 } else { 0.0 });
        let fastest = found[1..].iter().copied().fold(0.0, f64::max);
        assert!((fastest - 3e-4 / REST_TIME).abs() < 1e-9, "{fastest}");
        assert!(fastest < SuccessCriterion::default().rest_speed);
        assert!(found[199].abs() < 1e-12, "it is forgotten after {REST_TIME} s");
    }
}
