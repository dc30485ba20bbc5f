//! Objects that are prepared at their first use and shared by every environment that draws from them.
//!
//! Preparing an object (reading, convex parts, mass) and settling it in a resting pose take up to seconds; what comes of it depends on
//! the object alone. So it is kept until room is needed, and dropping it costs time, never a different result. No lock is held
//! while an object is prepared: threads that want the same one at the same time do the work twice and keep the first.

use crate::eyes::Stage;
use crate::{Body, EpisodeError, ObjectSpec, Scene};
use graspbox_camera::Model;
use graspbox_hand::Hand;
use graspbox_mesh::procedural::{Family, generate};
use graspbox_mesh::{CleanOptions, LoadOptions, RestingOptions, TriMesh, convex_hull, resting_poses};
use graspbox_sim::PhysicsConfig;
use nalgebra::{Isometry3, Point3};
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// Objects kept ready; one takes 1 to 4 MB with its resting poses. A set with more of them prepares one anew in many a reset.
const KEPT: usize = 512;
/// Resting poses less probable than this are left out, unless none is more probable.
const LEAST_PROBABILITY: f64 = 0.05;
/// Resting poses that are kept for an object, the most probable ones.
const MOST_POSES: usize = 6;

/// Where an object comes from.
#[derive(Clone, Debug)]
pub enum Source {
    /// An object in memory.
    Given(Arc<ObjectSpec>),
    /// A mesh file.
    File {
        /// Name of the object.
        name: String,
        /// The file.
        path: PathBuf,
        /// Metres in one unit of the file.
        scale: f64,
        /// Mass, kg.
        mass: Option<f64>,
    },
    /// A procedural object.
    Procedural {
        /// Name of the object.
        name: String,
        /// Its family.
        family: Family,
        /// Its seed.
        seed: u64,
        /// Factor on its size.
        scale: f64,
        /// Mass, kg; by default the family's times `scale` cubed.
        mass: Option<f64>,
    },
}

impl Source {
    /// Name of the object.
    pub fn name(&self) -> &str {
        match self {
            Self::Given(spec) => &spec.name,
            Self::File { name, .. } | Self::Procedural { name, .. } => name,
        }
    }

    fn read(&self) -> Result<ObjectSpec, EpisodeError> {
        let mesh_error = |source| EpisodeError::Mesh { object: self.name().to_owned(), source };
        match self {
            Self::Given(spec) => Ok(ObjectSpec::clone(spec)),
            Self::File { name, path, scale, mass } => {
                let options = LoadOptions { scale: *scale, ..LoadOptions::default() };
                let mesh = graspbox_mesh::load(path, &options).map_err(mesh_error)?;
                let (mesh, _) = graspbox_mesh::clean(&mesh, &CleanOptions::default()).map_err(mesh_error)?;
                Ok(ObjectSpec { name: name.clone(), mesh, mass: *mass, parts: None })
            }
            Self::Procedural { name, family, seed, scale, mass } => {
                let made = generate(*family, *seed).map_err(mesh_error)?;
                let grow = |part: Vec<Point3<f64>>| part.iter().map(|p| p * *scale).collect();
                Ok(ObjectSpec {
                    name: name.clone(),
                    mesh: made.mesh.scaled(*scale),
                    mass: Some(mass.unwrap_or(made.mass * scale.powi(3))),
                    parts: made.parts.map(|parts| parts.into_iter().map(grow).collect()),
                })
            }
        }
    }
}

/// An object ready to be drawn, with the ways in which it can lie.
pub struct Prepared {
    body: Body,
    ways: Vec<Way>,
    /// Middle and half sides of the bounds along the object's axes, metres.
    bounds: [Point3<f64>; 2],
    /// How it looks; made when it is first seen.
    look: OnceLock<Model>,
}

/// One way to lie on the table; settled at its first use.
struct Way {
    world_from_object: Isometry3<f64>,
    probability: f64,
    /// None where the object does not come to rest.
    scene: OnceLock<Option<Arc<Scene>>>,
}

impl Prepared {
    fn new(spec: &ObjectSpec, cache: Option<&std::path::Path>) -> Result<Self, EpisodeError> {
        let body = Body::prepare(spec, cache)?;
        let mesh_error = |source| EpisodeError::Mesh { object: spec.name.clone(), source };
        let hull: TriMesh = convex_hull(body.mesh().vertices()).map_err(mesh_error)?;
        let center = body.mass_properties().center_of_mass;
        let poses = resting_poses(&hull, &center, &RestingOptions::default()).map_err(mesh_error)?;
        let likely = poses.iter().take_while(|p| p.probability >= LEAST_PROBABILITY).count();
        let ways = poses.iter().take(likely.clamp(1, MOST_POSES)).map(|pose| Way {
            world_from_object: pose.world_from_object,
            probability: pose.probability,
            scene: OnceLock::new(),
        });
        let aabb = body.mesh().aabb();
        Ok(Self {
            ways: ways.collect(),
            bounds: [nalgebra::center(&aabb.min, &aabb.max), Point3::from((aabb.max - aabb.min) / 2.0)],
            body,
            look: OnceLock::new(),
        })
    }

