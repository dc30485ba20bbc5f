//! Contact candidates between shapes of the hand, parts of objects, and both, by parry.

use nalgebra::{Isometry3, Point3};
use parry3d::bounding_volume::Aabb;
use parry3d::math::{Matrix, Pose, Vector};
use parry3d::query::PersistentQueryDispatcher;
use parry3d::shape::Shape;

use super::manifold::chosen;
use super::{Candidate, Opposite, Searcher};
use crate::dispatch::Dispatcher;
use crate::model::{FreeObject, HandShape, Model, Part};
use crate::units;

impl Searcher {
    /// An object against a body of the hand. Returns a lower bound of their distance if nothing was found, metres.
    pub(super) fn object_and_body(
        &mut self,
        model: &Model,
        pair: usize,
        (object, body): (usize, usize),
        object_from_body: &Isometry3<f64>,
        margin: f64,
    ) -> f64 {
        let object = &model.objects[object];
        let reach = units::length(margin);
        let mut clearance = f32::INFINITY;
        for index in model.shapes_of[body].clone() {
            let shape = &model.shapes[index];
            let pose = units::pose(&(object_from_body * shape.body_from_shape));
            let placed = PlacedBox::new(&pose, shape.half);
            let apart = placed.apart_outside(&object.bounds);
            if apart > reach {
                clearance = clearance.min(apart);
                continue;
            }
            for (p, part) in object.parts.iter().enumerate() {
                let apart = placed.apart(&part.bounds, reach);
                clearance = clearance.min(apart.max(reach));
                if apart <= reach {
                    let of_pair = object.first_direction + index * object.parts.len() + p;
                    self.part_and_shape(pair, (part, object.own.friction), (shape, index), &pose, of_pair, reach);
                }
            }
        }
        units::metres(clearance)
    }

    fn part_and_shape(
        &mut self,
        pair: usize,
        (part, friction): (&Part, f64),
        (shape, index): (&HandShape, usize),
        object_from_shape: &Pose,
        of_pair: usize,
        reach: f32,
    ) {
        let part_from_shape = part.inverse * *object_from_shape;
        let direction = self.directions[of_pair];
        if !self.contact(Dispatcher::default(), &part_from_shape, &*part.shape, &*shape.shape, direction, reach) {
            return;
        }
        let manifold = &self.manifold;
        self.directions[of_pair] = manifold.local_n1;
        let (kept, count) = chosen(manifold, reach);
        let normal = units::direction(part.pose.rotation * manifold.local_n1);
        let candidates = &mut self.pairs[pair].candidates;
        for point in kept[..count].iter().map(|i| &manifold.points[*i]) {
            let on_shape = Point3::from(units::metres64(point.local_p2));
            candidates.push(Candidate {
                on_a: units::metres64(part.pose * point.local_p1),
                opposite: Opposite::Point { on_b: (shape.body_from_shape * on_shape).coords, normal },
                friction: friction * shape.friction,
                shapes: [None, Some(index as u16)],
            });
        }
    }

    /// Two objects. Returns a lower bound of their distance if nothing was found, metres.
    pub(super) fn object_and_object(
        &mut self,
        model: &Model,
        pair: usize,
        (a, b): (usize, usize),
        a_from_b: &Isometry3<f64>,
        margin: f64,
    ) -> f64 {
        let (one, two) = (&model.objects[a], &model.objects[b]);
        let reach = units::length(margin);
        let place = units::pose(a_from_b);
        let boxed = |bounds: &Aabb| {
            PlacedBox::new(&Pose::from_parts(place * bounds.center(), place.rotation), bounds.half_extents())
        };
        let mut clearance = boxed(&two.bounds).apart(&one.bounds, reach);
        if clearance > reach {
            return units::metres(clearance);
        }
        clearance = f32::INFINITY;
        for second in &two.parts {
            let placed = boxed(&second.bounds);
            let apart = placed.apart_outside(&one.bounds);
            if apart > reach {
                clearance = clearance.min(apart);
                continue;
            }
            for first in &one.parts {
                let apart = placed.apart(&first.bounds, reach);
                clearance = clearance.min(apart.max(reach));
                if apart <= reach {
                    self.part_and_part(pair, (first, one), (second, two), &place, reach);
                }
            }
        }
        units::metres(clearance)
    }

