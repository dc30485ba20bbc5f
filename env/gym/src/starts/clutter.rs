//! The start of an episode among several objects: all of them are to be cleared, or one is the target.
//!
//! Sampled: the number of objects, uniformly within `objects_per_scene`; the objects, uniformly, any of them more than once, and as many as the
//! layout has attempts ([`Layout::draws`]); a scale of each, uniformly within `scale`; the seed of the layout; and the target, uniformly among the
//! objects that lie in the scene. All of it comes from a stream of its own, whose seed is that of cameras and light, so that it changes no other
//! sample of an initial state.

use crate::EnvError;
use crate::config::ClutterConfig;
use crate::objects::{Need, Objects, Prepared};
use crate::pool::env_spec::EnvSpec;
use crate::starts::initial_samples::InitialSamples;
use crate::starts::random_stream::RandomStream;
use crate::starts::reset_options::{ResetOptions, bad_option};
use crate::state::{Placed, TargetScene};
use graspbox_episode::{Body, Draw, EpisodeError, Layout, Scene};
use std::sync::Arc;

/// Attempts to make a scene in which at least one object stays in the workspace.
const ATTEMPTS: u64 = 8;
/// Distinguishes the stream of the scene from that of cameras and light.
const STREAM: u64 = 0x636c_7574_7465_7221;

/// A scene, and its objects in its order.
pub type SceneObjects = (Arc<Scene>, Vec<Arc<Prepared>>);

/// Objects at rest, and where they lie, in the same order.
pub type AtRest = (Vec<Arc<Prepared>>, Vec<Placed>);

/// The random numbers of a scene.
#[derive(Clone, Debug, PartialEq)]
pub struct ClutterSamples {
    /// Index and scale of each object that is drawn.
    pub objects: Vec<(usize, f64)>,
    /// Number of objects wanted.
    pub wanted: usize,
    /// Distance of the objects from the middle ([`Draw::spread`]).
    pub spread: f64,
    /// Seed of the layout.
    pub seed: u64,
    /// Uniform in [0, 1): the target among the objects that lie in the scene.
    pub target: f64,
}

impl ClutterSamples {
    /// Samples a scene of `layout` from a set of `count` objects.
    pub fn new(config: &ClutterConfig, layout: &Layout, samples: &InitialSamples, count: usize) -> Self {
        let mut stream = RandomStream::new(samples.viewpoint ^ STREAM);
        let [low, high] = config.objects_per_scene;
        let wanted = low + stream.sample_index(high - low + 1);
        let draw = |_| (stream.sample_index(count), stream.sample_range(config.scale[0], config.scale[1]));
        let objects = (0..layout.draws(wanted)).map(draw).collect();
        Self { objects, wanted, spread: config.spread, seed: stream.sample_seed(), target: stream.sample_unit() }
    }

    /// The preparation that the scene needs of its objects.
    pub fn needs(&self, model: bool) -> Vec<Need> {
        self.objects.iter().map(|(object, _)| Need { object: *object, resting: None, model }).collect()
    }

    /// The objects at rest, as many as stay in the workspace.
    ///
    /// # Errors
    /// An error of an object that cannot be prepared, or [`EpisodeError::NoRest`] if no object ever stays in the workspace.
    pub fn at_rest(&self, layout: &Layout, objects: &Objects) -> Result<AtRest, EnvError> {
        let all = self.objects.iter().map(|(object, scale)| scaled(objects, *object, *scale));
        let all = all.collect::<Result<Vec<_>, _>>()?;
        let bodies: Vec<&Body> = all.iter().map(|prepared| prepared.body()).collect();
        for attempt in 0..ATTEMPTS {
            let seed = self.seed.wrapping_add(attempt);
            let draw = Draw { most: Some(self.wanted), spread: self.spread, seed };
            let found = layout.arrange(&bodies, &draw, objects.hand(), *objects.physics(), objects.cache())?;
            if found.objects.is_empty() {
                continue;
            }
            let placed = found.objects.iter().zip(&found.world_from_objects).enumerate();
            let placed = placed.map(|(slot, (index, pose))| {
                let (object, scale) = self.objects[*index];
                Placed { slot: slot as u32, object, scale, world_from_object: *pose }
            });
            return Ok((found.objects.iter().map(|index| Arc::clone(&all[*index])).collect(), placed.collect()));
        }
        let object = bodies.iter().map(|body| body.name()).collect::<Vec<_>>().join(", ");
        Err(EpisodeError::NoRest { object, why: "none of them stays in the workspace" }.into())
    }

    /// The target among objects at rest.
    pub fn target_among(&self, objects: Vec<Placed>) -> TargetScene {
        TargetScene::new(objects, self.target)
    }
}

/// An object at a scale.
///
/// # Errors
/// As [`Objects::prepared`], or an object that is too small to simulate at this scale.
pub fn scaled(objects: &Objects, object: usize, scale: f64) -> Result<Arc<Prepared>, EnvError> {
    let prepared = objects.prepared(object)?;
    if scale == 1.0 { Ok(prepared) } else { Ok(Arc::new(prepared.scaled(scale)?)) }
}

/// The scene of objects at rest.
///
/// * `target`: index of the target; `None`: any of them may be grasped.
///
/// # Errors
/// As [`Scene::of_objects`].
pub fn scene_of(
    spec: &EnvSpec,
    prepared: &[Arc<Prepared>],
    placed: &[Placed],
    target: Option<usize>,
) -> Result<Arc<Scene>, EnvError> {
    let bodies: Vec<&Body> = prepared.iter().map(|prepared| prepared.body()).collect();
    let poses: Vec<_> = placed.iter().map(|placed| placed.world_from_object).collect();
    let (walls, hand, physics) = (spec.config.clutter.walls()?, Arc::clone(spec.hand()), *spec.objects.physics());
    Ok(Arc::new(Scene::of_objects(&bodies, &poses, &walls, target, hand, physics)?))
}

/// Refuses options of a single object.
///
/// # Errors
/// [`EnvError::BadOption`].
pub fn check_options(options: &ResetOptions) -> Result<(), EnvError> {
    let single = [
        ("object", options.object.is_some()),
        ("resting", options.resting.is_some()),
        ("place", options.place.is_some()),
        ("world_from_object", options.world_from_object.is_some()),
    ];
    match single.into_iter().find(|(_, set)| *set) {
        Some((option, _)) => Err(bad_option(option, "a scene of several objects is sampled as a whole; give a seed")),
        None => Ok(()),
    }
}
