//! The contact search: points of two bodies that may touch within a step.
//!
//! | module | purpose |
//! |---|---|
//! | `planes` | corners of a body over table and ground; edges of the table, and walls |
//! | `shapes` | shapes of the hand and parts of objects against each other, by parry |
//! | `manifold` | reduction of a contact manifold to four points |
//!
//! The search of a pair is repeated only after its bodies have moved relative to each other by more than a set drift. Until then the candidates move
//! with their bodies, and each step measures the distances between them.

mod manifold;
mod planes;
mod shapes;

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use parry3d::math::Vector;
use parry3d::query::ContactManifold;
use serde::{Deserialize, Serialize};

use crate::error::{FARTHEST, StateError, is_place, is_pose, is_unit, is_within};
use crate::model::{BodyIndex, BodyKind, Model, Pair};
use crate::scenery::{Plane, Surface};
use crate::solver::sleep::rests;

/// Extra range of a search between bodies, metres: one that finds nothing is repeated only after this much motion.
const SLACK: f64 = 0.002;

/// Margin for the rounding of parry's f32 distances, metres: it is subtracted from clearances.
const ROUNDING: f64 = 1e-5;

/// The counterpart of a candidate's point on the first body.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) enum Opposite {
    Plane(Surface),
    /// A point of the other body.
    Point {
        /// In that body's frame, metres.
        on_b: Vector3<f64>,
        /// Unit normal from the first to the second body, in the first body's frame.
        normal: Vector3<f64>,
    },
}

/// A possible contact point, kept between searches.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Candidate {
    /// Point in the first body's frame, metres.
    pub on_a: Vector3<f64>,
    pub opposite: Opposite,
    /// Coefficient of friction, without the scale of the objects' friction in this world.
    pub friction: f64,
    /// Shapes of the hand on both sides, and the wall for one of the scenery's; `None` for objects, table and ground.
    pub shapes: [Option<u16>; 2],
}

/// Result of the last search of a pair.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct PairCache {
    /// Pose of the second body in the first at the last search; `None` if the pair must be searched.
    a_from_b: Option<Isometry3<f64>>,
    /// Distance within which that search was complete, metres.
    margin: f64,
    /// Distance beyond which points are not contacts in this step, metres.
    pub reach: f64,
    pub candidates: Vec<Candidate>,
}

/// Motion of a body's bounding sphere; base's frame.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct BodyMotion {
    pub center: Vector3<f64>,
    pub velocity: Vector3<f64>,
    pub omega: Vector3<f64>,
}

/// Poses and motion of all bodies at the beginning of a step.
pub(crate) struct Situation<'a> {
    pub dt: f64,
    /// By [`crate::BodyIndex`].
    pub poses: &'a [Isometry3<f64>],
    /// The rotations of `poses` as matrices.
    pub turns: &'a [Matrix3<f64>],
    pub moving: &'a [BodyMotion],
    pub planes: &'a [Plane; 2],
    /// See [`crate::StepInput::idle`].
    pub idle: usize,
}

/// The contact search of one world: its results, and the state from which the next search starts.
#[derive(Clone)]
pub(crate) struct Searcher {
    pub pairs: Vec<PairCache>,
    /// Last separating direction of each hand shape and part of an object.
    directions: Vec<Vector>,
    manifold: ContactManifold<(), ()>,
}

/// The state of a searcher that later results depend on.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct SavedSearch {
    pairs: Vec<PairCache>,
    directions: Vec<[f32; 3]>,
}

impl SavedSearch {
    /// Whether a searcher of `model` can be in this state.
    ///
    /// # Errors
    /// [`StateError`] if it cannot.
    pub fn check(&self, model: &Model) -> Result<(), StateError> {
        if self.pairs.len() != model.pairs.len() || self.directions.len() != directions(model) {
            return Err(StateError::OtherModel { what: "pairs of bodies" });
        }
        let possible = self.pairs.iter().zip(&model.pairs).all(|(cache, pair)| cache.is_possible(model, pair))
            && self.directions.iter().flatten().all(|x| x.abs() <= 2.0);
        if possible { Ok(()) } else { Err(StateError::Impossible { what: "pairs of bodies" }) }
    }
}

