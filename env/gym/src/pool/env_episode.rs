//! One episode: actions in, reward terms and endings out.

use crate::EnvError;
use crate::actions::arm_controller::ArmController;
use crate::objects::Prepared;
use crate::observations::view::View;
use crate::pool::env_spec::EnvSpec;
use crate::pool::episode_body::EpisodeBody;
use crate::rewards::goal_terms::goal_terms;
use crate::rewards::potentials::Potentials;
use crate::rewards::reward::TermValues;
use crate::scenery::MARKER_COLOR;
use crate::starts::initial_state::InitialState;
use crate::state::{Mode, Record};
use graspbox_episode::{Episode, Judge};
use graspbox_mesh::least_width;
use graspbox_render::labels::{object_color, object_label};
use graspbox_render::{ObjectPose, ScenePose, Viewpoint};
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use std::sync::Arc;

/// One episode of an environment: the parts that every mode has, and its mode.
pub struct EnvEpisode {
    body: EpisodeBody,
    mode: Mode,
}

/// An object of an episode's scene.
pub struct SceneObject<'a> {
    pub prepared: &'a Prepared,
    /// Its place in the order of labels: the target is the first; in a scene that is cleared it is the order as the episode began.
    pub slot: usize,
    /// Its index in the set of objects.
    pub index: usize,
}

