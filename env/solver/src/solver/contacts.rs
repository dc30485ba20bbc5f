//! The contact points of the last step, made when they are asked for.

use super::Solver;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::model::{BodyIndex, OBJECT};
use crate::rows::Origin;
use crate::scenery::Surface;
use crate::search::Opposite;

/// One side of a contact point, in its body's frame (the world's for the scenery).
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Side {
    /// The object, a body of the tree (from [`crate::BASE`]), or the scenery.
    pub body: BodyIndex,
    /// Shape within a body of the tree.
    pub shape: u16,
    /// On the body, metres.
    pub point: Vector3<f64>,
    /// Unit normal into the body.
    pub normal: Vector3<f64>,
}

/// A contact point of the last step, pressing or merely near.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Contact {
    /// Both sides.
    pub sides: [Side; 2],
    /// Which surface, where the second body is the scenery.
    pub surface: Option<Surface>,
    /// Midway between the bodies, frame of the base, at the beginning of the step.
    pub point: Vector3<f64>,
    /// From the first to the second body, frame of the base.
    pub normal: Vector3<f64>,
    /// Coefficient of friction.
    pub friction: f64,
    /// Distance at the end of the step, metres.
    pub distance: f64,
    /// Normal force, mean over the step, N.
    pub force: f64,
}

impl Solver {
    /// Visits the contact points of the last step whose bodies are `wanted`.
    pub fn contacts(&self, wanted: impl Fn(BodyIndex, BodyIndex) -> bool, mut visit: impl FnMut(&Contact)) {
        for contact in self.loaded.iter().filter(|c| wanted(c.sides[0].body, c.sides[1].body)) {
            visit(contact);
        }
        for (index, origin) in self.origins.iter().enumerate() {
            let pair = &self.model.pairs[origin.pair as usize];
            if wanted(pair.a, pair.b) {
                visit(&self.contact(index, origin));
            }
        }
    }

    fn contact(&self, index: usize, origin: &Origin) -> Contact {
        let pair = &self.model.pairs[origin.pair as usize];
        let candidate = &self.searcher.pairs[origin.pair as usize].candidates[origin.candidate as usize];
        let point = &self.problem.points[index];
        let shape = |i: usize| candidate.shapes[i].map_or(0, |s| self.model.shape_owner[usize::from(s)].1 as u16);
        let into_a = self.turns[pair.a].tr_mul(&-point.normal);
        let into_b = self.turns[pair.b].tr_mul(&point.normal);
        let middle = self.poses[OBJECT] * self.model.object.center + point.arm;
        let scenery = pair.b == self.model.scenery_body();
        let (on_b, surface) = match candidate.opposite {
            Opposite::Point { on_b, .. } => (on_b, scenery.then_some(Surface::Table)),
            Opposite::Plane(surface) => {
                let on_plane = middle + point.normal * (0.5 * origin.distance);
                (self.poses[pair.b].inverse_transform_point(&on_plane).coords, Some(surface))
            }
        };
        Contact {
            sides: [
                Side { body: pair.a, shape: shape(0), point: candidate.on_a, normal: into_a },
                Side { body: pair.b, shape: shape(1), point: on_b, normal: into_b },
            ],
            surface,
            point: middle.coords,
            normal: point.normal,
            friction: point.friction,
            distance: origin.distance + self.problem.dt * point.approach,
            force: point.impulse / self.problem.dt,
        }
    }
}
