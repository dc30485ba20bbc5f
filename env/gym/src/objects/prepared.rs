//! A prepared object: its body, its resting poses with their scenes, and its render model.

use crate::EnvError;
use crate::objects::RestingChoice;
use crate::objects::stored::Identified;
use graspbox_episode::{Body, EpisodeError, ObjectSpec, Scene};
use graspbox_hand::Hand;
use graspbox_mesh::{RestingOptions, TriMesh, convex_hull, least_width, resting_poses};
use graspbox_render::Model;
use graspbox_sim::{PhysicsConfig, Template};
use nalgebra::{Isometry3, Point3};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// Least probability of a resting pose; if none reaches it, the most probable one is kept.
const LEAST_PROBABILITY: f64 = 0.05;
/// Most resting poses of an object: the most probable ones are kept.
const MOST_POSES: usize = 6;

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
    /// Cache folder of levels of detail and poses at rest.
    cache: Option<PathBuf>,
    /// What its scenes share, built at first use.
    template: OnceLock<Arc<Template>>,
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

/// A resting pose: ``world_from_object``, its probability, and the least width in plan view, metres.
pub(super) type Rest = (Isometry3<f64>, f64, f64);

impl Prepared {
    /// Prepares an object; its convex parts are cached in the folder `cache`, if there is one.
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
        let rests = poses.iter().take(likely.clamp(1, MOST_POSES)).map(|pose| {
            (pose.world_from_object, pose.probability, least_width(hull.vertices(), &pose.world_from_object))
        });
        Ok(Self::at(body, rests, cache))
    }

    /// Takes an object from disk, or prepares it and keeps it there.
    ///
    /// # Errors
    /// As [`Source::read`](crate::source::Source::read) and [`Prepared::new`].
    pub(super) fn of(known: &Identified) -> Result<Self, EnvError> {
        if let Some((body, rests)) = known.stored() {
            return Ok(Self::at(body, rests, known.cache()));
        }
        let made = Self::new(&known.read()?, known.cache())?;
        let rests: Vec<Rest> =
            made.resting_poses.iter().map(|at| (at.world_from_object, at.probability, at.width)).collect();
        known.store(&made.body, &rests);
        Ok(made)
    }

    fn at(body: Body, rests: impl IntoIterator<Item = Rest>, cache: Option<&Path>) -> Self {
        let aabb = body.mesh().aabb();
        let rest = |(world_from_object, probability, width)| RestingPose {
            world_from_object,
            probability,
            width,
            scene: OnceLock::new(),
        };
        Self {
            resting_poses: rests.into_iter().map(rest).collect(),
            bounds: [nalgebra::center(&aabb.min, &aabb.max), Point3::from((aabb.max - aabb.min) / 2.0)],
            body,
            model: OnceLock::new(),
            original: None,
            cache: cache.map(Path::to_path_buf),
            template: OnceLock::new(),
        }
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
            template: OnceLock::new(),
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

    /// Whether its render model has been built.
    pub(super) fn has_model(&self) -> bool {
        self.model.get().is_some()
    }

    /// Whether the scene of a resting pose has been built; also if there is no such pose.
    pub(super) fn has_scene(&self, choice: RestingChoice) -> bool {
        self.resting_poses.get(self.resting(choice)).is_none_or(|pose| pose.scene.get().is_some())
    }

    /// The object at rest in a pose, by index; `None` if it does not come to rest there.
    ///
    /// # Errors
    /// As [`Scene::template_of`] and [`Scene::at_rest`].
    pub(super) fn scene(
        &self,
        resting: usize,
        hand: &Arc<Hand>,
        physics: PhysicsConfig,
    ) -> Result<Option<Arc<Scene>>, EnvError> {
        let found = &self.resting_poses[resting];
        if let Some(scene) = found.scene.get() {
            return Ok(scene.clone());
        }
        let template = match self.template.get() {
            Some(template) => template,
            None => {
                let made = Scene::template_of(&self.body, Arc::clone(hand), physics)?;
                self.template.get_or_init(|| made)
            }
        };
        let made = match Scene::at_rest(&self.body, template, Some(&found.world_from_object), self.cache.as_deref()) {
            Ok(scene) => Some(Arc::new(scene)),
            Err(EpisodeError::NoRest { .. }) => None,
            Err(error) => return Err(error.into()),
        };
        Ok(found.scene.get_or_init(|| made).clone())
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
