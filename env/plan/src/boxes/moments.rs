//! A frame that rotates with a cloud of points: principal axes with signs from third moments.

use nalgebra::{Matrix3, Point3, Vector3};

/// A frame that depends only on a cloud.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CloudFrame {
    /// Mean of the points.
    pub origin: Point3<f64>,
    /// Principal axes as columns, largest variance first, right-handed.
    pub axes: Matrix3<f64>,
}

impl CloudFrame {
    /// The principal frame of `points` (at least one). Clouds with equal variances have no unique frame; any is returned.
    pub fn of(points: &[Point3<f64>]) -> Self {
        let origin = mean(points);
        let mut covariance = Matrix3::zeros();
        for p in points {
            let d = p - origin;
            covariance += d * d.transpose();
        }
        let eigen = (covariance / points.len() as f64).symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let [x, y] = [0, 1].map(|i| eigen.eigenvectors.column(order[i]).normalize());
        let axes = Matrix3::from_columns(&[x, y, x.cross(&y)]);
        Self { origin, axes: with_invariant_signs(&axes, &origin, points) }
    }
}

/// Mean of `points`; the origin if there are none.
pub(crate) fn mean(points: &[Point3<f64>]) -> Point3<f64> {
    let sum: Vector3<f64> = points.iter().map(|p| p.coords).sum();
    Point3::from(sum / points.len().max(1) as f64)
}

/// Flips the first two `axes` to make the cloud's third moments along them nonnegative; the third axis completes a right-handed frame.
pub(crate) fn with_invariant_signs(axes: &Matrix3<f64>, origin: &Point3<f64>, points: &[Point3<f64>]) -> Matrix3<f64> {
    let skew: Vector3<f64> = points.iter().map(|p| axes.tr_mul(&(p - origin)).map(|x| x * x * x)).sum();
    let sign = |moment: f64| if moment < 0.0 { -1.0 } else { 1.0 };
    let [x, y] = [0, 1].map(|i| axes.column(i) * sign(skew[i]));
    Matrix3::from_columns(&[x, y, x.cross(&y)])
}
