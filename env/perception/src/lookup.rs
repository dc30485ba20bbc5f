//! A box of cells in the hand frame, and the cells that a moving shape sweeps.

use graspbox_hand::Shape;
use nalgebra::{Isometry3, Point3, Vector3};

/// A box of cells: cell (i, j, k) has its centre at `origin + (i + 0.5, j + 0.5, k + 0.5) * cell`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CellBox {
    /// Least corner, metres.
    pub origin: Point3<f64>,
    /// Cells along each axis.
    pub shape: [usize; 3],
    /// Side of a cell, metres.
    pub cell: f64,
}

impl CellBox {
    /// The cells that cover `low` to `high`.
    #[must_use]
    pub fn covering(low: &Vector3<f64>, high: &Vector3<f64>, cell: f64) -> Self {
        let shape = [0, 1, 2].map(|axis| ((high[axis] - low[axis]) / cell).ceil().max(1.0) as usize);
        Self { origin: Point3::from(*low), shape, cell }
    }

    #[must_use]
    #[allow(clippy::len_without_is_empty)]
    pub fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// Flat index of a cell.
    #[must_use]
    pub fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (i * self.shape[1] + j) * self.shape[2] + k
    }

    /// Centre of a cell, metres.
    #[must_use]
    pub fn center(&self, at: [usize; 3]) -> Point3<f64> {
        self.origin + Vector3::from(at.map(|i| i as f64 + 0.5)) * self.cell
    }

    /// Calls `visit` with the flat index and the centre of each cell whose centre is between `low` and `high`.
    fn within(&self, low: &Vector3<f64>, high: &Vector3<f64>, mut visit: impl FnMut(usize, &Point3<f64>)) {
        let range = |axis: usize| {
            let first = ((low[axis] - self.origin[axis]) / self.cell - 0.5).ceil().max(0.0) as usize;
            let last = ((high[axis] - self.origin[axis]) / self.cell - 0.5).floor();
            first..if last < 0.0 { 0 } else { (last as usize + 1).min(self.shape[axis]) }
        };
        for i in range(0) {
            for j in range(1) {
                for k in range(2) {
                    visit(self.index([i, j, k]), &self.center([i, j, k]));
                }
            }
        }
    }

    /// Calls `visit` with the flat index of each cell whose centre the solid sweeps.
    pub fn cover(&self, solid: &Solid, mut visit: impl FnMut(usize)) {
        let [low, high] = solid.bounds();
        self.within(&low, &high, |index, center| {
            if solid.meets(center) {
                visit(index);
            }
        });
    }
}

/// A box on a straight path: a collision shape, grown on every side, that approaches along the hand's z axis.
#[derive(Clone, Copy, Debug)]
pub struct Solid {
    hand_from_shape: Isometry3<f64>,
    half: Vector3<f64>,
    /// Beginning of the path relative to its end, hand frame, metres.
    back: Vector3<f64>,
}

impl Solid {
    /// * `grow`: added on every side, metres.
    /// * `standoff`: length of the path, metres.
    ///
    /// A cylinder or a ball counts as the box around it.
    #[must_use]
    pub fn new(shape: &Shape, hand_from_shape: &Isometry3<f64>, grow: f64, standoff: f64) -> Self {
        let half = match *shape {
            Shape::Cuboid(half) => half,
            Shape::Cylinder { radius, half_length } => Vector3::new(radius, radius, half_length),
            Shape::Sphere { radius } => Vector3::repeat(radius),
        };
        Self { hand_from_shape: *hand_from_shape, half: half.add_scalar(grow), back: Vector3::z() * -standoff }
    }

    /// Least and greatest coordinates on the whole path, hand frame, metres.
    #[must_use]
    pub fn bounds(&self) -> [Vector3<f64>; 2] {
        let reach = self.hand_from_shape.rotation.to_rotation_matrix().matrix().abs() * self.half;
        let center = self.hand_from_shape.translation.vector;
        let begin = center + self.back;
        [center.inf(&begin) - reach, center.sup(&begin) + reach]
    }

    /// The corners at the end of the path, hand frame.
    pub fn corners(&self) -> impl Iterator<Item = Point3<f64>> + '_ {
        (0..8).map(|i| {
            let sign = |bit: usize| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
            self.hand_from_shape * Point3::from(Vector3::new(sign(0), sign(1), sign(2)).component_mul(&self.half))
        })
    }

    /// True if the box sweeps `p`: the segment from `p` to `p - back` intersects the box at the end of the path.
    fn meets(&self, p: &Point3<f64>) -> bool {
        let from = self.hand_from_shape.inverse_transform_point(p);
        let along = self.hand_from_shape.inverse_transform_vector(&-self.back);
        let (mut enter, mut leave) = (0.0_f64, 1.0_f64);
        for axis in 0..3 {
            let (x, d, half) = (from[axis], along[axis], self.half[axis]);
            if d.abs() < 1e-12 {
                if x.abs() > half {
                    return false;
                }
            } else {
                let (a, b) = ((-half - x) / d, (half - x) / d);
                enter = enter.max(a.min(b));
                leave = leave.min(a.max(b));
            }
        }
        enter <= leave
    }
}
