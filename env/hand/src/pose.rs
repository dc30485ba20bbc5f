//! The grasp pose: where the hand goes, and its preshape; and rigid motions from matrices.

use nalgebra::{Isometry3, Matrix3, Matrix4, Rotation3, Translation3, UnitQuaternion};
use serde::{Deserialize, Serialize};

/// A hand pose to grasp from, with the preshape of its fingers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct GraspPose {
    /// Hand (grasp) frame in the object's frame.
    pub object_from_hand: Isometry3<f64>,
    /// The preshape as one number: see [`crate::grasp`].
    pub preshape: f64,
}

/// A rotation may be off by this much in any entry of R^T R: the rounding of a matrix printed with 6 digits.
const ORTHONORMAL: f64 = 1e-5;

/// The rigid motion of a homogeneous matrix, row-major: a rotation, a translation column, the last row 0 0 0 1.
///
/// A skew from rounding is removed, so that long products stay rigid. None for numbers that are not finite, a matrix that is
/// not orthonormal within 1e-5, a reflection, or another last row.
#[must_use]
pub fn rigid_motion(rows: &[f64; 16]) -> Option<Isometry3<f64>> {
    let matrix = Matrix4::from_row_slice(rows);
    let rotation: Matrix3<f64> = matrix.fixed_view::<3, 3>(0, 0).into();
    let bottom = [matrix[(3, 0)], matrix[(3, 1)], matrix[(3, 2)], matrix[(3, 3)] - 1.0];
    let skew = (rotation.tr_mul(&rotation) - Matrix3::identity()).amax();
    let finite = rows.iter().all(|x| x.is_finite());
    if !finite || skew > ORTHONORMAL || rotation.determinant() < 0.0 || bottom.iter().any(|x| x.abs() > ORTHONORMAL) {
        return None;
    }
    let guess = Rotation3::from_matrix_unchecked(rotation);
    let closest = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_eps(&rotation, 1e-12, 20, guess));
    // The iteration keeps the skew of its guess. A rotation that is exact within rounding keeps its bits.
    let exact = (closest.norm_squared() - 1.0).abs() < 1e-12;
    let rotation = if exact { closest } else { UnitQuaternion::new_normalize(closest.into_inner()) };
    let translation = Translation3::new(matrix[(0, 3)], matrix[(1, 3)], matrix[(2, 3)]);
    Some(Isometry3::from_parts(translation, rotation))
}
