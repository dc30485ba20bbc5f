//! Conversions between f64 nalgebra values in metres and rapier's f32 glam values in centimetres.
//!
//! The distance query of parry (GJK) has absolute tolerances: a simplex with |ab x ac|^2 < 10 f32::EPSILON counts as degenerate. In metres that is
//! every triangle of less than 5 cm2, as large as a part of a hand. The query then stalls, takes neighbours for overlapping, and reports
//! penetrations of centimetres, which throw the object. In centimetres the tolerance is 0.05 mm2. Kilograms and seconds stay. Forces and
//! impulses scale by [`UNIT`]; torques, inertias, and the stiffness and damping of joints by its square ([`TORQUE_UNIT`]).

use nalgebra::{Isometry3, Matrix3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rapier3d::math::{Pose, Rotation, Vector};

/// Rapier's units of length per metre: centimetres.
pub(crate) const UNIT: f64 = 100.0;
/// Rapier's units of torque per N m, and of inertia per kg m2.
pub(crate) const TORQUE_UNIT: f64 = UNIT * UNIT;

/// A length in metres for rapier.
pub(crate) fn length(x: f64) -> f32 {
    (x * UNIT) as f32
}

/// A length from rapier in metres, or a force in newtons.
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

/// A vector that does not scale with length, for rapier: a direction, an angular velocity.
pub(crate) fn vector(x: &Vector3<f64>) -> Vector {
    Vector::new(x.x as f32, x.y as f32, x.z as f32)
}

/// A position, velocity or acceleration in metres for rapier.
pub(crate) fn lengths(x: &Vector3<f64>) -> Vector {
    vector(&(x * UNIT))
}

pub(crate) fn point(x: &Point3<f64>) -> Vector {
    lengths(&x.coords)
}

/// A vector that does not scale with length, from rapier.
pub(crate) fn vector64(x: Vector) -> Vector3<f64> {
    Vector3::new(x.x as f64, x.y as f64, x.z as f64)
}

/// A position or velocity from rapier in metres.
pub(crate) fn metres64(x: Vector) -> Vector3<f64> {
    vector64(x) / UNIT
}

/// An inertia tensor in kg m2 for rapier.
pub(crate) fn inertia(m: &Matrix3<f64>) -> rapier3d::math::Matrix {
    let c = |i: usize| vector(&(m.column(i) * TORQUE_UNIT));
    rapier3d::math::Matrix::from_cols(c(0), c(1), c(2))
}
