//! One episode under an agent: actions in, reward terms and endings out.

use crate::AgentError;
use crate::action::{PRESHAPE_SPOOL, motor_commands};
use crate::arm_controller::ArmController;
use crate::env_spec::EnvSpec;
use crate::initial_state::InitialState;
use crate::objects::Prepared;
use crate::reward::{Events, Potentials, TERMS, terms};
use graspbox_episode::{Episode, FailureKind, Judge};
use graspbox_vision::visual_models::object_color;
use graspbox_vision::{ScenePose, Viewpoint};
use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

mod decide;

/// The object is lost when its centre of mass is further than this from the vertical through the table's middle, metres: out of the
/// workspace.
pub const LOST_DISTANCE: f64 = 0.5;
/// The object is lost when its centre of mass is lower than this, metres: it is off the table.
pub const LOST_HEIGHT: f64 = 0.0;

/// Names of the failure codes of [`Info::failure`].
pub const FAILURES: [&str; 6] = ["", "infeasible", "no_contact", "slipped", "dropped", "unstable"];

/// What is said about an environment beside its observations.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Info {
    /// The grasp succeeded.
    pub is_success: bool,
    /// It succeeded without shifting or turning in the hand.
    pub is_secure: bool,
    /// What the failure would be called if the episode ended now: an index into [`FAILURES`], 0 for a success.
    pub failure: u8,
    /// Rise of the object's centre of mass above its resting height, metres.
    pub lift: f64,
    /// Index of the object.
    pub object: usize,
    /// Index of its resting pose; -1 where it was let go at a pose.
    pub resting: i64,
    /// The hand touches the object.
    pub touches: bool,
    /// The protective stop held the hand at some time in the last step.
    pub protective_stop: bool,
}

/// One episode under an agent.
pub struct AgentEpisode {
    episode: Episode,
    prepared: Arc<Prepared>,
    arm: ArmController,
    record: Record,
}

/// What an episode remembers beside world, judge and arm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Record {
    pub object: usize,
    pub resting: usize,
    /// The object was let go at a pose instead.
    pub dropped: bool,
    /// Factors on the object's friction and mass.
    pub friction: f64,
    pub mass: f64,
    /// Centre of mass at the start, world.
    pub first_center: Point3<f64>,
    pub last_action: Vec<f32>,
    /// Target of the preshape, radians.
    pub preshape: f64,
    pub steps: u32,
    /// The hand touched the object at some time.
    pub touched: bool,
    /// Lifting began: the object left the table in the hand.
    pub lifting: bool,
    pub success: bool,
    /// What the failure is called, where it is known already.
    pub failure: Option<FailureKind>,
    pub stopped: bool,
    pub potentials: Potentials,
    pub viewpoint: Viewpoint,
}

impl AgentEpisode {
    /// Begins an episode.
    ///
    /// # Errors
    /// None that a start which [`start`](crate::initial_state::start) gave would cause.
    pub fn new(start: &InitialState, spec: &EnvSpec) -> Result<Self, AgentError> {
        let factors = [start.friction, start.mass];
        let episode = Episode::reset_at(
            &start.scene,
            &start.world_from_hand,
            &start.world_from_object,
            start.preshape,
            factors,
            spec.config.success,
        );
        let record = Record {
            object: start.object,
            resting: start.resting,
            dropped: start.dropped.is_some(),
            friction: start.friction,
            mass: start.mass,
            first_center: episode.world().object_center(),
            last_action: vec![0.0; spec.action],
            preshape: start.preshape,
            steps: 0,
            touched: false,
            lifting: false,
            success: false,
            failure: None,
            stopped: false,
            potentials: Potentials::default(),
            viewpoint: start.viewpoint.clone(),
        };
        let mut play = Self {
            arm: ArmController::new(&start.world_from_hand, &start.hand_error),
            prepared: Arc::clone(&start.prepared),
            episode,
            record,
        };
        if let Some(height) = start.dropped {
            play.episode.dropped(height);
        }
        play.record.potentials = Potentials::of(&play, spec);
        Ok(play)
    }

    pub(crate) fn resume(episode: Episode, prepared: Arc<Prepared>, arm: ArmController, record: Record) -> Self {
        Self { episode, prepared, arm, record }
    }

    pub(crate) fn record(&self) -> &Record {
        &self.record
    }

    /// To be called before the control periods of an action: what is said of all of them begins anew.
    pub(crate) fn begin_action(&mut self) {
        self.record.stopped = false;
    }

