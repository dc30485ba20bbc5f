//! Conversions between the project's f64 nalgebra values and the engine's f32 glam values.

use nalgebra::{Isometry3, Matrix3, Point3, Quaternion, Translation3, UnitQuaternion, Vector3};
use rapier3d::math::{Pose, Rotation, Vector};

pub(crate) fn pose(x: &Isometry3<f64>) -> Pose {
    let q = x.rotation.coords;
    Pose::from_parts(
        vector(&x.translation.vector),
        Rotation::from_xyzw(q.x as f32, q.y as f32, q.z as f32, q.w as f32).normalize(),
    )
}

pub(crate) fn isometry(x: &Pose) -> Isometry3<f64> {
    let (t, q) = (x.translation, x.rotation);
    let q = Quaternion::new(q.w as f64, q.x as f64, q.y as f64, q.z as f64);
    Isometry3::from_parts(
        Translation3::new(t.x as f64, t.y as f64, t.z as f64),
        UnitQuaternion::from_quaternion(q),
    )
}

pub(crate) fn vector(x: &Vector3<f64>) -> Vector {
    Vector::new(x.x as f32, x.y as f32, x.z as f32)
}

pub(crate) fn point(x: &Point3<f64>) -> Vector {
    vector(&x.coords)
}

pub(crate) fn vector64(x: Vector) -> Vector3<f64> {
    Vector3::new(x.x as f64, x.y as f64, x.z as f64)
}

pub(crate) fn matrix(m: &Matrix3<f64>) -> rapier3d::math::Matrix {
    let c = |i: usize| vector(&m.column(i).into_owned());
    rapier3d::math::Matrix::from_cols(c(0), c(1), c(2))
}
