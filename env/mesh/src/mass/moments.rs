//! Integrals of 1, x and x x^T over a solid.

use crate::trimesh::TriMesh;
use nalgebra::{Matrix3, Point3, Vector3};

/// Integrals of 1, x and x x^T over a solid, about a reference point near it.
#[derive(Clone, Debug)]
pub(super) struct Moments {
    /// The point from which x is measured.
    pub reference: Point3<f64>,
    /// Integral of 1, m3.
    pub volume: f64,
    /// Integral of x, m4.
    pub first: Vector3<f64>,
    /// Integral of x x^T, m5.
    pub second: Matrix3<f64>,
}

impl Moments {
    /// Of nothing.
    pub fn zero(reference: Point3<f64>) -> Self {
        Self { reference, volume: 0.0, first: Vector3::zeros(), second: Matrix3::zeros() }
    }

    /// Of the volume that a closed mesh winds around, counted with the winding number: signed tetrahedra from the reference
    /// point to every face, exact.
    ///
    /// For corners 0, a, b, c and six times the volume d: the integral of x is d (a + b + c) / 24, that of x x^T is
    /// d ((a + b + c)(a + b + c)^T + a a^T + b b^T + c c^T) / 120.
    pub fn of(mesh: &TriMesh, reference: Point3<f64>) -> Self {
        let mut all = Self::zero(reference);
        for face in 0..mesh.faces().len() {
            let [a, b, c] = mesh.triangle(face).map(|p| p - reference);
            let d = a.dot(&b.cross(&c));
            let sum = a + b + c;
            all.volume += d / 6.0;
            all.first += sum * (d / 24.0);
            all.second +=
                (sum * sum.transpose() + a * a.transpose() + b * b.transpose() + c * c.transpose()) * (d / 120.0);
        }
        all
    }

    /// Adds a box of `sides` around `center`, which is measured from the reference point, `weight` times.
    pub fn add_box(&mut self, center: &Vector3<f64>, sides: &Vector3<f64>, weight: f64) {
        let volume = sides.product() * weight;
        self.volume += volume;
        self.first += center * volume;
        self.second +=
            (center * center.transpose() + Matrix3::from_diagonal(&sides.component_mul(sides)) / 12.0) * volume;
    }

    /// `self + factor * other`, both about the same point.
    pub fn plus(&self, other: &Self, factor: f64) -> Self {
        Self {
            reference: self.reference,
            volume: self.volume + other.volume * factor,
            first: self.first + other.first * factor,
            second: self.second + other.second * factor,
        }
    }
}
