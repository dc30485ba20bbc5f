//! Conversions between f64 metres and parry's f32 centimetres.
//!
//! Parry's distance query (GJK) has absolute tolerances. In metres, a triangle of less than 5 cm2 counts as degenerate, as large as a part of
//! a hand; in centimetres, one of less than 0.05 mm2.

use nalgebra::{Isometry3, Point3, Vector3};
use parry3d::math::{Pose, Rotation, Vector};

/// Parry's units of length per metre: centimetres.
const UNIT: f64 = 100.0;

/// A length for parry.
pub(crate) fn length(x: f64) -> f32 {
    (x * UNIT) as f32
}

/// A length from parry, metres.
pub(crate) fn metres(x: f32) -> f64 {
    f64::from(x) / UNIT
}

/// A position or displacement for parry.
pub(crate) fn lengths(x: &Vector3<f64>) -> Vector {
    Vector::new(length(x.x), length(x.y), length(x.z))
}

/// A position or displacement from parry, metres.
pub(crate) fn metres64(x: Vector) -> Vector3<f64> {
    Vector3::new(metres(x.x), metres(x.y), metres(x.z))
}

/// A direction from parry.
pub(crate) fn direction(x: Vector) -> Vector3<f64> {
    Vector3::new(f64::from(x.x), f64::from(x.y), f64::from(x.z))
}

/// A point for parry.
pub(crate) fn point(x: &Point3<f64>) -> Vector {
    lengths(&x.coords)
}

/// A rigid motion for parry.
pub(crate) fn pose(x: &Isometry3<f64>) -> Pose {
    let q = x.rotation.coords;
    let turn = Rotation::from_xyzw(q.x as f32, q.y as f32, q.z as f32, q.w as f32).normalize();
    Pose::from_parts(lengths(&x.translation.vector), turn)
}
