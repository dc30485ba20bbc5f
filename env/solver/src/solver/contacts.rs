//! The contact points of the last step, made from the solver's own tables when they are asked for.

use super::Solver;
use crate::contact::{Contact, Side};
use crate::model::{BodyIndex, OBJECT};
use crate::rows::Origin;
use crate::scenery::Surface;
use crate::search::Opposite;

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
