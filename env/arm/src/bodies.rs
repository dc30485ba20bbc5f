//! Collision shapes of an arm and of the open hand that it carries, body by body, and the pairs of them that may touch.
//!
//! Pairs that touch by design are derived: bodies next to each other, those that overlap at home, and those that overlap in nearly all postures.

use crate::chain::{Chain, Frames, MAX_AXES, Positions};
use crate::error::ArmError;
use crate::postures::within_limits;
use graspbox_hand::{Arm, Hand, PlacedShape, Shape};
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use parry3d_f64::math::{Pose, Rotation, Vector};
use parry3d_f64::query::intersection_test;
use parry3d_f64::shape::SharedShape;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Postures by which pairs are found that overlap always, and the share of them that is enough.
const SAMPLES: usize = 200;
const ALWAYS: f64 = 0.95;

/// A collision shape in the frame of its body.
#[derive(Clone)]
pub(crate) struct Solid {
    pub shape: Shape,
    pub solid: SharedShape,
    pub body_from_shape: Isometry3<f64>,
    /// Radius of a sphere about its centre that contains it, metres.
    pub radius: f64,
}

impl Solid {
    pub(crate) fn new(shape: &Shape, body_from_shape: Isometry3<f64>) -> Self {
        Self { shape: *shape, solid: library_shape(shape, 0.0), body_from_shape, radius: radius(shape) }
    }

    fn overlaps(&self, own: &Isometry3<f64>, other: &Self, theirs: &Isometry3<f64>) -> bool {
        let apart = (own.translation.vector - theirs.translation.vector).norm_squared();
        let reach = self.radius + other.radius;
        // Unsupported pairs do not occur: all shapes are convex.
        apart < reach * reach
            && intersection_test(
                &library_pose(own, &self.shape),
                &*self.solid.0,
                &library_pose(theirs, &other.shape),
                &*other.solid.0,
            )
            .map_or(true, |hit| hit.intersecting)
    }
}

impl std::fmt::Debug for Solid {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Solid({:?})", self.shape)
    }
}

fn radius(shape: &Shape) -> f64 {
    match shape {
        Shape::Cuboid(half) => half.norm(),
        Shape::Cylinder { radius, half_length } => radius.hypot(*half_length),
        Shape::Sphere { radius } => *radius,
    }
}

/// A shape of the collision library, grown on every side.
pub(crate) fn library_shape(shape: &Shape, by: f64) -> SharedShape {
    match *shape {
        Shape::Cuboid(half) => SharedShape::cuboid(half.x + by, half.y + by, half.z + by),
        Shape::Cylinder { radius, half_length } => SharedShape::cylinder(half_length + by, radius + by),
        Shape::Sphere { radius } => SharedShape::ball(radius + by),
    }
}

/// A pose of the collision library, whose cylinders are about y.
pub(crate) fn library_pose(at: &Isometry3<f64>, shape: &Shape) -> Pose {
    let turn = match shape {
        Shape::Cylinder { .. } => UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2),
        Shape::Cuboid(_) | Shape::Sphere { .. } => UnitQuaternion::identity(),
    };
    library(&(at * turn))
}

/// The same pose for the collision library.
pub(crate) fn library(at: &Isometry3<f64>) -> Pose {
    let (v, q) = (at.translation.vector, at.rotation.coords);
    Pose::from_parts(Vector::new(v.x, v.y, v.z), Rotation::from_xyzw(q.x, q.y, q.z, q.w))
}

/// A rigid body: its shapes, and a sphere that contains them.
#[derive(Clone, Debug)]
pub(crate) struct Body {
    pub solids: Vec<Solid>,
    pub center: Point3<f64>,
    pub radius: f64,
}

impl Body {
    pub(crate) fn new(solids: Vec<Solid>) -> Self {
        let count = solids.len().max(1) as f64;
        let center = solids.iter().map(|solid| solid.body_from_shape.translation.vector).sum::<Vector3<f64>>() / count;
        let reach = |solid: &Solid| (solid.body_from_shape.translation.vector - center).norm() + solid.radius;
        let radius = solids.iter().map(reach).fold(0.0, f64::max);
        Self { solids, center: center.into(), radius }
    }

