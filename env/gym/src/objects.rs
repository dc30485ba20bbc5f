//! Objects, prepared in the background or at first use, and shared by all environments that sample from them.
//!
//! Preparing an object (reading, convex parts, mass), settling it in a resting pose and computing its levels of detail take up to a second. The
//! result depends only on the object; it is cached, and its removal costs time but never changes a result. No lock is held while an object is
//! prepared: threads that need the same one at the same time both prepare it, and the first result is kept. Objects and scenes of an
//! environment's next episodes are prepared in the background ([`crate::ahead`]).

use crate::EnvError;
use crate::ahead::{Ahead, Claim, Work};
use crate::source::Source;
use graspbox_episode::EpisodeError;
use graspbox_episode::{Body, ObjectSpec, Scene};
use graspbox_hand::Hand;
use graspbox_mesh::{RestingOptions, TriMesh, convex_hull, least_width, resting_poses};
use graspbox_render::{HandModel, Model};
use graspbox_sim::PhysicsConfig;
use nalgebra::{Isometry3, Point3};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Most objects in the cache, of 1 to 4 MB each with their resting poses. Larger sets prepare objects again in many resets.
const KEPT: usize = 512;
/// Least probability of a resting pose; if none reaches it, the most probable one is kept.
const LEAST_PROBABILITY: f64 = 0.05;
/// Most resting poses of an object: the most probable ones are kept.
const MOST_POSES: usize = 6;

/// Choice of a resting pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RestingChoice {
    /// The pose at this share of the cumulative probability, in [0, 1).
    Share(f64),
    /// The pose with this index.
    Index(usize),
}

/// The preparation that an episode needs of its object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Need {
    pub object: usize,
    /// Its resting pose; `None` for an object of a layout.
    pub resting: Option<RestingChoice>,
    /// Its render model is needed too.
    pub model: bool,
}

/// A prepared object with its resting poses.
pub struct Prepared {
    body: Body,
    resting_poses: Vec<RestingPose>,
    /// Middle and half extents of the bounds along the object's axes, metres.
    bounds: [Point3<f64>; 2],
    /// Its render model, built at first use.
    model: OnceLock<Model>,
    /// The object of which this is a scaled copy, and the scale.
    original: Option<(Arc<Prepared>, f64)>,
    /// Cache folder of convex parts and levels of detail.
    cache: Option<PathBuf>,
}

/// One resting pose on the table; settled at its first use.
struct RestingPose {
    world_from_object: Isometry3<f64>,
    probability: f64,
    /// Least width in plan view, metres.
    width: f64,
    /// `None` inside if the object does not come to rest.
    scene: OnceLock<Option<Arc<Scene>>>,
}

impl Prepared {
    /// Prepares an object; convex parts and levels of detail are cached in the folder `cache`, if there is one.
    ///
    /// # Errors
    /// As [`Body::prepare`], or a mesh without a resting pose.
    pub(crate) fn new(spec: &ObjectSpec, cache: Option<&Path>) -> Result<Self, EnvError> {
        let body = Body::prepare(spec, cache)?;
        let mesh_error = |source| EpisodeError::Mesh { object: spec.name.clone(), source };
        let hull: TriMesh = convex_hull(body.mesh().vertices()).map_err(mesh_error)?;
        let center = body.mass_properties().center_of_mass;
        let poses = resting_poses(&hull, &center, &RestingOptions::default()).map_err(mesh_error)?;
        let likely = poses.iter().take_while(|p| p.probability >= LEAST_PROBABILITY).count();
        let resting_poses = poses.iter().take(likely.clamp(1, MOST_POSES)).map(|pose| RestingPose {
            world_from_object: pose.world_from_object,
            probability: pose.probability,
            width: least_width(hull.vertices(), &pose.world_from_object),
            scene: OnceLock::new(),
        });
        let aabb = body.mesh().aabb();
        Ok(Self {
            resting_poses: resting_poses.collect(),
            bounds: [nalgebra::center(&aabb.min, &aabb.max), Point3::from((aabb.max - aabb.min) / 2.0)],
            body,
            model: OnceLock::new(),
            original: None,
            cache: cache.map(Path::to_path_buf),
        })
    }

    /// The object with every length times `scale`, for layouts: it has no resting poses.
    ///
    /// # Errors
    /// As [`Body::scaled`].
    pub(crate) fn scaled(self: &Arc<Self>, scale: f64) -> Result<Self, EnvError> {
        Ok(Self {
            body: self.body.scaled(scale)?,
            resting_poses: Vec::new(),
            bounds: self.bounds.map(|point| point * scale),
            model: OnceLock::new(),
            original: Some((Arc::clone(self), scale)),
            cache: None,
        })
    }

    /// The object.
    pub fn body(&self) -> &Body {
        &self.body
    }

