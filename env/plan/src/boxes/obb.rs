//! An oriented box.

use nalgebra::{Matrix3, Point3, Vector3};
use serde::{Deserialize, Serialize};

/// An oriented box in the frame of the points that it was fitted to; lengths in metres.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OrientedBox {
    pub center: Point3<f64>,
    /// Unit axes as columns, right-handed; the longest side first, the shortest last.
    pub axes: Matrix3<f64>,
    /// Half the length of each side, in the order of `axes`.
    pub half_extents: Vector3<f64>,
}

impl OrientedBox {
    /// The least box with these axes (orthonormal columns, in any order) around `points`. The columns are sorted, longest side first, and the
    /// last one is flipped if needed to keep the frame right-handed. Without points, the box has size 0 at the origin.
    pub fn around<'a>(axes: &Matrix3<f64>, points: impl IntoIterator<Item = &'a Point3<f64>>) -> Self {
        let mut min = Vector3::repeat(f64::INFINITY);
        let mut max = Vector3::repeat(f64::NEG_INFINITY);
        for p in points {
            let local = axes.tr_mul(&p.coords);
            min = min.inf(&local);
            max = max.sup(&local);
        }
        if min.x > max.x {
            (min, max) = (Vector3::zeros(), Vector3::zeros());
        }
        let half = (max - min) * 0.5;
        let center = Point3::from(axes * ((max + min) * 0.5));
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| half[b].total_cmp(&half[a]));
        let [x, y] = [axes.column(order[0]).into_owned(), axes.column(order[1]).into_owned()];
        Self {
            center,
            axes: Matrix3::from_columns(&[x, y, x.cross(&y)]),
            half_extents: Vector3::new(half[order[0]], half[order[1]], half[order[2]]),
        }
    }

    /// Volume, m3.
    pub fn volume(&self) -> f64 {
        8.0 * self.half_extents.product()
    }

    /// `point` in the box's frame (origin at its centre), metres.
    pub fn local(&self, point: &Point3<f64>) -> Vector3<f64> {
        self.axes.tr_mul(&(point - self.center))
    }

    /// Largest excess of `point` over the six faces, metres; at most 0 inside.
    pub fn excess(&self, point: &Point3<f64>) -> f64 {
        (self.local(point).abs() - self.half_extents).max()
    }

    /// True if `point` is at most `tolerance` metres outside each face.
    pub fn contains(&self, point: &Point3<f64>, tolerance: f64) -> bool {
        self.excess(point) <= tolerance
    }

    /// The eight corners.
    pub fn corners(&self) -> [Point3<f64>; 8] {
        std::array::from_fn(|i| {
            let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
            let local = Vector3::new(sign(0), sign(1), sign(2)).component_mul(&self.half_extents);
            self.center + self.axes * local
        })
    }
}