    fn of_hand(shapes: &[PlacedShape<'_>], body_from_hand: &Isometry3<f64>) -> Self {
        Self::new(shapes.iter().map(|s| Solid::new(&s.collider.shape, body_from_hand * s.hand_from_shape)).collect())
    }
}

/// The bodies of an arm: 0 is the base, `i + 1` is what axis `i` moves.
#[derive(Clone, Debug)]
pub struct ArmBodies {
    pub(crate) bodies: Vec<Body>,
    /// Name of the first link of each body.
    names: Vec<String>,
    /// Pairs that may touch.
    pub(crate) pairs: Vec<[usize; 2]>,
    /// Pairs, other than bodies next to each other, that touch by design.
    by_design: Vec<[usize; 2]>,
}

/// Bodies of a posture: pose of every shape, body by body, in the base's frame.
#[derive(Debug)]
pub(crate) struct Placed {
    shapes: Vec<Vec<Isometry3<f64>>>,
    centers: Vec<Point3<f64>>,
}

/// An open hand on a flange.
#[derive(Clone, Debug)]
pub struct Carried {
    pub(crate) body: Body,
    /// Bodies of the arm that it may touch.
    pub(crate) meets: Vec<usize>,
}

/// The frame of a body in the base's frame.
pub(crate) fn frame(frames: &Frames, body: usize) -> Isometry3<f64> {
    body.checked_sub(1).map_or_else(Isometry3::identity, |axis| frames.axes[axis].isometry())
}

impl ArmBodies {
    /// The bodies of an arm.
    #[must_use]
    pub fn new(arm: &Arm, chain: &Chain) -> Self {
        let mut carriers = vec![0];
        carriers.extend(arm.axes.iter().map(|axis| arm.joints[axis.joint].child));
        let poses = arm.forward_kinematics(&vec![0.0; arm.axes.len()]).unwrap_or_default();
        let solids = |body: usize| {
            let first = carriers[body];
            let links = (0..arm.links.len()).filter(|link| arm.carrier(*link) == first);
            let body_from_first =
                body.checked_sub(1).map_or_else(Isometry3::identity, |axis| *chain.axis_from_link(axis));
            links
                .flat_map(|link| {
                    let body_from_link = body_from_first * poses[first].inverse() * poses[link];
                    arm.links[link]
                        .colliders
                        .iter()
                        .map(move |collider| Solid::new(&collider.shape, body_from_link * collider.link_from_shape))
                })
                .collect()
        };
        let bodies: Vec<Body> = (0..carriers.len()).map(|body| Body::new(solids(body))).collect();
        let names = carriers.iter().map(|link| arm.links[*link].name.clone()).collect();
        let mut all = Self { bodies, names, pairs: Vec::new(), by_design: Vec::new() };
        all.find_pairs(chain);
        all
    }

    /// Number of bodies.
    #[must_use]
    pub fn count(&self) -> usize {
        self.bodies.len()
    }

    /// Name of a body: that of its first link.
    #[must_use]
    pub fn name(&self, body: usize) -> &str {
        &self.names[body]
    }

    /// Shapes of a body in its frame: that of its axis, or of the base.
    #[must_use]
    pub fn shapes(&self, body: usize) -> Vec<(Shape, Isometry3<f64>)> {
        self.bodies[body].solids.iter().map(|solid| (solid.shape, solid.body_from_shape)).collect()
    }

    /// True if every body is at least `distance` metres from a point of the base's frame, by spheres about its shapes.
    #[must_use]
    pub fn are_beyond(&self, frames: &Frames, point: &Point3<f64>, distance: f64) -> bool {
        self.bodies.iter().enumerate().filter(|(_, body)| !body.solids.is_empty()).all(|(index, body)| {
            let center = match index.checked_sub(1) {
                Some(axis) => frames.axes[axis].turn * body.center.coords + frames.axes[axis].shift,
                None => body.center.coords,
            };
            let apart =
                |place: Vector3<f64>, radius: f64| (place - point.coords).norm_squared() >= (distance + radius).powi(2);
            let place = |solid: &Solid| frame(frames, index) * Point3::from(solid.body_from_shape.translation.vector);
            apart(center, body.radius) || body.solids.iter().all(|solid| apart(place(solid).coords, solid.radius))
        })
    }

    /// Names of bodies that touch by design although they are not next to each other.
    #[must_use]
    pub fn by_design(&self) -> Vec<[&str; 2]> {
        self.by_design.iter().map(|pair| pair.map(|body| self.name(body))).collect()
    }

