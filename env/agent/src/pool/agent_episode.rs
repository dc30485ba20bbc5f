//! One episode under an agent: actions in, reward terms and endings out.

use crate::AgentError;
use crate::actions::action::{OPEN_SHARE, actuator_commands, pose_and_preshape};
use crate::actions::arm_controller::ArmController;
use crate::actions::control::ClosedLoop;
use crate::actions::decision::{Decision, Outcome};
use crate::actions::workspace::{LOST_DISTANCE, LOST_HEIGHT};
use crate::objects::Prepared;
use crate::observations::view::View;
use crate::pool::clearing::Clearing;
use crate::pool::env_spec::EnvSpec;
use crate::pool::record::Record;
use crate::rewards::potentials::Potentials;
use crate::rewards::reward::{Attempt, TermValues, Transition, effort};
use crate::starts::initial_state::InitialState;
use graspbox_episode::{Episode, FailureKind, Judge};
use graspbox_mesh::least_width;
use graspbox_vision::visual_models::{object_color, object_label};
use graspbox_vision::{ObjectPose, ScenePose, Viewpoint};
use nalgebra::{Isometry3, Point3, Vector3};
use std::sync::Arc;

/// One episode under an agent.
pub struct AgentEpisode {
    episode: Episode,
    /// The objects of the scene, in its order.
    prepared: Vec<Arc<Prepared>>,
    arm: ArmController,
    record: Record,
}

/// An object of an episode's scene.
pub struct SceneObject<'a> {
    /// The object.
    pub prepared: &'a Prepared,
    /// Its place in the order of labels: the target is the first; in a scene that is cleared it is the order as the episode began.
    pub slot: usize,
    /// Its index in the set of objects.
    pub index: usize,
}

impl AgentEpisode {
    /// Begins an episode.
    ///
    /// * `initial`: from [`InitialState::sample`].
    pub fn new(initial: &InitialState, spec: &EnvSpec) -> Self {
        let factors = [initial.friction, initial.mass];
        let (hand, object) = (&initial.world_from_hand, &initial.world_from_object);
        let criterion = spec.config.success;
        let mut episode = Episode::reset_at(&initial.scene, hand, object, initial.preshape, factors, criterion);
        let first_center = episode.world().object_center();
        if let Some(height) = initial.dropped {
            episode.dropped(height);
        }
        let target = &initial.prepared[initial.scene.target()];
        let several = initial.clearing.is_some() || initial.target_scene.is_some();
        let width = match initial.dropped {
            None if !several => target.width(initial.resting),
            _ => least_width(target.body().mesh().vertices(), object),
        };
        let record = Record {
            object: initial.object,
            resting: initial.resting,
            dropped: initial.dropped.is_some(),
            fits: width <= spec.hand().widest(),
            friction: initial.friction,
            mass: initial.mass,
            first_center,
            last_action: vec![0.0; spec.action],
            preshape: initial.preshape,
            steps: 0,
            touched: false,
            lifting: false,
            success: false,
            failure: None,
            survives_shake: false,
            stopped: false,
            potentials: Potentials::of(&episode, target, &first_center),
            viewpoint: initial.viewpoint.clone(),
            clearing: initial.clearing.clone(),
            target_scene: initial.target_scene.clone(),
            waiting: *hand,
        };
        let arm = ArmController::new(hand, &initial.hand_error);
        Self::resume(episode, initial.prepared.clone(), arm, record)
    }

    /// An episode from a saved state.
    pub(crate) fn resume(episode: Episode, prepared: Vec<Arc<Prepared>>, arm: ArmController, record: Record) -> Self {
        Self { episode, prepared, arm, record }
    }

    pub(crate) fn record(&self) -> &Record {
        &self.record
    }

    /// Resets the parts of the info that cover all control periods of an action; call it before the first of them.
    pub(crate) fn begin_action(&mut self) {
        self.record.stopped = false;
    }