    /// The object's render model, built at first use.
    ///
    /// # Errors
    /// [`EnvError::NotRenderable`].
    pub fn model(&self) -> Result<&Model, EnvError> {
        if let Some(model) = self.model.get() {
            return Ok(model);
        }
        let made = match &self.original {
            Some((original, scale)) => original.model()?.scaled(*scale),
            None => Model::cached(self.body.mesh(), self.cache.as_deref())
                .map_err(|source| EnvError::NotRenderable { object: self.body.name().to_owned(), source })?,
        };
        Ok(self.model.get_or_init(|| made))
    }

    /// Probabilities of the resting poses, in order.
    pub fn probabilities(&self) -> impl ExactSizeIterator<Item = f64> + Clone {
        self.resting_poses.iter().map(|resting| resting.probability)
    }

    /// Least width of the object in plan view in a resting pose, by index, metres.
    pub fn width(&self, resting: usize) -> f64 {
        self.resting_poses[resting].width
    }

    /// Index of the chosen resting pose.
    pub fn resting(&self, choice: RestingChoice) -> usize {
        match choice {
            RestingChoice::Share(share) => weighted(share, self.probabilities()),
            RestingChoice::Index(index) => index,
        }
    }

    /// Middle of the bounds along the object's axes, object frame, metres.
    pub fn bounds_center(&self) -> Point3<f64> {
        self.bounds[0]
    }

    /// Half extents of the bounds along the object's axes, metres.
    pub fn half_extents(&self) -> nalgebra::Vector3<f64> {
        self.bounds[1].coords
    }
}

/// A list of objects, a hand and physics settings, with the objects prepared so far.
pub struct Objects {
    sources: Vec<Source>,
    hand: Arc<Hand>,
    physics: PhysicsConfig,
    cache: Option<PathBuf>,
    hand_model: Arc<OnceLock<HandModel>>,
    prepared: Mutex<Cache>,
    ahead: Ahead,
}

#[derive(Default)]
struct Cache {
    /// Time of last use of each object, and the object.
    kept: BTreeMap<usize, (u64, Arc<Prepared>)>,
    clock: u64,
}

impl Objects {
    /// A set of objects; convex parts, levels of detail and scenes at rest are cached in the folder `cache`, if there is one.
    ///
    /// # Errors
    /// [`EnvError::NoObjects`] for an empty list.
    pub fn new(
        sources: Vec<Source>,
        hand: Arc<Hand>,
        physics: PhysicsConfig,
        cache: Option<PathBuf>,
    ) -> Result<Self, EnvError> {
        if sources.is_empty() {
            return Err(EnvError::NoObjects);
        }
        Ok(Self {
            sources,
            hand,
            physics,
            cache,
            hand_model: Arc::default(),
            prepared: Mutex::default(),
            ahead: Ahead::default(),
        })
    }

    /// Number of objects.
    pub fn len(&self) -> usize {
        self.sources.len()
    }

    /// Never true: an empty list is refused.
    pub fn is_empty(&self) -> bool {
        self.sources.is_empty()
    }