    /// Finds the pairs that may touch.
    fn find_pairs(&mut self, chain: &Chain) {
        let solid: Vec<usize> = (0..self.bodies.len()).filter(|body| !self.bodies[*body].solids.is_empty()).collect();
        let mut candidates = Vec::new();
        for (index, a) in solid.iter().enumerate() {
            // The next one with shapes is hinged to it, or to a body without.
            candidates.extend(solid.iter().skip(index + 2).map(|b| [*a, *b]));
        }
        let mut home = [0.0; MAX_AXES];
        (0..chain.len()).for_each(|axis| home[axis] = chain.home(axis));
        let mut random = ChaCha8Rng::seed_from_u64(0);
        let samples: Vec<Placed> =
            (0..SAMPLES).map(|_| self.place(&chain.frames(&within_limits(chain, || random.random())))).collect();
        let at_home = self.place(&chain.frames(&home));
        let by_design = |pair: &[usize; 2]| {
            let often = samples.iter().filter(|placed| self.overlap(placed, *pair)).count();
            self.overlap(&at_home, *pair) || often as f64 >= ALWAYS * SAMPLES as f64
        };
        (self.by_design, self.pairs) = candidates.into_iter().partition(by_design);
    }

    /// The shapes of a posture.
    pub(crate) fn place(&self, frames: &Frames) -> Placed {
        let at: Vec<Isometry3<f64>> = (0..self.bodies.len()).map(|body| frame(frames, body)).collect();
        let shapes =
            |(body, at): (&Body, &Isometry3<f64>)| body.solids.iter().map(|s| at * s.body_from_shape).collect();
        Placed {
            shapes: self.bodies.iter().zip(&at).map(shapes).collect(),
            centers: self.bodies.iter().zip(&at).map(|(body, at)| at * body.center).collect(),
        }
    }

    fn overlap(&self, placed: &Placed, [a, b]: [usize; 2]) -> bool {
        let (one, two) = (&self.bodies[a], &self.bodies[b]);
        if (placed.centers[a] - placed.centers[b]).norm() > one.radius + two.radius {
            return false;
        }
        one.solids.iter().zip(&placed.shapes[a]).any(|(solid, at)| {
            two.solids.iter().zip(&placed.shapes[b]).any(|(other, theirs)| solid.overlaps(at, other, theirs))
        })
    }

    /// The first pair of bodies that touch.
    pub(crate) fn self_contact(&self, placed: &Placed) -> Option<[usize; 2]> {
        self.pairs.iter().copied().find(|pair| self.overlap(placed, *pair))
    }

    /// Shapes of the bodies that axes move, with their poses in the base's frame: body, shape, pose.
    pub(crate) fn moving<'a>(
        &'a self,
        placed: &'a Placed,
    ) -> impl Iterator<Item = (usize, &'a Solid, &'a Isometry3<f64>)> + 'a {
        let bodies = self.bodies.iter().zip(&placed.shapes).enumerate().skip(1);
        bodies.flat_map(|(index, (body, at))| body.solids.iter().zip(at).map(move |(solid, at)| (index, solid, at)))
    }

    /// The body of the arm that the hand touches.
    pub(crate) fn hand_contact(&self, placed: &Placed, frames: &Frames, hand: &Carried) -> Option<usize> {
        let last = frame(frames, self.bodies.len() - 1);
        let center = last * hand.body.center;
        let near =
            |body: &&usize| (placed.centers[**body] - center).norm() <= self.bodies[**body].radius + hand.body.radius;
        hand.meets.iter().filter(near).copied().find(|&body| {
            hand.body.solids.iter().any(|own| {
                let at = last * own.body_from_shape;
                self.bodies[body]
                    .solids
                    .iter()
                    .zip(&placed.shapes[body])
                    .any(|(other, theirs)| own.overlaps(&at, other, theirs))
            })
        })
    }
}

/// Checks that an arm may carry a hand.
///
/// # Errors
/// [`ArmError::TooHeavy`], which names both.
pub fn check_payload(arm: &Arm, hand: &Hand) -> Result<(), ArmError> {
    let (mass, payload) = (hand.links.iter().map(|link| link.mass).sum::<f64>(), arm.payload);
    if mass > payload {
        let (hand, arm) = (hand.name.clone(), arm.name.clone());
        return Err(ArmError::TooHeavy { hand, arm, mass, payload });
    }
    Ok(())
}

impl Carried {
    /// Distance of the hand's farthest point from the flange, metres, or a little more.
    pub(crate) fn radius_about(&self, last_from_flange: &Isometry3<f64>) -> f64 {
        let far =
            |s: &Solid| (s.body_from_shape.translation.vector - last_from_flange.translation.vector).norm() + s.radius;
        self.body.solids.iter().map(far).fold(0.0, f64::max)
    }

