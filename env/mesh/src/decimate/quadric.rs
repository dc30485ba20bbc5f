//! The sum of squared distances from planes, as a quadratic form.

use nalgebra::{Matrix3, Point3, Vector3};

/// `x^T A x + 2 b^T x + c`, in m2 times the weights.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Quadric {
    a: Matrix3<f64>,
    b: Vector3<f64>,
    c: f64,
}

impl Quadric {
    /// Adds the plane through `point` with normal `area`, weighted by the length of `area` (m2) and `weight`.
    pub fn add_plane(&mut self, area: &Vector3<f64>, point: &Point3<f64>, weight: f64) {
        let Some(normal) = area.try_normalize(0.0) else { return };
        let weight = weight * area.norm();
        let offset = -normal.dot(&point.coords);
        self.a += normal * normal.transpose() * weight;
        self.b += normal * (offset * weight);
        self.c += offset * offset * weight;
    }

    pub fn add(&mut self, other: &Self) {
        self.a += other.a;
        self.b += other.b;
        self.c += other.c;
    }

    /// Never negative: below rounding it is 0.
    pub fn cost(&self, x: &Point3<f64>) -> f64 {
        let x = x.coords;
        (x.dot(&(self.a * x)) + 2.0 * self.b.dot(&x) + self.c).max(0.0)
    }

    /// Where the cost is least: the solution nearest to `near`, so that along a flat or straight part nothing moves needlessly.
    /// `None` without any plane.
    pub fn minimum(&self, near: &Point3<f64>) -> Option<Point3<f64>> {
        let svd = self.a.svd(true, true);
        let largest = svd.singular_values.max();
        if largest == 0.0 {
            return None;
        }
        let residual = -self.b - self.a * near.coords;
        // Directions a thousandth as stiff as the stiffest are flat.
        svd.solve(&residual, 1e-3 * largest).ok().map(|step| near + step)
    }
}
