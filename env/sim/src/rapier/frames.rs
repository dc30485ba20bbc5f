//! Conversions between the project's f64 nalgebra values in metres and the engine's f32 glam values in centimetres.
//!
//! The engine's distance query (GJK) has absolute tolerances: a simplex with |ab x ac|^2 < 10 f32::EPSILON counts as degenerate. In
//! metres that is every triangle of less than 5 cm2, a large part of a hand or of what it grasps: the query then stalls,
//! takes neighbours for overlapping ones, and reports penetrations of centimetres that throw the object. In centimetres the
//! same tolerance is 0.05 mm2. Kilograms and seconds stay; a force or an impulse scales by [`UNIT`], a torque, an inertia and the
//! stiffness or damping of a joint by its square ([`TORQUE_UNIT`]).

use nalgebra::{Isometry3, Matrix3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rapier3d::math::{Pose, Rotation, Vector};

/// Engine lengths in a metre.
pub(crate) const UNIT: f64 = 100.0;
/// Engine torques in a newton metre; engine moments of inertia in a kg m2.
pub(crate) const TORQUE_UNIT: f64 = UNIT * UNIT;

/// A length in metres, for the engine.
pub(crate) fn length(x: f64) -> f32 {
    (x * UNIT) as f32
}

/// A length (or, for forces, the component of one) from the engine, in metres (newtons).
pub(crate) fn metres(x: f32) -> f64 {
    x as f64 / UNIT
}

pub(crate) fn pose(x: &Isometry3<f64>) -> Pose {
    let q = x.rotation.coords;
    Pose::from_parts(
        lengths(&x.translation.vector),
        Rotation::from_xyzw(q.x as f32, q.y as f32, q.z as f32, q.w as f32).normalize(),
    )
}

pub(crate) fn isometry(x: &Pose) -> Isometry3<f64> {
    let q = x.rotation;
    let q = Quaternion::new(q.w as f64, q.x as f64, q.y as f64, q.z as f64);
    Isometry3::from_parts(Translation3::from(metres64(x.translation)), UnitQuaternion::from_quaternion(q))
}

/// A vector without a length in it: a direction, an angular velocity.
pub(crate) fn vector(x: &Vector3<f64>) -> Vector {
    Vector::new(x.x as f32, x.y as f32, x.z as f32)
}

/// A position, velocity or acceleration in metres, for the engine.
pub(crate) fn lengths(x: &Vector3<f64>) -> Vector {
    vector(&(x * UNIT))
}

pub(crate) fn point(x: &Point3<f64>) -> Vector {
    lengths(&x.coords)
}

/// A vector without a length in it, from the engine.
pub(crate) fn vector64(x: Vector) -> Vector3<f64> {
    Vector3::new(x.x as f64, x.y as f64, x.z as f64)
}

/// A position or velocity from the engine, in metres.
pub(crate) fn metres64(x: Vector) -> Vector3<f64> {
    vector64(x) / UNIT
}

/// A tensor of inertia in kg m2, for the engine.
pub(crate) fn inertia(m: &Matrix3<f64>) -> rapier3d::math::Matrix {
    let c = |i: usize| vector(&(m.column(i) * TORQUE_UNIT));
    rapier3d::math::Matrix::from_cols(c(0), c(1), c(2))
}
