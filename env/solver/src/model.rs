//! Data shared by all worlds of one template: the tree and the object, prepared for simulation.

use nalgebra::{Isometry3, Point3, Vector3};
use parry3d::bounding_volume::Aabb;
use parry3d::math::{Pose, Vector};
use parry3d::shape::SharedShape;
use std::ops::Range;

use crate::config::NewtonConfig;
use crate::error::ModelError;
use crate::object::{Object, ObjectPart, corners};
use crate::scenery::Scenery;
use crate::tree::{BodyShape, JointKind, Tree};
use crate::units;

/// Index of a body in contacts: the object, the bodies of the hand (base first), then the scenery (table and ground).
pub type BodyIndex = usize;
/// The object.
pub const OBJECT: BodyIndex = 0;
/// The hand's base; body `i` of the tree is `BASE + i`.
pub const BASE: BodyIndex = 1;

/// Kind of contact search that a pair of bodies needs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PairKind {
    /// A body and the scenery.
    Scenery,
    /// Two bodies, shape by shape.
    Bodies,
}

/// Two bodies that may touch.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pair {
    pub a: BodyIndex,
    pub b: BodyIndex,
    pub kind: PairKind,
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

/// A convex part of the object, ready for parry.
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
    /// Index of the hand's shape; `None` for the object.
    pub shape: Option<u16>,
}

/// Data shared by all worlds of one template.
pub struct Model {
    pub(crate) tree: Tree,
    pub(crate) object: Object,
    pub(crate) scenery: Scenery,
    pub(crate) config: NewtonConfig,
    pub(crate) shapes: Vec<HandShape>,
    /// Body (of the tree) and index within it, for every shape.
    pub(crate) shape_owner: Vec<(usize, usize)>,
    /// Range of shapes of each body of the tree.
    pub(crate) shapes_of: Vec<Range<usize>>,
    pub(crate) parts: Vec<Part>,
    pub(crate) object_bounds: Aabb,
    /// By [`BodyIndex`].
    pub(crate) corners: Vec<Vec<Corners>>,
    /// Bounding spheres in the bodies' frames, by [`BodyIndex`].
    pub(crate) center: Vec<Vector3<f64>>,
    pub(crate) radius: Vec<f64>,
    pub(crate) pairs: Vec<Pair>,
    /// Free coordinates that move each body of the tree, as a range.
    pub(crate) columns: Vec<Range<usize>>,
    /// Range of coordinates that each free coordinate is coupled with in the mass matrix.
    pub(crate) blocks: Vec<Range<usize>>,
    /// Metres per unit of each unknown, to compare linear and angular velocities: 1 for metres, [`LEVER`] for radians.
    pub(crate) levers: Vec<f64>,
}

/// Lever at which angular velocities count, metres per radian: the size of a grasped object.
const LEVER: f64 = 0.05;

impl Model {
    /// Prepares a hand and an object.
    ///
    /// # Errors
    /// [`ModelError`] for a tree or an object that breaks the rules of [`Tree`] and [`Object`].
    pub fn new(tree: Tree, object: Object, scenery: Scenery, config: NewtonConfig) -> Result<Self, ModelError> {
        tree.check()?;
        let (mut shapes, mut shape_owner, mut shapes_of) = (Vec::new(), Vec::new(), Vec::new());
        let (mut all_corners, mut center, mut radius) = (Vec::new(), Vec::new(), Vec::new());
        let prepare =
            |(index, own): (usize, &ObjectPart)| own.shape().map(part).ok_or(ModelError::FlatPart { part: index });
        let parts = object.parts.iter().enumerate().map(prepare).collect::<Result<Vec<Part>, _>>()?;
        let (object_corners, sphere) = corners_of_object(&parts, object.friction);
        all_corners.push(vec![object_corners]);
        center.push(sphere.0);
        radius.push(sphere.1);
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
        let object_bounds = parts.iter().map(|p| p.bounds).reduce(merged).unwrap_or_else(Aabb::new_invalid);
        let (pairs, columns) = (pairs(&tree), columns(&tree));
        let (blocks, levers) = (blocks(&tree, &columns), levers(&tree));
        Ok(Self {
            tree,
            object,
            scenery,
            config,
            shapes,
            shape_owner,
            shapes_of,
            parts,
            object_bounds,
            corners: all_corners,
            center,
            radius,
            pairs,
            columns,
            blocks,
            levers,
        })
    }

    /// The hand.
    #[must_use]
    pub fn tree(&self) -> &Tree {
        &self.tree
    }

    /// Height of the object's lowest point at pose `from_object`, along z of that frame, metres.
    #[must_use]
    pub fn lowest_point(&self, from_object: &Isometry3<f64>) -> f64 {
        let lowest = |part: &Part| part.shape.compute_aabb(&units::pose(&(from_object * part.object_from_part))).mins.z;
        units::metres(self.parts.iter().map(lowest).fold(f32::MAX, f32::min))
    }

    /// Number of unknown velocities of a step: the free coordinates, and six of the object.
    #[must_use]
    pub fn unknowns(&self) -> usize {
        self.tree.coordinates.len() + 6
    }

    /// [`BodyIndex`] of the scenery.
    #[must_use]
    pub fn scenery_body(&self) -> BodyIndex {
        BASE + self.tree.bodies.len()
    }
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

fn pairs(tree: &Tree) -> Vec<Pair> {
    let scenery = BASE + tree.bodies.len();
    let mut pairs = vec![Pair { a: OBJECT, b: scenery, kind: PairKind::Scenery }];
    let solid = |body: usize| !tree.bodies[body].shapes.is_empty();
    let columns = columns(tree);
    let moves = |body: usize| !columns[body].is_empty();
    for body in (0..tree.bodies.len()).filter(|body| solid(*body)) {
        pairs.push(Pair { a: OBJECT, b: BASE + body, kind: PairKind::Bodies });
    }
    for body in (0..tree.bodies.len()).filter(|body| solid(*body) && moves(*body)) {
        pairs.push(Pair { a: BASE + body, b: scenery, kind: PairKind::Scenery });
    }
    for &(a, b) in tree.pairs.iter().filter(|(a, b)| solid(*a) && solid(*b) && (moves(*a) || moves(*b))) {
        pairs.push(Pair { a: BASE + a, b: BASE + b, kind: PairKind::Bodies });
    }
    pairs
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
    levers.extend([1.0, 1.0, 1.0, LEVER, LEVER, LEVER]);
    levers
}

#[cfg(test)]
impl Model {
    /// A ball over a table, and a hand of one body without mass or shapes.
    pub(crate) fn of_ball(mass: f64, inertia: f64) -> Self {
        use crate::tree::{Body, Primitive};
        use nalgebra::Matrix3;

        let base = Body {
            center: Point3::origin(),
            inertia: Matrix3::zeros(),
            mass: 0.0,
            parent: 0,
            joint: None,
            shapes: vec![],
        };
        let object = Object {
            parts: vec![ObjectPart::Primitive(Primitive::Sphere { radius: 0.03 })],
            mass,
            center: Point3::origin(),
            inertia: Matrix3::identity() * inertia,
            friction: 1.0,
        };
        let scenery = Scenery { table_side: 1.2, table_thickness: 0.1, table_height: 0.75, friction: 0.5 };
        let tree = Tree { bodies: vec![base], ..Tree::default() };
        Self::new(tree, object, scenery, NewtonConfig::default()).unwrap()
    }
}
