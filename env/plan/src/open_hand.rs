//! The open hand as collision shapes, swept back along the approach.

use crate::PlanError;
use graspbox_hand::{Hand, Shape};
use graspbox_mesh::{TriMesh, convex_hull};
use nalgebra::{Isometry3, Point3, Vector3};
use parry3d_f64::math::{Pose, Rotation, Vector};
use parry3d_f64::shape::SharedShape;

/// One collision shape in the hand frame.
pub(crate) struct SweptShape {
    /// The shape at the pose.
    pub shape: SharedShape,
    pub hand_from_shape: Pose,
    /// The volume that it sweeps on the straight approach, including its end.
    pub swept: SharedShape,
    /// Pose of the swept volume.
    pub hand_from_swept: Pose,
    /// Points that span the shape, for tests against half-spaces: hand frame, metres.
    pub corners: Vec<Point3<f64>>,
    /// Radius of a ball about each of these points, metres.
    pub radius: f64,
}

/// The open hand at one preshape, with all shapes grown by a clearance.
pub struct OpenHand {
    pub(crate) shapes: Vec<SweptShape>,
    pub(crate) standoff: f64,
}

impl OpenHand {
    /// The open hand with `preshape`, its shapes grown by `clearance` metres on every side; the approach starts `standoff` metres back along
    /// -z of the hand.
    ///
    /// # Errors
    /// [`PlanError::UnsupportedHand`] for a preshape beyond the hand's limits, or a shape without volume.
    pub fn new(hand: &Hand, preshape: f64, clearance: f64, standoff: f64) -> Result<Self, PlanError> {
        let bad = |reason| PlanError::UnsupportedHand { name: hand.name.clone(), reason };
        let placed =
            hand.shapes_at(&hand.open_configuration(preshape)).map_err(|_| bad("cannot take this preshape"))?;
        let shapes = placed
            .iter()
            .map(|placed| sweep(&placed.hand_from_shape, &placed.collider.shape, clearance, standoff))
            .collect::<Option<Vec<_>>>()
            .ok_or_else(|| bad("has a collision shape without volume"))?;
        Ok(Self { shapes, standoff })
    }

    /// True if the hand meets the table, z = 0 of the world, on its straight approach to `world_from_hand`.
    pub fn meets_table(&self, world_from_hand: &Isometry3<f64>) -> bool {
        self.is_below((world_from_hand * Vector3::z()).z * self.standoff, |c| (world_from_hand * c).z)
    }

    /// True if a shape reaches below height 0 at the pose, or where the approach begins, `back` metres lower.
    pub(crate) fn is_below(&self, back: f64, height: impl Fn(&Point3<f64>) -> f64) -> bool {
        self.shapes.iter().any(|s| {
            let lowest = s.corners.iter().map(&height).fold(f64::INFINITY, f64::min);
            lowest - back.max(0.0) < s.radius
        })
    }
}

fn sweep(at: &Isometry3<f64>, shape: &Shape, clearance: f64, standoff: f64) -> Option<SweptShape> {
    match shape {
        Shape::Cuboid(half) => sweep_cuboid(at, &half.add_scalar(clearance), standoff),
        // A cylinder counts as the box around it: slightly larger, never smaller.
        Shape::Cylinder { radius, half_length } => {
            sweep_cuboid(at, &Vector3::new(*radius, *radius, *half_length).add_scalar(clearance), standoff)
        }
        Shape::Sphere { radius } => {
            let radius = radius + clearance;
            let back = at.translation.vector - Vector3::z() * standoff;
            Some(SweptShape {
                shape: SharedShape::ball(radius),
                hand_from_shape: pose(at),
                swept: SharedShape::capsule(vector(&at.translation.vector), vector(&back), radius),
                hand_from_swept: Pose::IDENTITY,
                corners: vec![Point3::from(at.translation.vector)],
                radius,
            })
        }
    }
}

fn sweep_cuboid(at: &Isometry3<f64>, half: &Vector3<f64>, standoff: f64) -> Option<SweptShape> {
    /// A side is along the approach if its cosine is within this of 1 (about 0.1 degrees).
    const ALIGNED: f64 = 1e-6;
    if half.min() <= 0.0 {
        return None;
    }
    let corners: Vec<Point3<f64>> = (0..8)
        .map(|i| {
            let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
            at * Point3::from(Vector3::new(sign(0), sign(1), sign(2)).component_mul(half))
        })
        .collect();
    let back = Vector3::z() * standoff;
    let along = at.rotation.inverse() * Vector3::z();
    let axis = along.iamax();
    let (swept, hand_from_swept) = if 1.0 - along[axis].abs() < ALIGNED {
        let mut long = *half;
        long[axis] += standoff / 2.0;
        let mut middle = *at;
        middle.translation.vector -= back / 2.0;
        (cuboid(&long), pose(&middle))
    } else {
        let points: Vec<Point3<f64>> = corners.iter().flat_map(|c| [*c, c - back]).collect();
        (convex(&convex_hull(&points).ok()?)?, Pose::IDENTITY)
    };
    Some(SweptShape { shape: cuboid(half), hand_from_shape: pose(at), swept, hand_from_swept, corners, radius: 0.0 })
}

fn cuboid(half: &Vector3<f64>) -> SharedShape {
    SharedShape::cuboid(half.x, half.y, half.z)
}

/// A convex hull in metres for the collision library; `None` without volume. (The library's own hull drops vertices of flat sides.)
pub(crate) fn convex(hull: &TriMesh) -> Option<SharedShape> {
    SharedShape::convex_mesh(hull.vertices().iter().map(|p| vector(&p.coords)).collect(), hull.faces())
}

pub(crate) fn vector(v: &Vector3<f64>) -> Vector {
    Vector::new(v.x, v.y, v.z)
}

pub(crate) fn pose(at: &Isometry3<f64>) -> Pose {
    let q = at.rotation.coords;
    Pose::from_parts(vector(&at.translation.vector), Rotation::from_xyzw(q.x, q.y, q.z, q.w))
}