    /// The object itself.
    pub fn body(&self) -> &Body {
        &self.body
    }

    /// The object as the renderer takes it, made at its first use.
    ///
    /// # Errors
    /// A mesh that cannot be drawn.
    pub fn look(&self) -> Result<&Model, EpisodeError> {
        if let Some(look) = self.look.get() {
            return Ok(look);
        }
        let made = Model::new(self.body.mesh())
            .map_err(|source| EpisodeError::Undrawable { object: self.body.name().to_owned(), source })?;
        Ok(self.look.get_or_init(|| made))
    }

    /// Chances of the resting poses, in order.
    pub fn probabilities(&self) -> impl ExactSizeIterator<Item = f64> + Clone {
        self.ways.iter().map(|way| way.probability)
    }

    /// Middle of the bounds along the object's axes, object frame, metres.
    pub fn bounds_center(&self) -> Point3<f64> {
        self.bounds[0]
    }

    /// Half sides of the bounds along the object's axes, metres.
    pub fn half_extents(&self) -> nalgebra::Vector3<f64> {
        self.bounds[1].coords
    }
}

/// A list of objects, a hand and a physics setting, with everything that was prepared so far.
pub struct Objects {
    sources: Vec<Source>,
    hand: Arc<Hand>,
    physics: PhysicsConfig,
    cache: Option<PathBuf>,
    stage: Arc<OnceLock<Stage>>,
    shelf: Mutex<Shelf>,
}

#[derive(Default)]
struct Shelf {
    /// When each object was asked for last, and the object.
    kept: BTreeMap<usize, (u64, Arc<Prepared>)>,
    clock: u64,
}

impl Objects {
    /// Takes a list of objects; convex parts are kept in the folder `cache`, if given.
    ///
    /// # Errors
    /// [`EpisodeError::NoObjects`] for an empty list.
    pub fn new(
        sources: Vec<Source>,
        hand: Arc<Hand>,
        physics: PhysicsConfig,
        cache: Option<PathBuf>,
    ) -> Result<Self, EpisodeError> {
        if sources.is_empty() {
            return Err(EpisodeError::NoObjects);
        }
        Ok(Self { sources, hand, physics, cache, stage: Arc::default(), shelf: Mutex::default() })
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

    /// Where object `index` comes from.
    pub fn source(&self, index: usize) -> Option<&Source> {
        self.sources.get(index)
    }

    /// The hand of every scene.
    pub fn hand(&self) -> &Arc<Hand> {
        &self.hand
    }

    /// The models of the hand, made when it is first seen.
    pub fn stage(&self) -> Arc<OnceLock<Stage>> {
        Arc::clone(&self.stage)
    }

    /// The physics of every scene.
    pub fn physics(&self) -> &PhysicsConfig {
        &self.physics
    }

    /// Object `index`, prepared now if it was not.
    ///
    /// # Errors
    /// An index that does not exist, a file that cannot be read, or an object that cannot be simulated.
    pub fn prepared(&self, index: usize) -> Result<Arc<Prepared>, EpisodeError> {
        if let Some(found) = self.shelf().take(index) {
            return Ok(found);
        }
        let source = self.sources.get(index).ok_or(EpisodeError::NoSuchObject { index, count: self.sources.len() })?;
        let made = Arc::new(Prepared::new(&source.read()?, self.cache.as_deref())?);
        Ok(self.shelf().keep(index, made))
    }

    /// Resting pose `way` of an object, or the next one that comes to rest; with the index of the one that was taken.
    ///
    /// # Errors
    /// [`EpisodeError::NoRest`] if none does.
    pub fn scene(&self, object: &Prepared, way: usize) -> Result<(usize, Arc<Scene>), EpisodeError> {
        let count = object.ways.len();
        for i in (0..count).map(|i| (way + i) % count) {
            let found = &object.ways[i];
            let scene = match found.scene.get() {
                Some(scene) => scene,
                None => {
                    let made =
                        Scene::new(&object.body, Arc::clone(&self.hand), self.physics, Some(&found.world_from_object));
                    let made = match made {
                        Ok(scene) => Some(Arc::new(scene)),
                        Err(EpisodeError::NoRest { .. }) => None,
                        Err(error) => return Err(error),
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
        })
    }

    fn shelf(&self) -> std::sync::MutexGuard<'_, Shelf> {
        // Nothing inside the lock can leave the shelf half changed.
        self.shelf.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Shelf {
    fn take(&mut self, index: usize) -> Option<Arc<Prepared>> {
        self.clock += 1;
        let (used, object) = self.kept.get_mut(&index)?;
        *used = self.clock;
        Some(Arc::clone(object))
    }

    /// Keeps `made`, unless another thread was faster, and makes room.
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