/// Whether the centre of a body's bounding sphere is within `far` of a wall.
fn near_wall(model: &Model, now: &Situation, body: BodyIndex, far: f64) -> bool {
    let walls = &model.scenery.walls;
    !walls.is_empty() && {
        let center = world_center(model, now, body);
        walls.iter().any(|wall| wall.distance(&center) < far)
    }
}

/// Centre of a body's bounding sphere in the world.
fn world_center(model: &Model, now: &Situation, body: BodyIndex) -> Point3<f64> {
    now.poses[model.scenery_body()].inverse_transform_point(&Point3::from(now.moving[body].center))
}

/// Number of pairs of a hand shape and an object's part.
fn directions(model: &Model) -> usize {
    model.shapes.len() * model.objects.iter().map(|object| object.parts.len()).sum::<usize>()
}

impl Searcher {
    pub fn new(model: &Model) -> Self {
        Self {
            pairs: vec![PairCache::default(); model.pairs.len()],
            directions: vec![Vector::ZERO; directions(model)],
            manifold: ContactManifold::new(),
        }
    }

    pub fn save(&self) -> SavedSearch {
        SavedSearch { pairs: self.pairs.clone(), directions: self.directions.iter().map(|d| [d.x, d.y, d.z]).collect() }
    }

    /// Restores a state that [`SavedSearch::check`] accepted.
    pub fn load(&mut self, saved: SavedSearch) {
        self.pairs = saved.pairs;
        self.directions = saved.directions.into_iter().map(|[x, y, z]| Vector::new(x, y, z)).collect();
    }

    /// Updates the candidates of every pair, but of those that sleep.
    pub fn search(&mut self, model: &Model, now: &Situation, asleep: &[bool]) {
        let idle = model.scenery_body() - now.idle..model.scenery_body();
        for (index, pair) in model.pairs.iter().enumerate() {
            if rests(&pair.sides, |object| asleep[object]) {
                continue;
            }
            if idle.contains(&pair.b) || idle.contains(&pair.a) {
                self.pairs[index].forget();
                continue;
            }
            match pair.sides[1] {
                BodyKind::Scenery => self.search_scenery(model, now, index),
                BodyKind::Object(_) | BodyKind::Hand(_) => self.search_bodies(model, now, index),
            }
        }
    }

    fn search_scenery(&mut self, model: &Model, now: &Situation, index: usize) {
        let pair = model.pairs[index];
        let (a, b) = (&now.moving[pair.a], &now.moving[pair.b]);
        let radius = model.radius[pair.a];
        let speed = (a.velocity - b.velocity - b.omega.cross(&a.center)).norm() + (a.omega - b.omega).norm() * radius;
        let reach = model.config.prediction + now.dt * speed;
        let cache = &mut self.pairs[index];
        cache.reach = reach;
        let far = radius + reach;
        if now.planes.iter().all(|p| p.gap(&a.center) >= far) && !near_wall(model, now, pair.a, far) {
            cache.forget();
            return;
        }
        let a_from_b = now.poses[pair.a].inv_mul(&now.poses[pair.b]);
        // The lowest point of a round body changes as it rolls.
        let round = model.corners[pair.a].iter().any(|c| c.radius > 0.0);
        if (!round || cache.candidates.is_empty())
            && let Some(old) = &cache.a_from_b
        {
            // Displacement of the body's points relative to the plane.
            let center = Point3::from(model.center[pair.a]);
            let shift = a_from_b.inverse_transform_point(&center) - old.inverse_transform_point(&center);
            let moved = shift.norm() + turned(&a_from_b, old) * radius;
            if moved < cache.allowed_drift(model.config.contact_drift) {
                return;
            }
        }
        cache.a_from_b = Some(a_from_b);
        cache.margin = reach + 2.0 * model.config.contact_drift;
        cache.candidates.clear();
        let clearance = self.over_scenery(model, now, index);
        self.pairs[index].nothing_within(clearance);
    }