    fn part_and_part(
        &mut self,
        pair: usize,
        (first, one): (&Part, &FreeObject),
        (second, two): (&Part, &FreeObject),
        a_from_b: &Pose,
        reach: f32,
    ) {
        let first_from_second = first.inverse * (*a_from_b * second.pose);
        let whole = Dispatcher { every_face: true };
        if !self.contact(whole, &first_from_second, &*first.shape, &*second.shape, Vector::ZERO, reach) {
            return;
        }
        let manifold = &self.manifold;
        let (kept, count) = chosen(manifold, reach);
        let normal = units::direction(first.pose.rotation * manifold.local_n1);
        let friction = one.own.friction * two.own.friction;
        let candidates = &mut self.pairs[pair].candidates;
        for point in kept[..count].iter().map(|i| &manifold.points[*i]) {
            let on_b = units::metres64(second.pose * point.local_p2);
            candidates.push(Candidate {
                on_a: units::metres64(first.pose * point.local_p1),
                opposite: Opposite::Point { on_b, normal },
                friction,
                shapes: [None, None],
            });
        }
    }

    /// Two bodies of the hand. Returns a lower bound of their distance if nothing was found, metres.
    pub(super) fn body_and_body(
        &mut self,
        model: &Model,
        pair: usize,
        (a, b): (usize, usize),
        a_from_b: &Isometry3<f64>,
        margin: f64,
    ) -> f64 {
        let reach = units::length(margin);
        let mut clearance = f64::INFINITY;
        for first in model.shapes_of[a].clone() {
            for second in model.shapes_of[b].clone().filter(|second| model.shapes_touch(first, *second)) {
                let (one, two) = (&model.shapes[first], &model.shapes[second]);
                let place = one.body_from_shape.inv_mul(a_from_b) * two.body_from_shape;
                let apart = place.translation.vector.norm() - one.radius - two.radius;
                clearance = clearance.min(apart.max(margin));
                if apart > margin
                    || !self.contact(
                        Dispatcher::default(),
                        &units::pose(&place),
                        &*one.shape,
                        &*two.shape,
                        Vector::ZERO,
                        reach,
                    )
                {
                    continue;
                }
                let manifold = &self.manifold;
                let (kept, count) = chosen(manifold, reach);
                let normal = one.body_from_shape.rotation * units::direction(manifold.local_n1);
                let candidates = &mut self.pairs[pair].candidates;
                for point in kept[..count].iter().map(|i| &manifold.points[*i]) {
                    let on = |shape: &HandShape, p| (shape.body_from_shape * Point3::from(units::metres64(p))).coords;
                    candidates.push(Candidate {
                        on_a: on(one, point.local_p1),
                        opposite: Opposite::Point { on_b: on(two, point.local_p2), normal },
                        friction: one.friction * two.friction,
                        shapes: [Some(first as u16), Some(second as u16)],
                    });
                }
            }
        }
        clearance
    }

    /// Computes the manifold of two convex shapes. Returns false if parry does not support the pair.
    pub(super) fn contact(
        &mut self,
        dispatcher: Dispatcher,
        first_from_second: &Pose,
        first: &dyn Shape,
        second: &dyn Shape,
        direction: Vector,
        reach: f32,
    ) -> bool {
        let manifold = &mut self.manifold;
        manifold.clear();
        manifold.local_n1 = direction;
        dispatcher.contact_manifold_convex_convex(first_from_second, first, second, None, None, reach, manifold).is_ok()
    }
}

/// Bounding box of a shape of the hand, in the object's frame; parry's lengths.
struct PlacedBox {
    center: Vector,
    half: Vector,
    /// Half extents along the object's axes.
    spread: Vector,
    inverse: Pose,
    /// Absolute values of the inverse rotation's entries, by column.
    turn: [Vector; 3],
}

impl PlacedBox {
    fn new(pose: &Pose, half: Vector) -> Self {
        let turn = Matrix::from_quat(pose.rotation);
        let spread = turn.x_axis.abs() * half.x + turn.y_axis.abs() * half.y + turn.z_axis.abs() * half.z;
        let inverse = pose.inverse();
        let back = Matrix::from_quat(inverse.rotation);
        let turn = [back.x_axis.abs(), back.y_axis.abs(), back.z_axis.abs()];
        Self { center: pose.translation, half, spread, inverse, turn }
    }

    /// Greatest separation from the bounds along an axis of the object; negative if they overlap along all of them.
    #[inline]
    fn apart_outside(&self, bounds: &Aabb) -> f32 {
        ((bounds.mins - self.center).max(self.center - bounds.maxs) - self.spread).max_element()
    }

    /// Greatest separation from the bounds along an axis of the object or of the box. The box's axes are tested only if the object's do not
    /// separate them by more than `reach`.
    #[inline]
    fn apart(&self, bounds: &Aabb, reach: f32) -> f32 {
        let outside = self.apart_outside(bounds);
        if outside > reach {
            return outside;
        }
        let center = self.inverse * bounds.center();
        let own = bounds.half_extents();
        let spread = self.turn[0] * own.x + self.turn[1] * own.y + self.turn[2] * own.z;
        outside.max((center.abs() - spread - self.half).max_element())
    }
}
