//! Data shared by all worlds of one template: the tree and the objects, prepared for simulation.

use nalgebra::{Isometry3, Point3, Vector3};
use parry3d::bounding_volume::Aabb;
use parry3d::math::{Pose, Vector};
use parry3d::shape::SharedShape;
use std::collections::HashSet;
use std::ops::Range;

use crate::config::ImplicitConfig;
use crate::error::ModelError;
use crate::limits::{MAX_OBJECTS, MAX_WALLS};
use crate::object::{Object, ObjectPart, corners};
use crate::scenery::Scenery;
use crate::tree::{BodyShape, JointKind, Tree};
use crate::units;

/// Index of a body in contacts: the objects, the bodies of the hand (base first), then the scenery (table, ground and walls).
pub type BodyIndex = usize;

/// What a [`BodyIndex`] refers to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BodyKind {
    /// An object, by its index.
    Object(usize),
    /// A body of the tree, by its index; 0 is the base.
    Hand(usize),
    /// Table, ground and walls.
    Scenery,
}

/// Two bodies that may touch.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    pub a: BodyIndex,
    pub b: BodyIndex,
    /// Kinds of both.
    pub sides: [BodyKind; 2],
}

/// A shape of the hand, ready for parry.
pub(crate) struct HandShape {
    pub body_from_shape: Isometry3<f64>,
    pub shape: SharedShape,
    /// Half extents of its bounding box, parry's lengths.
    pub half: Vector,
    /// Radius of its bounding sphere, metres.
    pub radius: f64,
    pub friction: f64,
}

/// An object, ready for simulation.
pub(crate) struct FreeObject {
    pub own: Object,
    pub parts: Vec<Part>,
    /// Bounding box of all parts, object's frame; parry's lengths.
    pub bounds: Aabb,
    /// Index of the first of its pairs of a hand shape and a part, see `Searcher::directions`.
    pub first_direction: usize,
}

/// A convex part of an object, ready for parry.
pub(crate) struct Part {
    pub shape: SharedShape,
    pub pose: Pose,
    pub inverse: Pose,
    pub bounds: Aabb,
    pub object_from_part: Isometry3<f64>,
}

/// Corners of a body, or of one of its shapes, for contacts with planes.
pub(crate) struct Corners {
    pub points: Vec<Vector3<f64>>,
    /// Radius of a ball about each point.
    pub radius: f64,
    pub friction: f64,
    /// Index of the hand's shape; `None` for an object.
    pub shape: Option<u16>,
}

/// Data shared by all worlds of one template.
pub struct Model {
    pub(crate) tree: Tree,
    pub(crate) objects: Vec<FreeObject>,
    pub(crate) scenery: Scenery,
    pub(crate) config: ImplicitConfig,
    pub(crate) shapes: Vec<HandShape>,
    /// Body (of the tree) and index within it, for every shape.
    pub(crate) shape_owner: Vec<(usize, usize)>,
    /// Range of shapes of each body of the tree.
    pub(crate) shapes_of: Vec<Range<usize>>,
    /// By [`BodyIndex`].
    pub(crate) corners: Vec<Vec<Corners>>,
    /// Bounding spheres in the bodies' frames, by [`BodyIndex`].
    pub(crate) center: Vec<Vector3<f64>>,
    pub(crate) radius: Vec<f64>,
    pub(crate) pairs: Vec<Pair>,
    /// Shapes that pass through each other, by their indices in `shapes`.
    pub(crate) apart: HashSet<[usize; 2]>,
    /// Free coordinates that move each body of the tree, as a range.
    pub(crate) columns: Vec<Range<usize>>,
    /// Range of coordinates that each free coordinate is coupled with in the mass matrix.
    pub(crate) blocks: Vec<Range<usize>>,
    /// Metres per unit of each free coordinate, to compare linear and angular velocities: 1 for metres, [`LEVER`] for radians.
    pub(crate) levers: Vec<f64>,
}

/// Lever at which angular velocities count, metres per radian: the size of a grasped object.
pub(crate) const LEVER: f64 = 0.05;

