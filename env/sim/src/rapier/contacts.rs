//! Rapier's contact points, translated for the interface of [`crate::engine`].

use super::build::{Handles, part_of};
use super::frames;
use crate::engine::{Contact, ContactSide, Part};
use graspbox_hand::Hand;
use nalgebra::{Isometry3, Point3, Vector3};
use rapier3d::geometry::{Contact as EnginePoint, ContactManifold};
use rapier3d::math::{Pose, Vector};
use rapier3d::prelude::{Collider, PairFilterContext, PhysicsHooks, PhysicsWorld, SolverFlags};

/// Leaves out contacts between shapes of a hand that pass through each other.
pub(crate) struct NoContact<'a>(pub &'a Hand);

impl PhysicsHooks for NoContact<'_> {
    fn filter_contact_pair(&self, context: &PairFilterContext) -> Option<SolverFlags> {
        let parts = [context.collider1, context.collider2].map(|handle| part_of(&context.colliders[handle]));
        let passes = match parts {
            [Part::Link { link: a, shape: i }, Part::Link { link: b, shape: j }] => {
                !self.0.shapes_touch((a, i), (b, j))
            }
            _ => false,
        };
        (!passes).then_some(SolverFlags::default())
    }
}

/// True if a part of the hand has a contact that the solver considers, pressing or predicted.
pub(crate) fn hand_in_contact(physics: &PhysicsWorld) -> bool {
    let of_hand = |collider| part_of(&physics.colliders[collider]).is_link();
    let mut pairs = physics.narrow_phase.contact_pairs();
    pairs.any(|p| p.has_any_active_contact() && (of_hand(p.collider1) || of_hand(p.collider2)))
}

/// Visits the contact points of wanted pairs, in each manifold first those that press.
pub(crate) fn visit(
    physics: &PhysicsWorld,
    handles: &Handles,
    wanted: &dyn Fn([Part; 2]) -> bool,
    visit: &mut dyn FnMut(&Contact),
) {
    for pair in physics.narrow_phase.contact_pairs() {
        let manifolds = pair.solver_manifolds();
        if manifolds.iter().all(|m| m.points.is_empty()) {
            continue;
        }
        let colliders = [&physics.colliders[pair.collider1], &physics.colliders[pair.collider2]];
        let parts = colliders.map(part_of);
        if wanted(parts) {
            let pair = Pair::new(colliders, parts, handles, physics.integration_parameters.dt);
            manifolds.iter().for_each(|manifold| pair.visit(manifold, visit));
        }
    }
}

/// Data common to the contact points of one pair.
struct Pair<'a> {
    colliders: [&'a Collider; 2],
    parts: [Part; 2],
    part_from_collider: [Isometry3<f64>; 2],
    /// The side that gives point and normal in the base's frame: a link, if there is one.
    reference: usize,
    friction: f64,
    dt: f32,
}

impl<'a> Pair<'a> {
    fn new(colliders: [&'a Collider; 2], parts: [Part; 2], handles: &Handles, dt: f32) -> Self {
        let frame = |i: usize| match parts[i] {
            Part::Object(_) => Isometry3::identity(),
            Part::Link { link, shape } => handles.link_from_shape[link][shape],
            Part::Table | Part::Ground | Part::Wall | Part::Arm(_) => {
                colliders[i].position_wrt_parent().map_or_else(Isometry3::identity, frames::isometry)
            }
        };
        Self {
            colliders,
            parts,
            part_from_collider: [frame(0), frame(1)],
            reference: usize::from(!parts[0].is_link() && parts[1].is_link()),
            friction: f64::from(colliders[0].friction()) * f64::from(colliders[1].friction()),
            dt,
        }
    }

    /// Rapier solves at most four points of a manifold; the others keep the impulse of the step in which they were last chosen, so only chosen
    /// points count as pressing. Against an object of several parts it solves merged manifolds: those have the impulses, and keep the
    /// deepest of the points that they merge.
    fn visit(&self, manifold: &ContactManifold, visit: &mut dyn FnMut(&Contact)) {
        let chosen = || manifold.data.solver_contacts.iter().flat_map(|c| c.contact_indices()).map(|i| i as usize);
        let pressing = |i: usize| manifold.points.get(i).filter(|p| p.data.impulse > 0.0);
        for point in chosen().filter_map(pressing) {
            let friction = frames::metres64(friction_impulse(point, manifold.data.normal) / self.dt);
            visit(&self.contact(manifold, point, frames::metres(point.data.impulse / self.dt), friction));
        }
        for (i, point) in manifold.points.iter().enumerate() {
            if pressing(i).is_none() || chosen().all(|other| other != i) {
                visit(&self.contact(manifold, point, 0.0, Vector3::zeros()));
            }
        }
    }

    fn contact(
        &self,
        manifold: &ContactManifold,
        point: &EnginePoint,
        force: f64,
        friction_force: Vector3<f64>,
    ) -> Contact {
        let poses = [manifold.subshape_pos1(), manifold.subshape_pos2()];
        let (points, normals) = ([point.local_p1, point.local_p2], [manifold.local_n1, manifold.local_n2]);
        let local = |i: usize| match poses[i] {
            Some(pose) => (*pose * points[i], pose.rotation * normals[i]),
            None => (points[i], normals[i]),
        };
        let side = |i: usize| {
            let (point, outward) = local(i);
            ContactSide {
                part: self.parts[i],
                point: self.part_from_collider[i] * Point3::from(frames::metres64(point)),
                normal: self.part_from_collider[i] * -frames::vector64(outward),
            }
        };
        let place: &Pose = self.colliders[self.reference].position();
        let (at, outward) = local(self.reference);
        let outward = frames::vector64(place.rotation * outward);
        Contact {
            sides: [side(0), side(1)],
            point: Point3::from(frames::metres64(*place * at)),
            normal: if self.reference == 0 { outward } else { -outward },
            distance: frames::metres(point.dist),
            force,
            friction_force,
            friction: self.friction,
        }
    }
}

/// Friction impulse of a step on the second body, axes of the base.
///
/// Rapier keeps the impulse of the last sub-step as a vector, and that of the whole step as two components along tangents that it does not keep.
/// The first gives the tangents: `w = x t + y (d x t)`, with `d` the normal into the first body. A point whose friction was 0 in the last
/// sub-step counts as free of friction.
fn friction_impulse(point: &EnginePoint, normal: Vector) -> Vector {
    let (last, total, into_first) = (point.data.warmstart_tangent_impulse, point.data.tangent_impulse, -normal);
    let (world, size) = (point.data.warmstart_tangent_world, last.x * last.x + last.y * last.y);
    if size <= 0.0 {
        return Vector::ZERO;
    }
    let tangent = (world * last.x - into_first.cross(world) * last.y) / size;
    -(tangent * total.x + into_first.cross(tangent) * total.y)
}