    /// Advances by one control period, or makes the decision. Returns the reward terms, and whether the episode ended by success or loss.
    ///
    /// * `action`: (n,), finite, with the columns of [`crate::Control::table`].
    ///
    /// # Errors
    /// [`AgentError::Episode`] for an actuator command that is not finite, which no finite action causes.
    pub fn step(&mut self, action: &[f32], spec: &EnvSpec) -> Result<(TermValues, bool), AgentError> {
        self.record.steps = self.record.steps.saturating_add(1);
        self.record.last_action.clear();
        self.record.last_action.extend(action.iter().map(|a| a.clamp(-1.0, 1.0)));
        match spec.config.control.closed_loop() {
            Some(mode) => {
                let transition = self.control_period(mode, action, spec)?;
                Ok((transition.terms(), transition.success || transition.lost))
            }
            None => Ok((self.decide(action, spec)?.terms(), self.is_over(spec))),
        }
    }

    fn control_period(&mut self, mode: ClosedLoop, action: &[f32], spec: &EnvSpec) -> Result<Transition, AgentError> {
        let motion = self.arm.begin(&mode.goal(action, self.arm.believed()));
        let (actuators, open) = (&action[spec.config.control.hand_size()..], self.hand_is_open());
        let commands = actuator_commands(spec.hand(), actuators, open, &mut self.record.preshape);
        let mut transition = Transition { before: self.record.potentials, ..Transition::default() };
        let dt = self.episode.world().dt();
        for i in 0..spec.substeps {
            let load = self.episode.world().hand_load();
            transition.table |= load.scenery;
            // Among others it may be another object that presses.
            self.record.touched |= load.object && (self.prepared.len() == 1 || self.touches());
            let time = f64::from(i) * dt;
            let hand = self.arm.advance(&motion, time, dt, &spec.guard, &load);
            transition.stop |= self.arm.stop.active;
            match self.episode.advance(&hand, &commands) {
                Ok(()) => self.watch_lift(),
                // The action is finite, so the world has diverged: tendon tensions are NaN.
                Err(_) if self.episode.world().has_diverged() => break,
                Err(error) => return Err(error.into()),
            }
            if self.episode.judge().success(self.episode.world()) {
                transition.success = true;
                break;
            }
        }
        let diverged = self.episode.world().has_diverged();
        transition.success &= !diverged;
        transition.secure = transition.success && self.episode.verdict().secure;
        transition.lost = !transition.success && (diverged || self.lost());
        transition.effort = effort(&self.arm, self.episode.world());
        self.record.success = transition.success;
        self.record.stopped |= transition.stop;
        self.record.touched |= self.touches();
        transition.after = Potentials::of(&self.episode, self.prepared(), &self.record.first_center);
        self.record.potentials = transition.after;
        Ok(transition)
    }

    /// True after a decision that ends the episode: every one, unless something remains to be cleared.
    fn is_over(&self, spec: &EnvSpec) -> bool {
        self.record.clearing.as_ref().is_none_or(|clearing| clearing.over(spec.config.clutter.max_failures))
    }

    /// Moves the hand to the pose of `action` and tries the grasp.
    fn decide(&mut self, action: &[f32], spec: &EnvSpec) -> Result<Attempt, AgentError> {
        self.record.failure = Some(FailureKind::Infeasible);
        self.record.success = false;
        let Some((believed, preshape)) = pose_and_preshape(action, spec.hand()) else {
            self.record.clearing.iter_mut().for_each(Clearing::nothing_moved);
            return Ok(Attempt { infeasible: true, ..Attempt::default() });
        };
        let hand = self.arm.teleport(&believed);
        let decision = Decision {
            spec,
            prepared: &self.prepared,
            factors: [self.record.friction, self.record.mass],
            world_from_object: self.episode.world().world_from_object(),
        };
        let outcome = decision.attempt(&self.episode, &hand, preshape)?;
        self.record.success = outcome.attempt.success;
        self.record.failure = outcome.failure;
        self.record.survives_shake = outcome.survives_shake;
        self.record.touched = outcome.touched;
        self.record.potentials = outcome.attempt.potentials;
        let attempt = outcome.attempt;
        if self.record.clearing.is_some() {
            self.take_away(outcome, spec)?;
        } else {
            self.episode = outcome.episode;
            self.arm.sync(&self.episode.world().world_from_hand());
        }
        Ok(attempt)
    }