impl Model {
    /// Prepares a hand and any number of objects, up to [`MAX_OBJECTS`].
    ///
    /// # Errors
    /// [`ModelError`] for a tree or an object that breaks the rules of [`Tree`] and [`Object`], and for too many objects or walls.
    pub fn new(tree: Tree, objects: Vec<Object>, scenery: Scenery, config: ImplicitConfig) -> Result<Self, ModelError> {
        tree.check()?;
        if scenery.walls.len() > MAX_WALLS {
            return Err(ModelError::TooManyWalls { count: scenery.walls.len() });
        }
        if objects.len() > MAX_OBJECTS {
            return Err(ModelError::TooManyObjects { count: objects.len() });
        }
        let (mut shapes, mut shape_owner, mut shapes_of) = (Vec::new(), Vec::new(), Vec::new());
        let (mut all_corners, mut center, mut radius) = (Vec::new(), Vec::new(), Vec::new());
        let objects = objects.into_iter().enumerate().map(free_object).collect::<Result<Vec<FreeObject>, _>>()?;
        for object in &objects {
            let (object_corners, sphere) = corners_of_object(&object.parts, object.own.friction);
            all_corners.push(vec![object_corners]);
            center.push(sphere.0);
            radius.push(sphere.1);
        }
        for (index, body) in tree.bodies.iter().enumerate() {
            let first = shapes.len();
            let mut own = Vec::new();
            for (within, shape) in body.shapes.iter().enumerate() {
                let prepared = hand_shape(shape);
                own.push(corners_of_shape(&prepared, shapes.len() as u16));
                shapes.push(prepared);
                shape_owner.push((index, within));
            }
            let (c, r) = bounding_sphere(&own);
            all_corners.push(own);
            center.push(c);
            radius.push(r);
            shapes_of.push(first..shapes.len());
        }
        let objects = with_directions(objects, shapes.len());
        let (pairs, columns) = (pairs(&tree, objects.len()), columns(&tree));
        let (blocks, levers) = (blocks(&tree, &columns), levers(&tree));
        let apart = apart(&tree, &shapes_of);
        Ok(Self {
            tree,
            objects,
            scenery,
            config,
            shapes,
            shape_owner,
            shapes_of,
            corners: all_corners,
            center,
            radius,
            pairs,
            apart,
            columns,
            blocks,
            levers,
        })
    }

    /// Whether two shapes of the hand touch where they meet.
    pub(crate) fn shapes_touch(&self, first: usize, second: usize) -> bool {
        self.apart.is_empty() || !self.apart.contains(&[first.min(second), first.max(second)])
    }

    /// The hand.
    #[must_use]
    pub fn tree(&self) -> &Tree {
        &self.tree
    }

    #[must_use]
    pub fn object_count(&self) -> usize {
        self.objects.len()
    }

    /// Height of the lowest point of object `index` at pose `from_object`, along z of that frame, metres.
    #[must_use]
    pub fn lowest_point(&self, index: usize, from_object: &Isometry3<f64>) -> f64 {
        let lowest = |part: &Part| part.shape.compute_aabb(&units::pose(&(from_object * part.object_from_part))).mins.z;
        units::metres(self.objects[index].parts.iter().map(lowest).fold(f32::MAX, f32::min))
    }

    /// [`BodyIndex`] of the hand's base; body `i` of the tree is `base() + i`.
    #[must_use]
    pub fn base(&self) -> BodyIndex {
        self.objects.len()
    }

    #[must_use]
    pub fn scenery_body(&self) -> BodyIndex {
        self.base() + self.tree.bodies.len()
    }

    /// Kind of a body.
    #[must_use]
    #[inline]
    pub fn kind(&self, body: BodyIndex) -> BodyKind {
        let base = self.base();
        if body < base {
            BodyKind::Object(body)
        } else if body < base + self.tree.bodies.len() {
            BodyKind::Hand(body - base)
        } else {
            BodyKind::Scenery
        }
    }
}

fn free_object((index, own): (usize, Object)) -> Result<FreeObject, ModelError> {
    let prepare = |(part_index, each): (usize, &ObjectPart)| {
        each.shape().map(part).ok_or(ModelError::FlatPart { object: index, part: part_index })
    };
    let parts = own.parts.iter().enumerate().map(prepare).collect::<Result<Vec<Part>, _>>()?;
    let bounds = parts.iter().map(|p| p.bounds).reduce(merged).unwrap_or_else(Aabb::new_invalid);
    Ok(FreeObject { own, parts, bounds, first_direction: 0 })
}

/// Numbers the pairs of a hand shape and a part.
fn with_directions(mut objects: Vec<FreeObject>, shapes: usize) -> Vec<FreeObject> {
    let mut next = 0;
    for object in &mut objects {
        object.first_direction = next;
        next += shapes * object.parts.len();
    }
    objects
}

fn part((shape, object_from_part): (SharedShape, Isometry3<f64>)) -> Part {
    let pose = units::pose(&object_from_part);
    Part { bounds: shape.compute_aabb(&pose), inverse: pose.inverse(), pose, shape, object_from_part }
}