    /// True if a point, in the frame of the last body, is inside the bounds of the hand, grown by a distance.
    pub(crate) fn encloses(&self, point: &Point3<f64>, by: f64) -> bool {
        let reach = |s: &Solid| s.shape.half_extents(&s.body_from_shape.rotation).add_scalar(by);
        let center = |s: &Solid| s.body_from_shape.translation.vector;
        (0..3).all(|axis| {
            let low = self.body.solids.iter().map(|s| center(s)[axis] - reach(s)[axis]).fold(f64::INFINITY, f64::min);
            let high = self.body.solids.iter().map(|s| center(s)[axis] + reach(s)[axis]).fold(-f64::INFINITY, f64::max);
            (low..=high).contains(&point[axis])
        })
    }

    /// The open hand with a preshape.
    ///
    /// * `flange_from_base`: pose of the hand's base on the flange.
    ///
    /// # Errors
    /// [`ArmError::Preshape`] for one that the hand cannot take; [`ArmError::MountedInArm`] where the hand is in a body that it is not hinged to.
    pub fn new(
        arm: &Arm,
        chain: &Chain,
        bodies: &ArmBodies,
        hand: &Hand,
        preshape: f64,
        flange_from_base: &Isometry3<f64>,
    ) -> Result<Self, ArmError> {
        let bad = || ArmError::Preshape { hand: hand.name.clone(), preshape };
        let [low, high] = hand.preshape_limits();
        if !(low..=high).contains(&preshape) {
            return Err(bad());
        }
        let shapes = hand.shapes_at(&hand.open_configuration(preshape)).map_err(|_| bad())?;
        let body_from_hand = chain.axis_from_flange() * flange_from_base * hand.base_from_hand;
        let last = bodies.count() - 1;
        let mut carried = Self { body: Body::of_hand(&shapes, &body_from_hand), meets: (0..last).collect() };
        let home: Vec<f64> = arm.home();
        let mut positions: Positions = [0.0; MAX_AXES];
        positions[..home.len()].copy_from_slice(&home);
        let frames = chain.frames(&positions);
        let placed = bodies.place(&frames);
        // What the last axis is hinged to may be so near that the hand always touches it.
        while let Some(body) = bodies.hand_contact(&placed, &frames, &carried) {
            if body + 1 != last {
                let (hand, arm) = (hand.name.clone(), arm.name.clone());
                return Err(ArmError::MountedInArm { hand, arm, link: bodies.name(body).to_owned() });
            }
            carried.meets.retain(|other| *other != body);
        }
        Ok(carried)
    }

    /// The same hand with its fingers elsewhere; `None` for a configuration that it does not have.
    pub(crate) fn with_fingers(
        &self,
        chain: &Chain,
        hand: &Hand,
        configuration: &[f64],
        flange_from_base: &Isometry3<f64>,
    ) -> Option<Self> {
        let body_from_hand = chain.axis_from_flange() * flange_from_base * hand.base_from_hand;
        let shapes = hand.shapes_at(configuration).ok()?;
        Some(Self { body: Body::of_hand(&shapes, &body_from_hand), meets: self.meets.clone() })
    }
}

/// Half the height of a shape, metres.
pub(crate) fn half_height(shape: &Shape, rotation: &UnitQuaternion<f64>) -> f64 {
    half_extent(shape, rotation, &Vector3::z())
}

/// Half of the extent of a rotated shape along a direction of length 1, metres.
pub(crate) fn half_extent(shape: &Shape, rotation: &UnitQuaternion<f64>, direction: &Vector3<f64>) -> f64 {
    let along = rotation.inverse_transform_vector(direction);
    match *shape {
        Shape::Cuboid(half) => along.abs().dot(&half),
        Shape::Cylinder { radius, half_length } => half_length * along.z.abs() + radius * along.xy().norm(),
        Shape::Sphere { radius } => radius,
    }
}

/// True if a point is within a distance of a shape about its own origin; at edges and corners up to `sqrt(3)` times it.
pub(crate) fn is_near(shape: &Shape, point: &Vector3<f64>, distance: f64) -> bool {
    match *shape {
        Shape::Cuboid(half) => (point.abs() - half).max() <= distance,
        Shape::Cylinder { radius, half_length } => {
            point.z.abs() <= half_length + distance && point.xy().norm() <= radius + distance
        }
        Shape::Sphere { radius } => point.norm() <= radius + distance,
    }
}