    fn search_bodies(&mut self, model: &Model, now: &Situation, index: usize) {
        let pair = model.pairs[index];
        let (a, b) = (&now.moving[pair.a], &now.moving[pair.b]);
        let (radius_a, radius_b) = (model.radius[pair.a], model.radius[pair.b]);
        let between = b.center - a.center;
        let turning = (b.omega - a.omega).norm() * radius_a.min(radius_b);
        let speed = (b.velocity - a.velocity - a.omega.cross(&between)).norm() + turning;
        let reach = model.config.prediction + now.dt * speed;
        let cache = &mut self.pairs[index];
        cache.reach = reach;
        if between.norm_squared() > (radius_a + radius_b + reach).powi(2) {
            cache.forget();
            return;
        }
        let a_from_b = now.poses[pair.a].inv_mul(&now.poses[pair.b]);
        if let Some(old) = &cache.a_from_b {
            let center = Point3::from(model.center[pair.b]);
            let moved = (a_from_b * center - old * center).norm() + turned(&a_from_b, old) * radius_b;
            if moved < cache.allowed_drift(model.config.contact_drift) {
                return;
            }
        }
        let margin = reach + SLACK;
        cache.a_from_b = Some(a_from_b);
        cache.margin = margin;
        cache.candidates.clear();
        let clearance = match pair.sides {
            [BodyKind::Object(object), BodyKind::Hand(body)] => {
                self.object_and_body(model, index, (object, body), &a_from_b, margin)
            }
            [BodyKind::Object(a), BodyKind::Object(b)] => {
                self.object_and_object(model, index, (a, b), &a_from_b, margin)
            }
            [BodyKind::Hand(a), BodyKind::Hand(b)] => self.body_and_body(model, index, (a, b), &a_from_b, margin),
            _ => f64::INFINITY,
        };
        self.pairs[index].nothing_within(clearance);
    }
}

impl Candidate {
    fn is_possible(&self, model: &Model, pair: &Pair) -> bool {
        let opposite = match &self.opposite {
            Opposite::Plane(_) => pair.b == model.scenery_body(),
            Opposite::Point { on_b, normal } => is_place(on_b) && is_unit(normal),
        };
        let owned = |shape: Option<u16>, body: BodyIndex| match (shape, model.kind(body)) {
            (Some(shape), BodyKind::Hand(body)) => {
                model.shape_owner.get(usize::from(shape)).is_some_and(|(owner, _)| *owner == body)
            }
            (Some(wall), BodyKind::Scenery) => usize::from(wall) < model.scenery.walls.len(),
            (shape, kind) => shape.is_none() && !matches!(kind, BodyKind::Hand(_)),
        };
        let shapes = owned(self.shapes[0], pair.a) && owned(self.shapes[1], pair.b);
        opposite && shapes && is_place(&self.on_a) && (0.0..=FARTHEST).contains(&self.friction)
    }
}

impl PairCache {
    fn is_possible(&self, model: &Model, pair: &Pair) -> bool {
        self.a_from_b.as_ref().is_none_or(is_pose)
            // Without corners nothing is found at any distance.
            && !self.margin.is_nan()
            && is_within([&self.reach], FARTHEST)
            && self.candidates.iter().all(|candidate| candidate.is_possible(model, pair))
    }

    fn forget(&mut self) {
        self.a_from_b = None;
        self.candidates.clear();
    }

    /// Extends the margin of a search without candidates to `clearance`, metres, the distance that the bodies are known to keep.
    fn nothing_within(&mut self, clearance: f64) {
        if self.candidates.is_empty() {
            self.margin = self.margin.max(clearance - ROUNDING);
        }
    }

    /// Relative motion after which the pair is searched again, metres: at most `drift` if there are candidates, and never enough for a point
    /// beyond the margin to come within reach.
    fn allowed_drift(&self, drift: f64) -> f64 {
        let left = self.margin - self.reach;
        if self.candidates.is_empty() { left } else { left.min(drift) }
    }
}

/// Angle between two poses, radians (small-angle approximation).
fn turned(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    let cosine = a.rotation.coords.dot(&b.rotation.coords).abs().min(1.0);
    2.0 * (2.0 * (1.0 - cosine)).sqrt()
}