fn merged(mut a: Aabb, b: Aabb) -> Aabb {
    a.mins = a.mins.min(b.mins);
    a.maxs = a.maxs.max(b.maxs);
    a
}

fn hand_shape(shape: &BodyShape) -> HandShape {
    let (own, turn) = shape.primitive.shape();
    let half = own.compute_local_aabb().half_extents();
    HandShape {
        body_from_shape: shape.body_from_shape * turn,
        radius: units::metres(half.length()),
        half,
        shape: own,
        friction: shape.friction,
    }
}

fn corners_of_shape(shape: &HandShape, index: u16) -> Corners {
    let (points, radius) = corners(&shape.shape);
    let points = points.iter().map(|p| (shape.body_from_shape * Point3::from(*p)).coords).collect();
    Corners { points, radius, friction: shape.friction, shape: Some(index) }
}

fn corners_of_object(parts: &[Part], friction: f64) -> (Corners, (Vector3<f64>, f64)) {
    let (mut points, mut extra) = (Vec::new(), 0.0_f64);
    for part in parts {
        let (own, radius) = corners(&part.shape);
        extra = extra.max(radius);
        points.extend(own.iter().map(|p| (part.object_from_part * Point3::from(*p)).coords));
    }
    let found = Corners { points, radius: extra, friction, shape: None };
    let sphere = bounding_sphere(std::slice::from_ref(&found));
    (found, sphere)
}

/// Centre of the bounding box of all corners, and the radius of the sphere about it that contains them.
fn bounding_sphere(corners: &[Corners]) -> (Vector3<f64>, f64) {
    let points = || corners.iter().flat_map(|c| c.points.iter().map(move |p| (p, c.radius)));
    if points().next().is_none() {
        return (Vector3::zeros(), 0.0);
    }
    let (mut low, mut high) = (Vector3::repeat(f64::MAX), Vector3::repeat(f64::MIN));
    for (p, _) in points() {
        low = low.inf(p);
        high = high.sup(p);
    }
    let center = (low + high) / 2.0;
    (center, points().map(|(p, r)| (p - center).norm() + r).fold(0.0, f64::max))
}

fn pairs(tree: &Tree, objects: usize) -> Vec<Pair> {
    let mut pairs = Vec::new();
    let solid = |body: usize| !tree.bodies[body].shapes.is_empty();
    let columns = columns(tree);
    let moves = |body: usize| !columns[body].is_empty();
    let index = |side: BodyKind| match side {
        BodyKind::Object(object) => object,
        BodyKind::Hand(body) => objects + body,
        BodyKind::Scenery => objects + tree.bodies.len(),
    };
    let mut push = |a: BodyKind, b: BodyKind| pairs.push(Pair { a: index(a), b: index(b), sides: [a, b] });
    for object in (0..objects).map(BodyKind::Object) {
        push(object, BodyKind::Scenery);
        for body in (0..tree.bodies.len()).filter(|body| solid(*body)) {
            push(object, BodyKind::Hand(body));
        }
        for other in index(object) + 1..objects {
            push(object, BodyKind::Object(other));
        }
    }
    for body in (0..tree.bodies.len()).filter(|body| solid(*body) && moves(*body)) {
        push(BodyKind::Hand(body), BodyKind::Scenery);
    }
    for &(a, b) in tree.pairs.iter().filter(|(a, b)| solid(*a) && solid(*b) && (moves(*a) || moves(*b))) {
        push(BodyKind::Hand(a), BodyKind::Hand(b));
    }
    pairs
}

/// Shapes that pass through each other, by the range of shapes of each body; the lesser index is first.
fn apart(tree: &Tree, shapes_of: &[Range<usize>]) -> HashSet<[usize; 2]> {
    let index = |(body, within): (usize, usize)| shapes_of[body].start + within;
    let sorted = |pair: &[(usize, usize); 2]| {
        let [a, b] = pair.map(index);
        [a.min(b), a.max(b)]
    };
    tree.apart.iter().map(sorted).collect()
}

/// For each body, the smallest range that contains the free coordinates between it and the base.
fn columns(tree: &Tree) -> Vec<Range<usize>> {
    let free = tree.coordinates.len();
    let mut columns: Vec<Range<usize>> = Vec::with_capacity(tree.bodies.len());
    for body in &tree.bodies {
        let Some(joint) = &body.joint else {
            columns.push(0..0);
            continue;
        };
        let above = columns[body.parent].clone();
        columns.push(match joint.coordinate {
            c if c >= free => above,
            c if above.is_empty() => c..c + 1,
            c => above.start.min(c)..above.end.max(c + 1),
        });
    }
    columns
}

