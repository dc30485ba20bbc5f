//! Shapes of the hand against parts of the object and against each other, by parry.

use nalgebra::{Isometry3, Point3};
use parry3d::bounding_volume::{Aabb, BoundingVolume};
use parry3d::math::{Matrix, Pose, Vector};
use parry3d::query::PersistentQueryDispatcher;
use parry3d::shape::Shape;

use super::manifold::chosen;
use super::{Candidate, Opposite, Searcher};
use crate::dispatch::Dispatcher;
use crate::model::{BASE, BodyIndex, HandShape, Model, Part};
use crate::units;

impl Searcher {
    /// The object against a body of the hand.
    pub(super) fn object_and_body(
        &mut self,
        model: &Model,
        pair: usize,
        body: BodyIndex,
        object_from_body: &Isometry3<f64>,
        margin: f64,
    ) {
        let reach = units::length(margin);
        for index in model.shapes_of[body - BASE].clone() {
            let shape = &model.shapes[index];
            let pose = units::pose(&(object_from_body * shape.body_from_shape));
            let bounds = box_bounds(&pose, shape.half).loosened(reach);
            if !bounds.intersects(&model.object_bounds) {
                continue;
            }
            for (p, part) in model.parts.iter().enumerate() {
                if bounds.intersects(&part.bounds) && !apart(&pose, shape.half, &part.bounds, reach) {
                    let of_pair = index * model.parts.len() + p;
                    self.part_and_shape(pair, (part, model.object.friction), (shape, index), &pose, of_pair, reach);
                }
            }
        }
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
        if !self.contact(&part_from_shape, &*part.shape, &*shape.shape, direction, reach) {
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

    /// Two bodies of the hand.
    pub(super) fn body_and_body(
        &mut self,
        model: &Model,
        pair: usize,
        (a, b): (BodyIndex, BodyIndex),
        a_from_b: &Isometry3<f64>,
        margin: f64,
    ) {
        let reach = units::length(margin);
        for first in model.shapes_of[a - BASE].clone() {
            for second in model.shapes_of[b - BASE].clone() {
                let (one, two) = (&model.shapes[first], &model.shapes[second]);
                let place = one.body_from_shape.inv_mul(a_from_b) * two.body_from_shape;
                if place.translation.vector.norm() > one.radius + two.radius + margin
                    || !self.contact(&units::pose(&place), &*one.shape, &*two.shape, Vector::ZERO, reach)
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
    }

    /// Fills the manifold of two convex shapes; false where parry knows no way.
    pub(super) fn contact(
        &mut self,
        first_from_second: &Pose,
        first: &dyn Shape,
        second: &dyn Shape,
        direction: Vector,
        reach: f32,
    ) -> bool {
        let manifold = &mut self.manifold;
        manifold.clear();
        manifold.local_n1 = direction;
        Dispatcher.contact_manifold_convex_convex(first_from_second, first, second, None, None, reach, manifold).is_ok()
    }
}

/// Bounds of a box.
fn box_bounds(pose: &Pose, half: Vector) -> Aabb {
    let turn = Matrix::from_quat(pose.rotation);
    let reach = turn.x_axis.abs() * half.x + turn.y_axis.abs() * half.y + turn.z_axis.abs() * half.z;
    Aabb::new(pose.translation - reach, pose.translation + reach)
}

/// True where the box's own axes separate it from the part's bounds by more than `reach`.
fn apart(pose: &Pose, half: Vector, bounds: &Aabb, reach: f32) -> bool {
    let inverse = pose.inverse();
    let center = inverse * bounds.center();
    let turn = Matrix::from_quat(inverse.rotation);
    let own = bounds.half_extents();
    let spread = turn.x_axis.abs() * own.x + turn.y_axis.abs() * own.y + turn.z_axis.abs() * own.z;
    (center.abs() - spread - half).max_element() > reach
}