    /// Takes the objects in the hand away after an attempt on a scene of several objects; the hand waits again while others remain.
    fn take_away(&mut self, outcome: Outcome, spec: &EnvSpec) -> Result<(), AgentError> {
        let Some(clearing) = &mut self.record.clearing else { return Ok(()) };
        let (waiting, factors) = (&self.record.waiting, [self.record.friction, self.record.mass]);
        if !outcome.moved {
            clearing.nothing_moved();
            self.arm.sync(waiting);
            return Ok(());
        }
        self.record.object = clearing.objects[outcome.episode.world().target()].object;
        let Some((scene, prepared)) = clearing.attempted(&outcome, &self.prepared, factors, spec)? else {
            self.episode = outcome.episode;
            self.arm.sync(&self.episode.world().world_from_hand());
            return Ok(());
        };
        let object = scene.world_from_object();
        let criterion = spec.config.success;
        self.episode = Episode::reset_at(&scene, waiting, object, self.record.preshape, factors, criterion);
        self.record.first_center = self.episode.world().object_center();
        self.prepared = prepared;
        self.arm.sync(waiting);
        Ok(())
    }

    /// True while no actuator has closed so far that the preshape must not change.
    fn hand_is_open(&self) -> bool {
        let world = self.episode.world();
        let hand = world.hand();
        hand.grasp_actuators().all(|index| {
            let [open, closed] = hand.actuators[index].travel;
            world.actuators()[index].position <= open + OPEN_SHARE * (closed - open)
        })
    }

    /// Tells the judge that lifting begins, when the object first leaves the table while the hand touches it.
    fn watch_lift(&mut self) {
        if !self.record.lifting && !self.episode.judge().on_scenery() && self.touches() {
            self.record.lifting = true;
            self.record.touched = true;
            self.episode.begin_lift();
        }
    }

    fn touches(&self) -> bool {
        !self.episode.world().contacts().links.is_empty()
    }

    /// True if the object is off the table or out of the workspace.
    fn lost(&self) -> bool {
        let center = self.episode.world().object_center();
        center.z < LOST_HEIGHT || center.coords.xy().norm() > LOST_DISTANCE
    }

    /// The view from which observations and infos are read.
    pub fn view<'a>(&'a self, spec: &'a EnvSpec) -> View<'a> {
        View::new(&self.episode, self.prepared(), &self.arm, &self.record, &spec.flags)
    }

    /// The objects of the scene, in its order.
    pub fn objects(&self) -> impl ExactSizeIterator<Item = SceneObject<'_>> {
        let placed = self.record.placed();
        self.prepared.iter().enumerate().map(move |(place, prepared)| {
            let (slot, index) =
                placed.map_or((place, self.record.object), |all| (all[place].slot as usize, all[place].object));
            SceneObject { prepared, slot, index }
        })
    }

    /// The state machine.
    pub fn episode(&self) -> &Episode {
        &self.episode
    }

    /// The object.
    pub fn prepared(&self) -> &Arc<Prepared> {
        &self.prepared[self.episode.world().target()]
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

    /// Potentials of the reward's shaping terms.
    pub fn potentials(&self) -> &Potentials {
        &self.record.potentials
    }

    /// Cameras and light.
    pub fn viewpoint(&self) -> &Viewpoint {
        &self.record.viewpoint
    }

    /// Present poses of all bodies, for rendering.
    ///
    /// # Errors
    /// [`AgentError::NotRenderable`] for a mesh that cannot be rendered.
    pub fn scene_pose<'a>(&'a self, spec: &'a EnvSpec) -> Result<ScenePose<'a>, AgentError> {
        let (world, links) = (self.episode.world(), spec.hand().links.len());
        let object = |(object, pose): (SceneObject<'a>, Isometry3<f64>)| {
            Ok(ObjectPose {
                model: object.prepared.model()?,
                color: object_color(object.prepared.body().name()),
                label: object_label(object.slot, links),
                world_from_object: pose,
            })
        };
        let objects = self.objects().zip(world.world_from_objects()).map(object);
        Ok(ScenePose::of(world, objects.collect::<Result<_, AgentError>>()?, &spec.wall_models))
    }

    /// Centre of mass of the object when the episode began, world, metres.
    pub fn first_center(&self) -> &Point3<f64> {
        &self.record.first_center
    }

    /// Middle of the object's bounds, object frame, metres.
    pub fn bounds_center(&self) -> Point3<f64> {
        self.prepared().bounds_center()
    }

    /// Half sides of the object's bounds along its axes, metres.
    pub fn half_extents(&self) -> Vector3<f64> {
        self.prepared().half_extents()
    }
}