    /// One control period, or the one decision; returns the reward terms, and whether the episode ended by success or loss.
    ///
    /// * `action`: finite numbers, one for each row of the control's table.
    ///
    /// # Errors
    /// A motor command that is not finite, which a finite action never gives.
    pub fn step(&mut self, action: &[f32], spec: &EnvSpec) -> Result<([f32; TERMS], bool), AgentError> {
        let control = spec.config.control;
        if control.decides() {
            return Ok((self.decide(action, spec)?, true));
        }
        let goal = control.goal(action, self.arm.believed());
        let motion = self.arm.begin(&goal);
        let (values, open) = (&action[control.hand_size()..], self.fingers_are_open());
        let commands = motor_commands(spec.hand(), values, open, &mut self.record.preshape);
        let mut events = Events::default();
        let dt = self.episode.world().dt();
        for i in 0..spec.substeps {
            let load = self.episode.world().hand_load();
            events.table |= load.scenery;
            self.record.touched |= load.object;
            let time = f64::from(i) * dt;
            let hand = self.arm.advance(&motion, time, dt, &spec.guard, &load);
            events.stop |= self.arm.stop.active;
            match self.episode.advance(&hand, &commands) {
                Ok(()) => self.watch_lift(),
                // The action is finite: it is a world that diverged whose tendons are no numbers any more.
                Err(_) if !self.finite() => break,
                Err(error) => return Err(error.into()),
            }
            if self.episode.judge().success(self.episode.world()) {
                events.success = true;
                break;
            }
        }
        let finite = self.finite();
        events.success &= finite;
        events.failure = !events.success && (!finite || self.lost());
        self.record.success = events.success;
        self.record.stopped |= events.stop;
        self.record.steps = self.record.steps.saturating_add(1);
        self.record.touched |= self.touches();
        self.record.last_action.clear();
        self.record.last_action.extend(action.iter().map(|a| a.clamp(-1.0, 1.0)));
        let before = self.record.potentials;
        self.record.potentials = Potentials::of(self, spec);
        let terms = terms(&before, &self.record.potentials, &events, self);
        Ok((terms, events.success || events.failure))
    }

    /// No finger is closed so far that the preshape has to stay.
    fn fingers_are_open(&self) -> bool {
        let world = self.episode.world();
        let mut fingers = world.hand().fingers.iter();
        fingers.all(|finger| world.motors()[finger.motor].position <= PRESHAPE_SPOOL)
    }

    /// Lifting begins, for the judge, when the object first leaves the table while the hand touches it.
    fn watch_lift(&mut self) {
        if !self.record.lifting && !self.episode.judge().on_scenery() && self.touches() {
            self.record.lifting = true;
            self.record.touched = true;
            self.episode.begin_lift();
        }
    }

    /// False once the simulation went wrong: see [`World::has_diverged`](graspbox_sim::World::has_diverged).
    fn finite(&self) -> bool {
        let world = self.episode.world();
        !world.has_diverged() && (0..world.hand().fingers.len()).all(|i| world.finger(i).tension.is_finite())
    }

    fn touches(&self) -> bool {
        !self.episode.world().contacts().links.is_empty()
    }

    /// The object is off the table, or out of the workspace.
    fn lost(&self) -> bool {
        let center = self.episode.world().object_center();
        center.z < LOST_HEIGHT || center.coords.xy().norm() > LOST_DISTANCE
    }

    /// What can be said now.
    pub fn info(&self) -> Info {
        let world = self.episode.world();
        let verdict = self.episode.verdict();
        let touches = self.touches();
        let failure = if self.record.success || self.record.failure.is_some() {
            self.record.failure
        } else if !self.finite() {
            Some(FailureKind::Unstable)
        } else if !self.record.touched {
            Some(FailureKind::NoContact)
        } else {
            Some(self.episode.judge().failure(world, touches))
        };
        Info {
            is_success: self.record.success,
            is_secure: self.record.success && verdict.secure,
            failure: failure.map_or(0, code),
            lift: if verdict.lift.is_finite() { verdict.lift } else { 0.0 },
            object: self.record.object,
            resting: if self.record.dropped { -1 } else { self.record.resting as i64 },
            touches,
            protective_stop: self.record.stopped,
        }
    }

    /// The state machine inside.
    pub fn episode(&self) -> &Episode {
        &self.episode
    }

    /// The object.
    pub fn prepared(&self) -> &Arc<Prepared> {
        &self.prepared
    }

    /// The judge.
    pub fn judge(&self) -> &Judge {
        self.episode.judge()
    }

    /// The arm.
    pub fn arm(&self) -> &ArmController {
        &self.arm
    }

    /// The last action, clipped; zeros before the first.
    pub fn last_action(&self) -> &[f32] {
        &self.record.last_action
    }

    /// Control periods since the episode began.
    pub fn steps(&self) -> u32 {
        self.record.steps
    }

    /// Factor on the object's mass.
    pub fn mass_factor(&self) -> f64 {
        self.record.mass
    }

    /// Potentials of the reward's shaping terms.
    pub fn potentials(&self) -> &Potentials {
        &self.record.potentials
    }

    /// Cameras and light.
    pub fn viewpoint(&self) -> &Viewpoint {
        &self.record.viewpoint
    }

    /// Where everything is now.
    ///
    /// # Errors
    /// A mesh that cannot be drawn.
    pub fn scene_pose(&self) -> Result<ScenePose<'_>, AgentError> {
        let object = self.prepared.model()?;
        let color = object_color(self.prepared.body().name());
        Ok(ScenePose::of(self.episode.world(), object, color))
    }

    /// Centre of mass of the object at the start, world, metres.
    pub fn first_center(&self) -> &Point3<f64> {
        &self.record.first_center
    }

    /// Middle of the object's bounds, object frame, metres.
    pub fn bounds_center(&self) -> Point3<f64> {
        self.prepared.bounds_center()
    }

    /// Half sides of the object's bounds along its axes, metres.
    pub fn half_extents(&self) -> Vector3<f64> {
        self.prepared.half_extents()
    }
}

/// Index into [`FAILURES`].
fn code(kind: FailureKind) -> u8 {
    match kind {
        FailureKind::Infeasible => 1,
        FailureKind::NoContact => 2,
        FailureKind::Slipped => 3,
        FailureKind::Dropped => 4,
        FailureKind::Unstable => 5,
    }
}