impl EnvEpisode {
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
        let width = match initial.mode.resting() {
            Some(resting) => target.width(resting),
            None => least_width(target.body().mesh().vertices(), object),
        };
        let record = Record {
            object: initial.object,
            fits: width <= spec.hand().widest(),
            friction: initial.friction,
            mass: initial.mass,
            first_center,
            last_action: vec![0.0; spec.action],
            preshape: initial.preshape,
            steps: 0,
            touched: false,
            success: false,
            goal: initial.goal,
            potentials: Potentials::of(&episode, target, &first_center),
            viewpoint: initial.viewpoint.clone(),
        };
        let mut arm = ArmController::new(hand, &initial.hand_error);
        if let (Some(positions), Some(spec)) = (&initial.joints, &spec.arm) {
            arm = arm.on_arm(positions);
            episode.place_arm(&initial.hand_error, &positions[..spec.follower.chain().len()]);
        }
        if initial.dropped.is_none() {
            episode.expect_rest();
        }
        let mut body = EpisodeBody { episode, prepared: initial.prepared.clone(), arm, record };
        body.record.success = spec.config.goal.is_some_and(|goal| body.reached(&goal));
        Self::resume(body, initial.mode.clone())
    }

    /// An episode from a saved state.
    pub(crate) fn resume(body: EpisodeBody, mode: Mode) -> Self {
        Self { body, mode }
    }

    pub(crate) fn record(&self) -> &Record {
        &self.body.record
    }

    pub(crate) fn mode(&self) -> &Mode {
        &self.mode
    }

    /// Resets the parts of the info that cover all control periods of an action; call it before the first of them.
    pub(crate) fn begin_action(&mut self) {
        if let Mode::Grasp(state) = &mut self.mode {
            state.stopped = false;
        }
        self.body.arm.unblock();
    }

    /// Advances by one control period, or makes the decision. Returns the reward terms, and whether the episode ended by success or loss.
    ///
    /// * `action`: (n,), finite, with the columns of [`crate::ActionSpec::table`].
    ///
    /// # Errors
    /// [`EnvError::Episode`] for an actuator command that is not finite, which no finite action causes.
    pub fn step(&mut self, action: &[f32], spec: &EnvSpec) -> Result<(TermValues, bool), EnvError> {
        let body = &mut self.body;
        body.record.steps = body.record.steps.saturating_add(1);
        body.record.last_action.clear();
        body.record.last_action.extend(action.iter().map(|a| a.clamp(-1.0, 1.0)));
        Ok(match &mut self.mode {
            Mode::Grasp(state) => {
                let transition = state.step(body, action, spec)?;
                (transition.terms(), transition.success || transition.lost)
            }
            Mode::GraspPose(state) => (state.step(body, action, spec)?.terms(), true),
            Mode::Clear(state) => {
                let attempt = state.step(body, action, spec)?;
                (attempt.terms(), state.over(spec.config.clutter.max_failures))
            }
        })
    }

    /// The reward terms of the present state, in environments with goals.
    pub(crate) fn goal_terms(&self, spec: &EnvSpec) -> Option<TermValues> {
        let (config, goal) = (spec.config.goal?, self.body.record.goal?);
        Some(goal_terms(&goal.achieved(self.body.episode.world()), &goal.desired, config.threshold))
    }

    /// The view from which observations and infos are read.
    pub fn view<'a>(&'a self, spec: &'a EnvSpec) -> View<'a> {
        View::new(&self.body.episode, self.body.target(), &self.body.arm, &self.body.record, &self.mode, &spec.flags)
    }

    /// The objects of the scene, in its order.
    pub fn objects(&self) -> impl ExactSizeIterator<Item = SceneObject<'_>> {
        let placed = self.mode.placed();
        self.body.prepared.iter().enumerate().map(move |(place, prepared)| {
            let (slot, index) =
                placed.map_or((place, self.body.record.object), |all| (all[place].slot as usize, all[place].object));
            SceneObject { prepared, slot, index }
        })
    }

    /// The state machine.
    pub fn episode(&self) -> &Episode {
        &self.body.episode
    }

    pub fn prepared(&self) -> &Arc<Prepared> {
        self.body.target()
    }

    pub fn judge(&self) -> &Judge {
        self.body.episode.judge()
    }

    pub fn arm(&self) -> &ArmController {
        &self.body.arm
    }

    /// The last action, clipped; zeros before the first.
    pub fn last_action(&self) -> &[f32] {
        &self.body.record.last_action
    }

    /// Control periods since the episode began.
    pub fn steps(&self) -> u32 {
        self.body.record.steps
    }

    /// Potentials of the reward's shaping terms.
    pub fn potentials(&self) -> &Potentials {
        &self.body.record.potentials
    }

    /// Cameras and light.
    pub fn viewpoint(&self) -> &Viewpoint {
        &self.body.record.viewpoint
    }

    /// Present poses of all bodies, for rendering.
    ///
    /// # Errors
    /// [`EnvError::NotRenderable`] for a mesh that cannot be rendered.
    pub fn scene_pose<'a>(&'a self, spec: &'a EnvSpec) -> Result<ScenePose<'a>, EnvError> {
        let (world, links) = (self.body.episode.world(), spec.hand().links.len());
        let object = |(object, pose): (SceneObject<'a>, Isometry3<f64>)| {
            Ok(ObjectPose {
                model: object.prepared.model()?,
                color: object_color(object.prepared.body().name()),
                label: object_label(object.slot, links),
                world_from_object: pose,
            })
        };
        let objects = self.objects().zip(world.world_from_objects()).map(object);
        let mut objects = objects.collect::<Result<Vec<_>, EnvError>>()?;
        objects.extend(spec.arm.iter().flat_map(|arm| arm.posed(self.body.arm.joints().0, spec)));
        let world_from_hand = world.world_from_hand();
        // Without finite kinematics, in a simulation that diverged, the hand is left out.
        let links = world.hand().hand_from_links(&world.configuration()).unwrap_or_default();
        let world_from_links = links.into_iter().map(|link| world_from_hand * link).collect();
        Ok(ScenePose { objects, fixed: &spec.fixed_boxes, world_from_hand, world_from_links })
    }

    /// As [`EnvEpisode::scene_pose`], with a marker at the goal, which no observation sees.
    ///
    /// # Errors
    /// As [`EnvEpisode::scene_pose`].
    pub fn pictured<'a>(&'a self, spec: &'a EnvSpec) -> Result<ScenePose<'a>, EnvError> {
        let mut scene = self.scene_pose(spec)?;
        let marker = spec.goal_marker.as_ref().zip(self.body.record.goal);
        scene.objects.extend(marker.map(|(model, goal)| ObjectPose {
            model,
            color: MARKER_COLOR,
            label: 0,
            world_from_object: Translation3::from(goal.desired.map(f64::from)).into(),
        }));
        Ok(scene)
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
