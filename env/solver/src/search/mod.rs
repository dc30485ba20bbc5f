//! Which points of which bodies may touch within a step.
//!
//! | module | what it does |
//! |---|---|
//! | `planes` | corners of a body over table and ground |
//! | `shapes` | shapes of the hand against parts of the object and against each other, by parry |
//! | `manifold` | which points of a manifold are kept |
//!
//! Parry is asked again only after the two bodies have moved against each other by more than a set drift; until then the points that were
//! found move with their bodies, and their distances are measured between them.

mod manifold;
mod planes;
mod shapes;

use nalgebra::{Isometry3, Matrix3, Point3, Vector3};
use parry3d::math::Vector;
use parry3d::query::ContactManifold;
use serde::{Deserialize, Serialize};

use crate::model::{Model, OBJECT, PairKind};
use crate::scenery::{Plane, Surface};

/// A search that may find nothing looks further by this, metres, so that it need not be repeated soon.
const SLACK: f64 = 0.002;

/// Distances in parry's f32 are taken for smaller by this, metres.
const ROUNDING: f64 = 1e-5;

/// What a point of the first body may touch.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) enum Opposite {
    /// The plane of a surface, at any place.
    Plane(Surface),
    /// A point of the other body.
    Point {
        /// In that body's frame.
        on_b: Vector3<f64>,
        /// From the first to the second body, first body's frame.
        normal: Vector3<f64>,
    },
}

/// A point that may touch, kept between searches.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub(crate) struct Candidate {
    /// In the first body's frame.
    pub on_a: Vector3<f64>,
    pub opposite: Opposite,
    /// Coefficient of friction without the object's own factor, which may be scaled.
    pub friction: f64,
    /// Shapes of the hand on both sides; none for object and scenery.
    pub shapes: [Option<u16>; 2],
}

/// What the last search for a pair found.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct PairCache {
    /// Pose of the second body in the first at the last search; none where it has to be searched.
    a_from_b: Option<Isometry3<f64>>,
    /// Distance within which that search would have found what there is, metres.
    margin: f64,
    /// Farther points do not matter in this step, metres.
    pub reach: f64,
    pub candidates: Vec<Candidate>,
}

/// How a body's bounding sphere moves; base's frame.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moving {
    pub center: Vector3<f64>,
    pub velocity: Vector3<f64>,
    pub omega: Vector3<f64>,
}

/// Everything that stands or moves at the beginning of a step.
pub(crate) struct Situation<'a> {
    pub dt: f64,
    /// By body of contact; scenery last.
    pub poses: &'a [Isometry3<f64>],
    /// Their rotations as matrices.
    pub turns: &'a [Matrix3<f64>],
    pub moving: &'a [Moving],
    pub planes: &'a [Plane; 2],
}

/// The search of one world: what it found, and what it starts from.
#[derive(Clone)]
pub(crate) struct Searcher {
    pub pairs: Vec<PairCache>,
    /// Last separating direction of each hand shape and object part.
    directions: Vec<Vector>,
    manifold: ContactManifold<(), ()>,
}

/// The part of a searcher that decides what it finds next.
#[derive(Clone, Serialize, Deserialize)]
pub(crate) struct SavedSearch {
    pairs: Vec<PairCache>,
    directions: Vec<[f32; 3]>,
}

impl Searcher {
    pub fn new(model: &Model) -> Self {
        Self {
            pairs: vec![PairCache::default(); model.pairs.len()],
            directions: vec![Vector::ZERO; model.shapes.len() * model.parts.len()],
            manifold: ContactManifold::new(),
        }
    }

    pub fn save(&self) -> SavedSearch {
        SavedSearch { pairs: self.pairs.clone(), directions: self.directions.iter().map(|d| [d.x, d.y, d.z]).collect() }
    }

    /// False for a state of another model.
    pub fn fits(&self, saved: &SavedSearch) -> bool {
        saved.pairs.len() == self.pairs.len() && saved.directions.len() == self.directions.len()
    }

    /// Takes a state that fits.
    pub fn load(&mut self, saved: SavedSearch) {
        self.pairs = saved.pairs;
        self.directions = saved.directions.into_iter().map(|[x, y, z]| Vector::new(x, y, z)).collect();
    }

    /// Looks at every pair; the points found are in `pairs`.
    pub fn search(&mut self, model: &Model, now: &Situation) {
        for (index, pair) in model.pairs.iter().enumerate() {
            match pair.kind {
                PairKind::Scenery => self.search_scenery(model, now, index),
                PairKind::Bodies => self.search_bodies(model, now, index),
            }
        }
    }

    fn search_scenery(&mut self, model: &Model, now: &Situation, index: usize) {
        let pair = model.pairs[index];
        let (a, b) = (&now.moving[pair.a], &now.moving[pair.b]);
        let radius = model.radius[pair.a];
        let speed = (a.velocity - b.velocity - b.omega.cross(&a.center)).norm() + (a.omega - b.omega).norm() * radius;
        let reach = model.solver.prediction + now.dt * speed;
        let cache = &mut self.pairs[index];
        cache.reach = reach;
        if now.planes.iter().all(|p| p.gap(&a.center) >= radius + reach) {
            cache.forget();
            return;
        }
        let a_from_b = now.poses[pair.a].inv_mul(&now.poses[pair.b]);
        // Round bodies roll on other points.
        let round = model.corners[pair.a].iter().any(|c| c.radius > 0.0);
        if (!round || cache.candidates.is_empty())
            && let Some(old) = &cache.a_from_b
        {
            // Seen from the plane: how far the body's own points have moved.
            let center = Point3::from(model.center[pair.a]);
            let shift = a_from_b.inverse_transform_point(&center) - old.inverse_transform_point(&center);
            let moved = shift.norm() + turned(&a_from_b, old) * radius;
            if moved < cache.allowed_drift(model.solver.contact_drift) {
                return;
            }
        }
        cache.a_from_b = Some(a_from_b);
        cache.margin = reach + 2.0 * model.solver.contact_drift;
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
        let reach = model.solver.prediction + now.dt * speed;
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
            if moved < cache.allowed_drift(model.solver.contact_drift) {
                return;
            }
        }
        let margin = reach + SLACK;
        cache.a_from_b = Some(a_from_b);
        cache.margin = margin;
        cache.candidates.clear();
        let clearance = if pair.a == OBJECT {
            self.object_and_body(model, index, pair.b, &a_from_b, margin)
        } else {
            self.body_and_body(model, index, (pair.a, pair.b), &a_from_b, margin)
        };
        self.pairs[index].nothing_within(clearance);
    }
}

impl PairCache {
    fn forget(&mut self) {
        self.a_from_b = None;
        self.candidates.clear();
    }

    /// Takes note that a search without candidates would have found none at `clearance` either, metres.
    fn nothing_within(&mut self, clearance: f64) {
        if self.candidates.is_empty() {
            self.margin = self.margin.max(clearance - ROUNDING);
        }
    }

    /// How far the bodies may move against each other, metres, before they are searched again: by `drift` at most where there are
    /// candidates, and not so far that a point beyond the margin could come within reach.
    fn allowed_drift(&self, drift: f64) -> f64 {
        let left = self.margin - self.reach;
        if self.candidates.is_empty() { left } else { left.min(drift) }
    }
}

/// Angle between two poses, radians, for small angles.
fn turned(a: &Isometry3<f64>, b: &Isometry3<f64>) -> f64 {
    let cosine = a.rotation.coords.dot(&b.rotation.coords).abs().min(1.0);
    2.0 * (2.0 * (1.0 - cosine)).sqrt()
}