    /// Names of the objects, in order.
    pub fn names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.sources.iter().map(Source::name)
    }

    /// Source of object `index`.
    pub fn source(&self, index: usize) -> Option<&Source> {
        self.sources.get(index)
    }

    /// The hand of every scene.
    pub fn hand(&self) -> &Arc<Hand> {
        &self.hand
    }

    /// The render model of the hand, built at first use.
    pub fn hand_model(&self) -> Arc<OnceLock<HandModel>> {
        Arc::clone(&self.hand_model)
    }

    /// The physics of every scene.
    pub fn physics(&self) -> &PhysicsConfig {
        &self.physics
    }

    /// Cache folder of convex parts, levels of detail and scenes at rest.
    pub fn cache(&self) -> Option<&Path> {
        self.cache.as_deref()
    }

    /// Object `index`, prepared now if it was not.
    ///
    /// # Errors
    /// An index that does not exist, a file that cannot be read, or an object that cannot be simulated.
    pub fn prepared(&self, index: usize) -> Result<Arc<Prepared>, EnvError> {
        if let Some(found) = self.cache_lock().take(index) {
            return Ok(found);
        }
        let source = self.sources.get(index).ok_or(EnvError::NoSuchObject { index, count: self.sources.len() })?;
        let make = || Prepared::new(&source.read()?, self.cache.as_deref());
        let made = Arc::new(make().map_err(|error| source.in_file(error))?);
        if let Some(caveat) = made.body.mass_properties().method.caveat() {
            tracing::warn!("{source}: {caveat}");
        }
        Ok(self.cache_lock().keep(index, made))
    }

    /// Prepares the needs of an episode, unless they are ready; waits if the background thread is preparing them.
    ///
    /// # Errors
    /// As [`Objects::prepared`]. Other errors of the object occur when it is used.
    pub fn ensure(&self, need: &Need) -> Result<(), EnvError> {
        if self.is_ready(need) {
            return Ok(());
        }
        let _claim = self.ahead.claim(Work::Object(need.object));
        self.make(need)
    }

    /// Prepares the needs of a later episode in the background, unless they are ready.
    pub fn ensure_ahead(self: &Arc<Self>, need: Need) {
        if self.is_ready(&need) {
            return;
        }
        let objects = Arc::downgrade(self);
        self.ahead.spawn(Work::Object(need.object), move || {
            if let Some(objects) = objects.upgrade() {
                // An error occurs again, and is reported, in the episode that uses the object.
                drop(objects.make(&need));
            }
        });
    }

    /// Queues work of the background thread.
    pub(crate) fn spawn_ahead(&self, work: Work, job: impl FnOnce() + Send + 'static) {
        self.ahead.spawn(work, job);
    }

    /// Claims work for the calling thread; waits while the background thread does it.
    pub(crate) fn claim(&self, work: Work) -> Claim<'_> {
        self.ahead.claim(work)
    }

    /// Prepares an object for all episodes: all its resting poses, and its render model if `model`.
    ///
    /// # Errors
    /// As [`Objects::prepared`], [`Objects::scene`] and [`Prepared::model`].
    pub fn prepare(&self, index: usize, model: bool) -> Result<(), EnvError> {
        let _claim = self.ahead.claim(Work::Object(index));
        let prepared = self.prepared(index)?;
        for resting in 0..prepared.resting_poses.len() {
            self.scene(&prepared, resting)?;
        }
        if model {
            prepared.model()?;
        }
        Ok(())
    }

    /// True if everything that an episode needs is ready.
    pub fn is_ready(&self, need: &Need) -> bool {
        let Some(prepared) = self.cache_lock().take(need.object) else { return false };
        let resting = need.resting.and_then(|choice| prepared.resting_poses.get(prepared.resting(choice)));
        resting.is_none_or(|pose| pose.scene.get().is_some()) && (!need.model || prepared.model.get().is_some())
    }

    fn make(&self, need: &Need) -> Result<(), EnvError> {
        let prepared = self.prepared(need.object)?;
        let resting = need.resting.map(|choice| prepared.resting(choice));
        if let Some(resting) = resting.filter(|resting| *resting < prepared.resting_poses.len()) {
            drop(self.scene(&prepared, resting));
        }
        if need.model {
            drop(prepared.model());
        }
        Ok(())
    }

    /// The object at rest in pose `resting`, or in the next pose in which it comes to rest; and the index of that pose.
    ///
    /// # Errors
    /// [`EpisodeError::NoRest`] if none does.
    pub fn scene(&self, object: &Prepared, resting: usize) -> Result<(usize, Arc<Scene>), EnvError> {
        let count = object.resting_poses.len();
        for i in (0..count).map(|i| (resting + i) % count) {
            let found = &object.resting_poses[i];
            let scene = match found.scene.get() {
                Some(scene) => scene,
                None => {
                    let made =
                        Scene::new(&object.body, Arc::clone(&self.hand), self.physics, Some(&found.world_from_object));
                    let made = match made {
                        Ok(scene) => Some(Arc::new(scene)),
                        Err(EpisodeError::NoRest { .. }) => None,
                        Err(error) => return Err(error.into()),
                    };
                    found.scene.get_or_init(|| made)
                }
            };
            if let Some(scene) = scene {
                return Ok((i, Arc::clone(scene)));
            }
        }
        Err(EpisodeError::NoRest {
            object: object.body.name().to_owned(),
            why: "it leaves the table from every resting pose",
        }
        .into())
    }

    fn cache_lock(&self) -> std::sync::MutexGuard<'_, Cache> {
        // A poisoned lock is harmless: no change inside it is partial.
        self.prepared.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The index at `share` of the cumulative weights.
fn weighted(share: f64, weights: impl ExactSizeIterator<Item = f64> + Clone) -> usize {
    let last = weights.len().saturating_sub(1);
    let mut left = share * weights.clone().sum::<f64>();
    for (index, weight) in weights.enumerate() {
        if left < weight {
            return index;
        }
        left -= weight;
    }
    last
}

impl Cache {
    fn take(&mut self, index: usize) -> Option<Arc<Prepared>> {
        self.clock += 1;
        let (used, object) = self.kept.get_mut(&index)?;
        *used = self.clock;
        Some(Arc::clone(object))
    }

    /// Stores `made`, unless another thread was faster, and evicts old objects.
    fn keep(&mut self, index: usize, made: Arc<Prepared>) -> Arc<Prepared> {
        self.clock += 1;
        let kept = Arc::clone(&self.kept.entry(index).or_insert((self.clock, made)).1);
        while self.kept.len() > KEPT {
            let oldest = self.kept.iter().min_by_key(|(_, (used, _))| *used).map(|(i, _)| *i);
            if let Some(oldest) = oldest {
                self.kept.remove(&oldest);
            }
        }
        kept
    }
}
