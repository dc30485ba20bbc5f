//! Objects, prepared in the background or at first use, and shared by all environments that sample from them.
//!
//! Preparing an object (reading, convex parts, mass), settling it in a resting pose and computing its levels of detail take up to a second. The
//! result depends only on the object; it is cached in memory and on disk, and its removal costs time but never changes a result. No lock is held while an object is
//! prepared: threads that need the same one at the same time both prepare it, and the first result is kept. Objects and scenes of an
//! environment's next episodes are prepared in the background ([`crate::ahead`]).

mod prepared;
mod stored;

pub use prepared::Prepared;

use crate::EnvError;
use crate::ahead::{Ahead, Claim, Work};
use crate::robot_arm::RobotArm;
use crate::source::Source;
use graspbox_episode::{EpisodeError, Scene};
use graspbox_hand::{Arm, Hand};
use graspbox_render::HandModel;
use graspbox_sim::PhysicsConfig;
use nalgebra::Isometry3;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use stored::Identified;

/// Most objects in memory, of about 1 MB each, and 2 MB more with their render models. Larger sets read objects again in many resets.
const KEPT: usize = 512;

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

/// A list of objects, a hand and physics settings, with the objects prepared so far.
pub struct Objects {
    sources: Vec<Source>,
    hand: Arc<Hand>,
    /// What carries the hand.
    arm: Option<Arc<RobotArm>>,
    physics: PhysicsConfig,
    cache: Option<PathBuf>,
    hand_model: Arc<OnceLock<HandModel>>,
    /// Hand and physics as text.
    users: OnceLock<String>,
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
            arm: None,
            physics,
            cache,
            hand_model: Arc::default(),
            users: OnceLock::new(),
            prepared: Mutex::default(),
            ahead: Ahead::default(),
        })
    }

    /// The same with the hand on an arm.
    ///
    /// * `world_from_base`: pose of the arm's base; by default behind the table's middle.
    ///
    /// # Errors
    /// As [`RobotArm::new`], and for a base farther than 10 m.
    pub fn on_arm(self, arm: Arc<Arm>, world_from_base: Option<Isometry3<f64>>) -> Result<Self, EnvError> {
        let (robot, hand) = RobotArm::new(arm, &self.hand, world_from_base)?;
        Ok(Self { hand, arm: Some(Arc::new(robot)), ..self })
    }

    /// What carries the hand of every scene.
    pub fn arm(&self) -> Option<&Arc<RobotArm>> {
        self.arm.as_ref()
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
        let make = || Prepared::of(&Identified::of(source, self.cache.as_deref())?);
        let made = Arc::new(make().map_err(|error| source.in_file(error))?);
        if let Some(caveat) = made.body().mass_properties().method.caveat() {
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

    /// Prepares an object for all episodes: all its resting poses, and its render model if `model`. What is on disk already stays there.
    ///
    /// # Errors
    /// As [`Objects::prepared`], [`Objects::scene`] and [`Prepared::model`].
    pub fn prepare(&self, index: usize, model: bool) -> Result<(), EnvError> {
        let source = self.sources.get(index).ok_or(EnvError::NoSuchObject { index, count: self.sources.len() })?;
        let known = Identified::of(source, self.cache.as_deref()).map_err(|error| source.in_file(error))?;
        let users = self.users.get_or_init(|| format!("{} {:?}", self.hand.content(), self.physics));
        let users = format!("{model} {users}");
        if known.is_ready(&users) {
            return Ok(());
        }
        let _claim = self.ahead.claim(Work::Object(index));
        let prepared = self.prepared(index)?;
        for resting in 0..prepared.probabilities().len() {
            self.scene(&prepared, resting)?;
        }
        if model {
            prepared.model()?;
        }
        known.set_ready(&users);
        Ok(())
    }

    /// True if everything that an episode needs is ready.
    pub fn is_ready(&self, need: &Need) -> bool {
        let Some(prepared) = self.cache_lock().take(need.object) else { return false };
        need.resting.is_none_or(|choice| prepared.has_scene(choice)) && (!need.model || prepared.has_model())
    }

    fn make(&self, need: &Need) -> Result<(), EnvError> {
        let prepared = self.prepared(need.object)?;
        let resting = need.resting.map(|choice| prepared.resting(choice));
        if let Some(resting) = resting.filter(|resting| *resting < prepared.probabilities().len()) {
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
        let count = object.probabilities().len();
        for i in (0..count).map(|i| (resting + i) % count) {
            if let Some(scene) = object.scene(i, &self.hand, self.physics)? {
                return Ok((i, scene));
            }
        }
        Err(EpisodeError::NoRest {
            object: object.body().name().to_owned(),
            why: "it leaves the table from every resting pose",
        }
        .into())
    }

    fn cache_lock(&self) -> std::sync::MutexGuard<'_, Cache> {
        // A poisoned lock is harmless: no change inside it is partial.
        self.prepared.lock().unwrap_or_else(PoisonError::into_inner)
    }
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