/// For each free coordinate, the smallest range that contains the columns of all bodies that it moves.
fn blocks(tree: &Tree, columns: &[Range<usize>]) -> Vec<Range<usize>> {
    let mut blocks: Vec<Range<usize>> = (0..tree.coordinates.len()).map(|i| i..i + 1).collect();
    for range in columns {
        for block in &mut blocks[range.clone()] {
            *block = block.start.min(range.start)..block.end.max(range.end);
        }
    }
    blocks
}

fn levers(tree: &Tree) -> Vec<f64> {
    let mut levers = vec![LEVER; tree.coordinates.len()];
    for joint in tree.bodies.iter().filter_map(|b| b.joint.as_ref()) {
        if joint.kind == JointKind::Prismatic && joint.coordinate < levers.len() {
            levers[joint.coordinate] = 1.0;
        }
    }
    levers
}

#[cfg(test)]
use crate::tree::Coordinate;

#[cfg(test)]
impl Model {
    /// A ball over a table, and a hand of one body without mass or shapes.
    pub(crate) fn of_ball(mass: f64, inertia: f64) -> Self {
        Self::for_test(Tree { bodies: vec![tests::body(None)], ..Tree::default() }, vec![tests::ball(mass, inertia)])
    }

    /// A ball over a table, and a hand.
    pub(crate) fn of_tree(tree: Tree) -> Self {
        Self::for_test(tree, vec![tests::ball(0.1, 1e-4)])
    }

    /// Two balls over a table, and a finger of two joints without shapes.
    pub(crate) fn of_balls_and_finger() -> Self {
        let bodies = vec![tests::body(None), tests::body(Some(0)), tests::body(Some(1))];
        let tree = Tree { bodies, coordinates: vec![Coordinate::FREE; 2], ..Tree::default() };
        Self::for_test(tree, vec![tests::ball(0.2, 7e-5); 2])
    }

    fn for_test(tree: Tree, objects: Vec<Object>) -> Self {
        Self::new(tree, objects, tests::scenery(), ImplicitConfig::default()).unwrap()
    }
}

#[cfg(test)]
impl Coordinate {
    /// Without armature, spring or losses; far stops.
    pub(crate) const FREE: Self = Self {
        armature: 0.0,
        damping: 0.0,
        stiffness: 0.0,
        spring_reference: 0.0,
        limits: [-10.0, 10.0],
        stop_stiffness: 0.0,
    };
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tree::{Body, Joint, Primitive};
    use nalgebra::Matrix3;

    pub(super) fn scenery() -> Scenery {
        Scenery { table_side: 1.2, table_thickness: 0.1, table_height: 0.75, walls: vec![], friction: 0.5 }
    }

    /// A body without shapes; with a coordinate, on a joint to the body before it.
    pub(super) fn body(coordinate: Option<usize>) -> Body {
        let joint = coordinate.map(|coordinate| Joint {
            kind: JointKind::Revolute,
            parent_from_joint: Isometry3::translation(0.05, 0.0, 0.02),
            axis: Vector3::y_axis(),
            coordinate,
            ratio: 1.0,
            offset: 0.0,
        });
        let parent = coordinate.unwrap_or(0);
        let (center, inertia) = (Point3::origin(), Matrix3::zeros());
        Body { center, inertia, mass: 0.0, parent, joint, shapes: vec![] }
    }

    pub(super) fn ball(mass: f64, inertia: f64) -> Object {
        Object {
            parts: vec![ObjectPart::Primitive(Primitive::Sphere { radius: 0.03 })],
            mass,
            center: Point3::origin(),
            inertia: Matrix3::identity() * inertia,
            friction: 1.0,
        }
    }

    /// The order of bodies: objects, hand, scenery.
    #[test]
    fn bodies_have_kinds() {
        let model = Model::of_balls_and_finger();
        let kinds: Vec<BodyKind> = (0..=model.scenery_body()).map(|body| model.kind(body)).collect();
        let expected = [
            BodyKind::Object(0),
            BodyKind::Object(1),
            BodyKind::Hand(0),
            BodyKind::Hand(1),
            BodyKind::Hand(2),
            BodyKind::Scenery,
        ];
        assert_eq!(kinds, expected);
    }

    #[test]
    fn too_many_objects_are_refused() {
        let hand = Tree { bodies: vec![body(None)], ..Tree::default() };
        let objects = vec![ball(0.1, 1e-4); MAX_OBJECTS + 1];
        let error = Model::new(hand, objects, scenery(), ImplicitConfig::default()).err();
        assert_eq!(error, Some(ModelError::TooManyObjects { count: MAX_OBJECTS + 1 }));
    }
}
